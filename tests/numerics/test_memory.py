"""New memory is memory."""

import pytest
import torch

from texsss.numerics.memory import LARGE, room


@pytest.mark.parametrize("count", [0, 1, LARGE // 4, 3 * LARGE // 4 + 5])
def test_room_is_whole_and_its_own(count):
    made, other = (room(torch.zeros(1), count, 2).fill_(fill) for fill in (1.0, 2.0))
    assert made.shape == (count, 2) and made.dtype == torch.float32
    assert bool((made == 1).all()) and bool((other == 2).all())
