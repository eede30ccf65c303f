"""Independent pieces of work on all cores, one thread each."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import Any

import torch

from texsss.types import Cancel, check_cancelled

ASK_S = 0.02  # between questions whether to stop


def in_threads(
    work: Callable[[Any], Any],
    items: Sequence[Any],
    cancel: Cancel | None = None,
    *,
    graded: bool = False,
    alone: bool = False,
) -> list[Any]:
    """`work(item)` of every item, in order, on as many threads as torch uses.

    torch lets go of the interpreter while it computes, so that threads overlap; each of them keeps to
    itself, which spares operations on small tensors from waiting for each other. Without gradients,
    unless they are asked for (`graded`): then in this thread alone, as what is done sooner than threads
    start (`alone`) and what is but one piece. The first exception ends it. `cancel` is asked in this thread,
    between items or all the while. Raises Cancelled.
    """
    if graded and torch.is_grad_enabled():
        return [_asked(work, item, cancel) for item in items]
    threads = torch.get_num_threads()
    if alone or threads < 2 or len(items) < 2:
        with torch.no_grad():
            return [_asked(work, item, cancel) for item in items]

    def detached(item: Any) -> Any:
        with torch.no_grad():  # a mode of the thread
            return work(item)

    pool = ThreadPoolExecutor(max(min(threads, len(items)), 1), initializer=_alone)
    try:
        futures = [pool.submit(detached, item) for item in items]
        while cancel is not None and wait(futures, ASK_S, FIRST_EXCEPTION).not_done:
            if any(future.done() and future.exception() for future in futures):
                break
            check_cancelled(cancel)
        return [future.result() for future in futures]
    finally:
        pool.shutdown(cancel_futures=True)
        torch.set_num_threads(threads)


def _asked(work: Callable[[Any], Any], item: Any, cancel: Cancel | None) -> Any:
    check_cancelled(cancel)
    return work(item)


def _alone() -> None:
    """One thread for each of ours; asked back, so that torch settles it here and now."""
    torch.set_num_threads(1)
    torch.get_num_threads()
