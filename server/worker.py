"""One render thread: what waits for it, what may jump the queue, what stops."""

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from texsss_server.problems import Problem, retry_after
from texsss_server.turn import BACKGROUND, JOB, PREVIEW, Reason, Turn

from texsss.errors import Cancelled, TexsssError

if TYPE_CHECKING:
    from texsss_server.engine import Engine

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
        return self.engine is not None and self._thread.is_alive() and not self._closing

    @property
    def waiting(self) -> int:
        """Calls that have not started, those included that wait for a place."""
        return sum(len(queue) for queue in self._queues) + len(self._arriving)

    @property
    def running(self) -> int:
        """Calls that have started: one, and those that it gave way to."""
        return len(self._running)

    @property
    def busy(self) -> bool:
        """Whether anything runs or waits."""
        return self._thread.is_alive() and bool(self.running or self.waiting)

    async def run(self, call: Call, turn: Turn) -> Any:
        """What `call` gives. Raises Problem: when the queue is full, or `turn` stopped."""
        places = self._places[turn.patience]
        turn.give_way = self._serve_before
        if not self._inherits(turn):
            await self._place(places, turn)
        if turn.reason is not None:
            places.release()
            raise turn.problem()
        self.supersede(turn.drafts_of, before=turn.number)
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

    def supersede(self, client: str | None, *, before: int | None = None) -> None:
        """Stops a client's drafts, those older than the turn of the number `before` only. On the loop."""
        if client is None:
            return
        with self._wake:
            turns = [task.turn for task in [*self._running, *self._queues[PREVIEW]]] + self._arriving
        for turn in turns:
            if turn.drafts_of == client and (before is None or turn.number < before):
                self.stop(turn, "superseded")

    def _inherits(self, turn: Turn) -> bool:
        """Whether a draft takes the place of an older one of its client that waits."""
        if turn.drafts_of is None:
            return False
        queue = self._queues[PREVIEW]
        with self._wake:
            older = next((task for task in queue if task.turn.drafts_of == turn.drafts_of), None)
            if older is None:
                return False
            queue.remove(older)
        older.turn.stop("superseded")
        _settle(older.future, None, Cancelled("superseded before it started"))
        return True

    async def _place(self, places: asyncio.Semaphore, turn: Turn) -> None:
        """Takes a place in the queue. Raises Problem: when none is free for a while."""
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

    # in the render thread

    def _main(self) -> None:
        try:
            self.engine = self._make_engine()
            while not self._closing or any(self._queues):
                with self._wake:
                    while not (any(self._queues) or self._closing):
                        self._wake.wait()
                self._do_next(BACKGROUND + 1)
        except BaseException as error:  # told by /readyz, logged with its trace
            self.broken = type(error).__name__
            raise

    def _serve_before(self, turn: Turn) -> None:
        """Does what is less patient than the work that asks."""
        if threading.current_thread() is not self._thread:
            return  # rooms may ask from threads of their own
        start = time.monotonic()
        while turn.may_wait and self._do_next(turn.patience):
            turn.gave_way(time.monotonic() - start)
            start = time.monotonic()

    def _do_next(self, below: int) -> bool:
        """Does a task less patient than `below`, if there is one; nothing of it is held afterwards.

        Jobs begin at once: they let previews go first by themselves, but not for ever.
        """
        with self._wake:
            queues = [self._queues[patience] for patience in (JOB, PREVIEW, BACKGROUND) if patience < below]
            task = next((queue.popleft() for queue in queues if queue), None)
            if task is not None:
                self._running.append(task)  # at once: it is never in neither list
        if task is not None:
            self._do(task)
        return task is not None

    def _do(self, task: Task) -> None:
        self._loop.call_soon_threadsafe(task.places.release)
        try:
            task.turn.begin()
            if task.turn.stopped():
                raise Cancelled("stopped before it started")
            outcome: tuple[Any, BaseException | None] = (task.call(self._engine(), task.turn), None)
        except (Problem, TexsssError) as error:
            outcome = (None, bare(error))
        except Exception as error:  # kept with its trace, for the log
            outcome = (None, error)
        except BaseException as error:  # would end the loop that it is handed to
            outcome = (None, RuntimeError(f"{type(error).__name__} in the render thread"))
        finally:
            self._running.remove(task)
        self._loop.call_soon_threadsafe(_settle, task.future, *outcome)

    def _engine(self) -> "Engine":
        assert self.engine is not None, "the thread makes it first"
        return self.engine


def bare(error: Exception) -> Exception:
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
