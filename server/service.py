"""What the routes share: uploads, the render thread, jobs, answers; and how a request is answered."""

import asyncio
import gc
import logging
import re
import time
from collections.abc import Callable
from typing import Annotated, Any, Literal

from fastapi import Depends, Request
from fastapi.responses import JSONResponse
from starlette.responses import Response
from texsss_server.answers import Answer, Answers, matches
from texsss_server.assets import Store
from texsss_server.jobs import Job, Jobs
from texsss_server.metrics import Metrics
from texsss_server.negotiate import preferences
from texsss_server.problems import Problem, of_error, retry_after
from texsss_server.settings import MB, Settings
from texsss_server.turn import BACKGROUND, Turn
from texsss_server.worker import Worker

from texsss.errors import Cancelled, TexsssError
from texsss.scene import Scene

log = logging.getLogger("texsss.server")

LONGEST_WAIT_S = 10


class Service:
    """One service: everything that lives as long as the process. Made on the loop."""

    def __init__(self, settings: Settings):
        self.settings = settings
        self.metrics = Metrics(self)
        self.store = Store(settings)
        self.worker = Worker(
            self._engine, places=settings.queue, jobs=settings.jobs, wait_s=settings.queue_wait_s
        )
        self.answers = Answers(int(settings.answers_mb * MB))
        self.jobs = Jobs(settings, self.worker, self.metrics.stages)
        self.stopping = False
        self._warm_turn = Turn(settings.job_timeout_s, patience=BACKGROUND)
        self._warming: asyncio.Task | None = None

    def start(self) -> None:
        """Starts the render thread; then warms the default scene and the reader of uploads."""
        self.worker.start()
        if self.settings.warm:
            self._warming = asyncio.create_task(self._warm())

    def begin_stop(self) -> None:
        """From now on: not ready, and no new work."""
        self.stopping = True
        if self._warming is not None:
            self._warming.cancel()
            self._warm_turn.stop("stopping")
        for job in self.jobs:
            job.notify()

    def close(self) -> None:
        """Stops what still runs and gives everything back."""
        self.stopping = True
        self.jobs.stop()
        self.worker.close()
        self.store.close()

    @property
    def unready(self) -> Problem | None:
        """Why no work is taken now, None if it is."""
        if self.stopping:
            return retry_after("stopping", "The service is stopping.", 5)
        if self.worker.broken:
            return retry_after("starting", "The service could not start; its log says why.", 30)
        return None if self.worker.ready else retry_after("starting", "The service is starting.", 2)

    def _engine(self):
        gc.disable()  # modules stay: to look for garbage among them takes a fifth of their import
        try:
            from texsss_server.engine import Engine  # imports for seconds: in the render thread
        finally:
            gc.freeze()
            gc.enable()
        return Engine(self.settings, self.store)

    async def _warm(self) -> None:
        """Fills the cache for the default scene, letting every request go first."""
        try:
            await self.worker.run(lambda engine, turn: engine.prepare(Scene(), turn), self._warm_turn)
            await asyncio.to_thread(self.store.warm)
        except (Problem, TexsssError) as error:
            log.info("warming ended early", extra={"reason": str(error)})
        except Exception:
            log.exception("warming broke")

    # how requests are answered

    async def run(self, request: Request, call: Callable, *, drafts_of: str | None = None):
        """What `call` gives, unless the client leaves or time is up. Raises Problem."""
        if self.unready:
            raise self.unready
        turn = Turn(self.settings.render_timeout_s, drafts_of=drafts_of)
        work = asyncio.ensure_future(self.worker.run(call, turn))
        gone = asyncio.ensure_future(_gone(request))
        try:
            left = turn.deadline - time.monotonic()
            await asyncio.wait({work, gone}, timeout=left, return_when=asyncio.FIRST_COMPLETED)
            if work.done():
                return work.result()
            self.worker.stop(turn, "gone" if gone.done() else "timeout")
            work.add_done_callback(_heard)  # a step under way ends later
            raise turn.problem()
        finally:
            gone.cancel()
            self.worker.stop(turn, "gone")
            self.metrics.stages(turn.seconds)

    async def answer(
        self,
        request: Request,
        kind: Literal["render", "bake"] | None,
        tag: str,
        call: Callable[..., Answer],
        drafts_of: str | None = None,
    ) -> Response:
        """The answer of `call` under the ETag `tag`; a job of a `kind` if the client prefers that."""
        is_known = matches(request.headers.getlist("if-none-match"), tag)
        known = None if is_known else self.answers.get(tag)
        if is_known or known is not None:
            self.worker.supersede(drafts_of)
        if is_known:
            return Response(status_code=304, headers=_caching(tag))
        if known is not None:
            self.metrics.hits.inc()
            return success(known, _caching(tag))
        call = _told(call, getattr(request.state, "sent", None))
        wishes = preferences(request)
        if kind is not None and "respond-async" in wishes:
            job = await self._job(request, kind, call, tag, _wait_s(wishes))
            if job.answer is None:
                return _accepted(job)
            known = job.answer
            self.jobs.remove(job)
        else:
            known = await self.run(request, call, drafts_of=drafts_of)
        self.answers.put(tag, known)
        return success(known, _caching(tag) | _timing(known))

    async def _job(
        self,
        request: Request,
        kind: Literal["render", "bake"],
        call: Callable[..., Answer],
        tag: str,
        wait_s: int,
    ) -> Job:
        """A job for `call`, which ends here if that takes at most `wait_s`. Raises Problem."""
        if self.unready:
            raise self.unready
        job = await self.jobs.start(kind, call, tag, self.answers.put)
        if not wait_s:
            return job
        end = asyncio.ensure_future(job.end())
        gone = asyncio.ensure_future(_gone(request))
        await asyncio.wait({end, gone}, timeout=wait_s, return_when=asyncio.FIRST_COMPLETED)
        end.cancel()
        if gone.done() and not job.finished:
            self.jobs.remove(job)  # nobody else knows of it
        gone.cancel()
        if job.problem is not None:
            self.jobs.remove(job)
            raise job.problem
        if job.answer is None and job.turn.reason == "stopping":
            raise job.turn.problem()
        return job


