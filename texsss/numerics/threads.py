"""Independent pieces of work on all cores, one thread each."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import torch


def in_threads(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """`work(item)` of every item, in order, on as many threads as torch uses.

    torch lets go of the interpreter while it computes, so that threads overlap; each of them keeps to
    itself, which spares operations on small tensors from waiting for each other. Without gradients.
    The first exception ends it.
    """
    threads = torch.get_num_threads()
    if threads < 2:
        with torch.no_grad():
            return [work(item) for item in items]

    def detached(item: Any) -> Any:
        with torch.no_grad():  # a mode of the thread
            return work(item)

    pool = ThreadPoolExecutor(max(min(threads, len(items)), 1), initializer=partial(torch.set_num_threads, 1))
    try:
        return [future.result() for future in [pool.submit(detached, item) for item in items]]
    finally:
        pool.shutdown(cancel_futures=True)
        torch.set_num_threads(threads)
