"""One render thread: what waits for it, what may jump the queue, what stops."""

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from texsss_server.problems import Problem, retry_after

from texsss.errors import Cancelled, TexsssError

if TYPE_CHECKING:
    from texsss_server.engine import Engine

PREVIEW, JOB, BACKGROUND = range(3)
"""How long work waits for others; see `Turn`."""

Reason = Literal["gone", "superseded", "timeout", "stopping", "cancelled"]


class Turn:
    """One piece of work on its way: why it must stop, how far it is, what its stages took.

    `patience`: a job lets previews go first at every step, background work lets jobs go first, too; their
    time counts from their start, a preview's from its arrival.
    """

    def __init__(self, timeout_s: float, *, patience: int = PREVIEW, drafts_of: str | None = None):
        self.timeout_s, self.patience, self.drafts_of = timeout_s, patience, drafts_of
        self.deadline = float("inf") if patience else time.monotonic() + timeout_s
        self.reason: Reason | None = None
        self.started = False
        self.stage, self.fraction = "waiting", 0.0
        self.seconds: dict[str, float] = {}
        self.heard: Callable[[], object] = lambda: None
        self.give_way: Callable[[int], None] = lambda patience: None
        self._began: dict[str, float] = {}

    def begin(self) -> None:
        """Called by the render thread when the work starts."""
        self.started = True
        if self.patience:
            self.deadline = time.monotonic() + self.timeout_s

    def stop(self, reason: Reason) -> None:
        """Asks the work to stop; the first reason counts. From any thread."""
        self.reason = self.reason or reason

    def stopped(self) -> bool:
        """Whether to stop; asked by the work between its steps."""
        if self.patience:
            self.give_way(self.patience)
        if time.monotonic() > self.deadline:
            self.stop("timeout")
        return self.reason is not None

    def progress(self, stage: str, fraction: float) -> None:
        """Heard from the work."""
        now = time.monotonic()
        if fraction <= 0:
            self._began[stage] = now
        elif fraction >= 1 and stage in self._began:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._began.pop(stage, now)
        self.stage, self.fraction = stage, fraction
        self.heard()

    def problem(self) -> Problem:
        """The answer to work that stopped."""
        match self.reason:
            case "superseded":
                return Problem("superseded", "A newer draft of the same client was asked for.")
            case "stopping":
                return retry_after("stopping", "The service is stopping; ask again in a moment.", 5)
            case "gone":
                return Problem("client-closed-request", "The client left before the answer.")
            case "cancelled":
                return Problem("job-failed", "The job was cancelled.", state="cancelled")
        detail = f"Expected the work to take at most {self.timeout_s:g} s; ask for less, or for a job."
        return retry_after("render-timeout", detail, 10)


Call = Callable[["Engine", Turn], Any]


@dataclass
class Task:
    call: Call
    turn: Turn
    future: asyncio.Future
    places: asyncio.Semaphore


