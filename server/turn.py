"""Work on its way through the render thread: when it must stop, whom it lets go first, what it took."""

import time
from collections.abc import Callable
from itertools import count
from typing import Literal

from texsss_server.problems import Problem, retry_after

PREVIEW, JOB, BACKGROUND = range(3)
"""How long work waits for others; see `Turn`."""

CREDIT_S = 2.0  # that previews may take from a job at once
OTHERS = 4  # seconds that they may take for each of its own
_NUMBERS = count()

Reason = Literal["gone", "superseded", "timeout", "stopping", "cancelled"]


class Turn:
    """One piece of work on its way: why it must stop, how far it is, what its stages took.

    `patience`: a job lets previews go first at every step, for four fifths of the time at most; background
    work lets jobs go first, too. Their time counts from their start, a preview's from its arrival.
    """

    def __init__(self, timeout_s: float, *, patience: int = PREVIEW, drafts_of: str | None = None):
        self.timeout_s, self.patience, self.drafts_of = timeout_s, patience, drafts_of
        self.deadline = float("inf") if patience else time.monotonic() + timeout_s
        self.reason: Reason | None = None
        self.started = False
        self.stage, self.fraction = "waiting", 0.0
        self.seconds: dict[str, float] = {}
        self.heard: Callable[[], object] = lambda: None
        self.give_way: Callable[[Turn], None] = lambda turn: None
        self.number = next(_NUMBERS)
        self._began: dict[str, float] = {}
        self._start = self._away = 0.0

    def begin(self) -> None:
        """Called by the render thread when the work starts."""
        self.started, self._start = True, time.monotonic()
        if self.patience:
            self.deadline = self._start + self.timeout_s

    @property
    def may_wait(self) -> bool:
        """Whether others may go first: background work always waits, a job most of the time."""
        if self.patience == BACKGROUND:
            return True
        own = time.monotonic() - self._start - self._away
        return self._away <= CREDIT_S + OTHERS * own

    def gave_way(self, seconds: float) -> None:
        """Notes that others took so long meanwhile: it counts neither for the deadline nor for the stages."""
        self._away += seconds
        self.deadline += seconds
        self._began = {stage: began + seconds for stage, began in self._began.items()}

    def stop(self, reason: Reason) -> None:
        """Asks the work to stop; the first reason counts. From any thread."""
        self.reason = self.reason or reason

    def stopped(self) -> bool:
        """Whether to stop; asked by the work between its steps."""
        if self.patience:
            self.give_way(self)
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
        instead = "ask for less" if self.patience else "ask for less, or for a job"
        detail = f"Expected the work to take at most {self.timeout_s:g} s; {instead}."
        return retry_after("render-timeout", detail, 10)
