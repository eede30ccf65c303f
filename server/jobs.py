"""Long work that a client comes back for."""

import asyncio
import logging
import secrets
import time
from collections.abc import AsyncIterator, Callable
from datetime import UTC, datetime
from typing import Any, Literal

from pydantic import BaseModel
from texsss_server.answers import Answer
from texsss_server.problems import Problem, of_error, retry_after
from texsss_server.settings import MB, Settings
from texsss_server.turn import JOB, Turn
from texsss_server.worker import Call, Worker, bare

from texsss.errors import TexsssError

log = logging.getLogger("texsss.server")

MOST_FINISHED = 1000  # jobs whose end is remembered
State = Literal["queued", "running", "done", "failed", "cancelled"]


class Links(BaseModel):
    """Where to go from here."""

    self: str
    events: str
    result: str


class JobView(BaseModel):
    """How far a job is. `problem` says why it failed; `result` is there once it is done."""

    id: str
    kind: Literal["render", "bake"]
    state: State
    stage: str
    fraction: float
    created: datetime
    links: Links
    problem: dict[str, Any] | None = None


class Job:
    """Work under way, and what came of it."""

    def __init__(self, kind: Literal["render", "bake"], turn: Turn, tag: str):
        self.id, self.turn, self.tag = secrets.token_urlsafe(16), turn, tag
        self.kind: Literal["render", "bake"] = kind
        self.created, self.finished_at = datetime.now(UTC), float("inf")
        self.answer: Answer | None = None
        self.problem: Problem | None = None
        self.fetched = False
        self._changed = asyncio.Event()

    @property
    def state(self) -> State:
        """Where it stands."""
        if self.answer is not None:
            return "done"
        if self.problem is not None:
            return "cancelled" if self.turn.reason == "cancelled" else "failed"
        return "running" if self.turn.started else "queued"

    @property
    def finished(self) -> bool:
        """Whether nothing more will happen."""
        return self.answer is not None or self.problem is not None

    def view(self) -> JobView:
        """What a client sees."""
        base = f"/v1/jobs/{self.id}"
        return JobView(
            id=self.id,
            kind=self.kind,
            state=self.state,
            stage="done" if self.answer else self.turn.stage,
            fraction=1.0 if self.answer else round(self.turn.fraction, 4),
            created=self.created,
            links=Links(self=base, events=f"{base}/events", result=f"{base}/result"),
            problem=None if self.problem is None else self.problem.as_dict(self.id),
        )

    def notify(self) -> None:
        """Wakes everyone who follows; on the loop."""
        self._changed.set()
        self._changed = asyncio.Event()

    async def follow(self) -> AsyncIterator[JobView]:
        """Its view now and after every change, until it is finished or the service stops."""
        while True:
            # all of it before the client reads on: what changes meanwhile is the next view
            changed, last = self._changed, self.finished or self.turn.reason == "stopping"
            yield self.view()
            if last:
                return
            await changed.wait()

    async def end(self) -> None:
        """Returns when it is finished or the service stops."""
        async for _ in self.follow():
            pass


class Jobs:
    """The jobs of all clients, known by ids that nobody guesses. Finished ones expire."""

    def __init__(self, settings: Settings, worker: Worker, took: Callable[[dict[str, float]], None]):
        """`took` hears the seconds of every stage that a job went through."""
        self.settings, self.worker, self._took = settings, worker, took
        self._jobs: dict[str, Job] = {}
        self._tasks: set[asyncio.Task] = set()

    def __iter__(self):
        return iter(list(self._jobs.values()))

    async def start(
        self,
        kind: Literal["render", "bake"],
        call: Call,
        tag: str = "",
        keep: Callable[[str, Answer], None] = lambda tag, answer: None,
    ) -> Job:
        """A job for `call`, whose answer is named `tag` and handed to `keep`.

        Raises Problem: when too many wait.
        """
        self.expire()
        unfinished = sum(not job.finished for job in self)
        if unfinished >= self.settings.jobs:
            await asyncio.sleep(self.settings.queue_wait_s)
            raise retry_after("queue-full", f"{unfinished} jobs are unfinished; come back later.", 10)
        turn = Turn(self.settings.job_timeout_s, patience=JOB)
        job = Job(kind, turn, tag)
        loop = asyncio.get_running_loop()
        turn.heard = lambda: loop.call_soon_threadsafe(job.notify)
        self._jobs[job.id] = job
        task = asyncio.create_task(self._run(job, call, keep))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return job

    def get(self, name: str) -> Job | None:
        """A job by its id, None if there is none (any more)."""
        self.expire()
        return self._jobs.get(name)

    def remove(self, job: Job) -> None:
        """Cancels a job under way; forgets a finished one."""
        if job.finished:
            self._jobs.pop(job.id, None)
        else:
            self.worker.stop(job.turn, "cancelled")
            job.problem = job.turn.problem()
            self._finish(job)

    def expire(self) -> None:
        """Forgets finished jobs that are old, and the oldest while they are too many or too large."""
        finished = sorted((job for job in self if job.finished), key=lambda job: job.finished_at)
        size = sum(len(job.answer.body) for job in finished if job.answer is not None)
        for k, job in enumerate(finished):
            old = time.monotonic() - job.finished_at > self.settings.job_ttl_s
            if not old and size <= self.settings.jobs_mb * MB and len(finished) - k <= MOST_FINISHED:
                break
            size -= len(job.answer.body) if job.answer is not None else 0
            del self._jobs[job.id]

    def owes(self, since: float) -> bool:
        """Whether a job is unfinished, or a result that came after `since` (monotonic) [s] not fetched."""
        return any(
            not job.finished or (job.answer and not job.fetched and job.finished_at >= since) for job in self
        )

    def stop(self) -> None:
        """Ends every event stream, since the service stops."""
        for job in self:
            job.turn.stop("stopping")
            job.notify()

    async def _run(self, job: Job, call: Call, keep: Callable[[str, Answer], None]) -> None:
        try:
            answer = await self.worker.run(call, job.turn)
            if job.problem is None:  # else it was cancelled while its last step ran
                job.answer = answer
                keep(job.tag, answer)
        except Problem as problem:
            bare(problem)
            job.problem = job.problem or problem
        except TexsssError as error:
            job.problem = job.problem or of_error(error)
        except Exception:
            log.exception("a job broke", extra={"job": job.id})
            job.problem = job.problem or Problem("internal", "Something broke here; the log knows more.")
        finally:
            self._took(job.turn.seconds)
            self._finish(job)

    def _finish(self, job: Job) -> None:
        job.finished_at = min(job.finished_at, time.monotonic())
        job.notify()
        asyncio.get_running_loop().call_later(self.settings.job_ttl_s + 1, self.expire)