class Worker:
    """Runs calls one at a time in a thread of its own, previews before jobs.

    `make_engine` runs in that thread, since it imports for seconds. A preview that arrives while a job
    runs is served between two steps of the job.
    """

    def __init__(self, make_engine: Callable[[], "Engine"], *, places: int, jobs: int, wait_s: float):
        self._make_engine, self._wait_s = make_engine, wait_s
        self._places = [asyncio.Semaphore(count) for count in (places, jobs, 1)]
        self._queues: list[deque[Task]] = [deque() for _ in self._places]
        self._wake = threading.Condition()
        self._closing = False
        self._running: list[Task] = []
        self._arriving: list[Turn] = []
        self.engine: Engine | None = None
        self.broken: str | None = None
        self._thread = threading.Thread(target=self._main, name="render", daemon=True)

    def start(self) -> None:
        """Starts the thread; call it on the loop that will await."""
        self._loop = asyncio.get_running_loop()
        self._thread.start()

    @property
    def ready(self) -> bool:
        """Whether calls are served already."""
        return self.engine is not None and not self._closing

    @property
    def waiting(self) -> int:
        """Calls that have not started."""
        return sum(len(queue) for queue in self._queues)

    @property
    def running(self) -> int:
        """Calls that have started: one, and those that it gave way to."""
        return len(self._running)

    @property
    def busy(self) -> bool:
        """Whether anything runs or waits."""
        return bool(self.running or self.waiting)

    async def run(self, call: Call, turn: Turn) -> Any:
        """What `call` gives. Raises Problem: when the queue is full, or `turn` stopped."""
        places = self._places[turn.patience]
        turn.give_way = self._serve_before
        if turn.drafts_of is not None:
            self._supersede(turn.drafts_of)
        self._arriving.append(turn)
        try:
            async with asyncio.timeout(self._wait_s):
                await places.acquire()
        except TimeoutError:
            if turn.reason is not None:
                raise turn.problem() from None
            raise retry_after("queue-full", f"{self.waiting} requests wait already; try again.") from None
        finally:
            self._arriving.remove(turn)
        task = Task(call, turn, self._loop.create_future(), places)
        with self._wake:
            self._queues[turn.patience].append(task)
            self._wake.notify()
        try:
            return await task.future
        except Cancelled:
            raise turn.problem() from None

    def stop(self, turn: Turn, reason: Reason) -> None:
        """Asks the work of a turn to stop; if it only waits, it ends at once. Call it on the loop."""
        turn.stop(reason)
        with self._wake:
            dropped = [task for queue in self._queues for task in queue if task.turn is turn]
            for task in dropped:
                self._queues[turn.patience].remove(task)
        for task in dropped:
            task.places.release()
            _settle(task.future, None, Cancelled("stopped before it started"))

    def stop_all(self, reason: Reason) -> None:
        """Asks everything that runs or waits to stop."""
        with self._wake:
            tasks = [*self._running, *(task for queue in self._queues for task in queue)]
        for task in tasks:
            task.turn.stop(reason)

    def close(self, timeout_s: float = 5.0) -> None:
        """Ends the thread after what runs has stopped."""
        self.stop_all("stopping")
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join(timeout_s)

    def _supersede(self, client: str) -> None:
        with self._wake:
            turns = [task.turn for task in [*self._running, *self._queues[PREVIEW]]] + self._arriving
        for turn in turns:
            if turn.drafts_of == client:
                self.stop(turn, "superseded")

    # in the render thread

    def _main(self) -> None:
        try:
            self.engine = self._make_engine()
        except Exception as error:  # told by /readyz, logged with its trace
            self.broken = type(error).__name__
            raise
        while True:
            with self._wake:
                while not (self.waiting or self._closing):
                    self._wake.wait()
                task = self._next(BACKGROUND + 1)
            if task is None:
                return
            self._do(task)

    def _serve_before(self, patience: int) -> None:
        """Does what is less patient than the work that asks."""
        if threading.current_thread() is not self._thread:
            return  # rooms may ask from threads of their own
        while (task := self._next(patience)) is not None:
            self._do(task)

    def _next(self, below: int) -> Task | None:
        """The least patient task; only this thread takes tasks away."""
        with self._wake:
            return next((queue.popleft() for queue in self._queues[:below] if queue), None)

    def _do(self, task: Task) -> None:
        self._loop.call_soon_threadsafe(task.places.release)
        self._running.append(task)
        try:
            task.turn.begin()
            if task.turn.stopped():
                raise Cancelled("stopped before it started")
            outcome: tuple[Any, BaseException | None] = (task.call(self._engine(), task.turn), None)
        except (Problem, TexsssError) as error:
            outcome = (None, _bare(error))
        except Exception as error:  # kept with its trace, for the log
            outcome = (None, error)
        finally:
            self._running.remove(task)
        self._loop.call_soon_threadsafe(_settle, task.future, *outcome)

    def _engine(self) -> "Engine":
        assert self.engine is not None, "the thread makes it first"
        return self.engine


def _bare(error: Exception) -> Exception:
    """An expected error without the frames that it passed: they hold every tensor of a scene, in cycles."""
    error.__traceback__ = error.__context__ = error.__cause__ = None
    return error


def _settle(future: asyncio.Future, result: Any, error: BaseException | None) -> None:
    if future.done():
        return
    if error is None:
        future.set_result(result)
    else:
        future.set_exception(error)
