"""New memory is memory."""

import gc
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch

from texsss.numerics import memory
from texsss.numerics.memory import KEPT, LARGE, room


@pytest.mark.parametrize("count", [0, 1, LARGE // 4, 3 * LARGE // 4 + 5])
def test_room_is_whole_and_its_own(count):
    made, other = (room(torch.zeros(1), count, 2).fill_(fill) for fill in (1.0, 2.0))
    assert made.shape == (count, 2) and made.dtype == torch.float32
    assert bool((made == 1).all()) and bool((other == 2).all())


def test_what_lives_is_not_given_to_others():
    """Views and gradients hold their memory; many threads at once get some each."""
    like = torch.zeros(1, dtype=torch.float64)
    seen = room(like, LARGE).fill_(3)[::7]

    def used(fill: int) -> bool:
        held = [room(like, LARGE // 8 + 7 * fill).fill_(fill + k) for k in range(3)]
        return all(bool((part == fill + k).all()) for k, part in enumerate(held))

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(used, range(24)))
    assert bool((seen == 3).all())


def test_memory_that_is_done_with_is_used_again_and_bounded():
    gc.collect()
    first = room(torch.zeros(1), LARGE)
    place = first.data_ptr()
    other = room(torch.zeros(1), LARGE)
    del first
    assert room(torch.zeros(1), LARGE).data_ptr() == place != other.data_ptr()
    several = [room(torch.zeros(1), KEPT // 16) for _ in range(6)]  # half as much again
    del several, other
    assert 0 < sum(map(len, memory._WAITING.blocks)) <= KEPT
