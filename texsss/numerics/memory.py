"""New memory for large results."""

import ctypes
import sys
from functools import cache
from typing import Any

from texsss.types import Tensor

LARGE = 1 << 22  # bytes, from which large pages are asked for
PAGE = 1 << 21
MADV_HUGEPAGE = 14  # of Linux


def room(like: Tensor, *shape: int) -> Tensor:
    """An undefined tensor of `shape`, in large pages where it is large and the system has some.

    To touch new memory page by page takes as long as many a loop that fills it.
    """
    made = like.new_empty(*shape)
    size, first = made.numel() * made.element_size(), made.data_ptr()
    advise = _advise()
    if size >= LARGE and made.device.type == "cpu" and advise is not None:
        start, end = -(-first // PAGE) * PAGE, (first + size) // PAGE * PAGE
        advise(ctypes.c_void_p(start), ctypes.c_size_t(end - start), MADV_HUGEPAGE)
    return made


@cache
def _advise() -> Any:
    return ctypes.CDLL(None).madvise if sys.platform == "linux" else None
