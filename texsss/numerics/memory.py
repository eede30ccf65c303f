"""New memory for large results."""

import ctypes
import math
import mmap
import sys
import weakref
from contextlib import suppress
from threading import RLock

import torch

from texsss.types import Tensor

LARGE = 1 << 22  # bytes, from which large pages are asked for
PAGE = 1 << 21
KEPT = 1 << 28  # bytes that wait for the next result, at most
WASTE = 1.25  # times as large as what is asked for may be what waited


def room(like: Tensor, *shape: int) -> Tensor:
    """An undefined tensor of `shape`, in large pages where it is large and the system has some.

    To touch new memory takes as long as many a loop that fills it, as the system clears it first; so memory
    of large tensors that are gone waits for the next ones.
    """
    size = math.prod(shape) * like.element_size()
    own = size >= LARGE and like.device.type == "cpu" and sys.platform == "linux"
    held = _WAITING.take(size) if own else None
    if held is None:
        return like.new_empty(*shape)
    storage = torch.frombuffer(held, dtype=torch.uint8).untyped_storage()
    return like.new_empty(0).set_(storage).resize_(shape)  # no view, which autograd would refuse to change


class _Waiting:
    """Blocks of memory that nobody uses any more."""

    def __init__(self) -> None:
        self.lock = RLock()  # what is collected meanwhile may come back
        self.blocks: list[mmap.mmap] = []

    def take(self, size: int) -> memoryview | None:
        """`size` bytes, which come back when all who hold them are gone; None if the system has none."""
        with self.lock:
            fit = [block for block in self.blocks if size <= len(block) - PAGE <= WASTE * size]
            block = min(fit, key=len, default=None)
            self.blocks = [other for other in self.blocks if other is not block]
        try:
            block = _mapped(size) if block is None else block
        except OSError:
            return None
        first = _start(block)
        view = memoryview(block)[first : first + size]
        weakref.finalize(view, self.give, block).atexit = False
        return view

    def give(self, block: mmap.mmap) -> None:
        """Keeps a block, and lets go those that have waited longest where they become too many."""
        with self.lock:
            self.blocks.append(block)
            while sum(map(len, self.blocks)) > KEPT:
                self.blocks.pop(0)


def _mapped(size: int) -> mmap.mmap:
    """New memory for `size` bytes that begin with a large page. Raises OSError when there is none."""
    block = mmap.mmap(-1, -(-size // PAGE) * PAGE + PAGE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    with suppress(OSError):  # systems without large pages
        block.madvise(mmap.MADV_HUGEPAGE, _start(block), len(block) - PAGE)
    return block


def _start(block: mmap.mmap) -> int:
    """Where its first large page begins."""
    return -ctypes.addressof(ctypes.c_char.from_buffer(block)) % PAGE


_WAITING = _Waiting()