def _accepted(job: Job) -> Response:
    view = job.view()
    headers = {"location": view.links.self, "preference-applied": "respond-async"}
    headers["cache-control"] = "no-store"
    return JSONResponse(view.model_dump(mode="json"), 202, headers)


def _wait_s(wishes: dict[str, str]) -> int:
    """How long a client waits before a job is made of its request (RFC 7240, section 4.3)."""
    told = wishes.get("wait", "")
    return min(int(told), LONGEST_WAIT_S) if re.fullmatch(r"[0-9]{1,6}", told) else 0


def success(answer: Answer, headers: dict[str, str]) -> Response:
    """The bytes of an answer."""
    if answer.filename:
        headers["content-disposition"] = f'inline; filename="{answer.filename}"'
    return Response(answer.body, 200, headers, media_type=answer.media_type)


def _told(call: Callable[..., Answer], sent: Any) -> Callable[..., Answer]:
    """`call`, whose errors are problems that don't repeat what was `sent`."""

    def telling(engine: Any, turn: Turn) -> Answer:
        try:
            return call(engine, turn)
        except Cancelled:
            raise
        except TexsssError as error:
            raise of_error(error, sent) from None

    return telling


def _timing(answer: Answer) -> dict[str, str]:
    """What the stages that ran took."""
    ran = ", ".join(f"{stage};dur={1000 * s:.1f}" for stage, s in answer.seconds.items() if s > 1e-4)
    return {"server-timing": ran} if ran else {}


def _caching(tag: str) -> dict[str, str]:
    return {"etag": tag, "cache-control": "private, max-age=3600", "vary": "Accept"}


def _heard(work: asyncio.Future) -> None:
    """Takes what nobody waits for any more."""
    if not work.cancelled():
        work.exception()


async def _gone(request: Request) -> None:
    """Returns when the client has left; the body was read before."""
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def the_service(request: Request) -> Service:
    """The service of an app, for routes; plain functions would be run in a thread."""
    return request.app.state.service


TheService = Annotated[Service, Depends(the_service)]
