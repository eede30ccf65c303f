"""Numbers for the nodes and bricks of a lattice: x, y and z side by side in 64 bits."""

import torch

from texsss.types import Int, Tensor

AXIS = 18  # bits of a key per axis
MASK = (1 << AXIS) - 1


def key_of(x: Tensor, y: Tensor, z: Tensor) -> Int[Tensor, " N"]:
    """The keys of whole numbers of AXIS bits."""
    return (x << AXIS | y) << AXIS | z


def axes_of(key: Int[Tensor, " N"]) -> Int[Tensor, "N 3"]:
    """What keys were made of."""
    return torch.stack([key >> 2 * AXIS, (key >> AXIS) & MASK, key & MASK], 1)


def ascending(key: Int[Tensor, " N"]) -> tuple[Int[Tensor, " N"], Int[Tensor, " N"]]:
    """Keys in ascending order, and where each was."""
    return key.sort(stable=True)


def rotated(key: Int[Tensor, " N"]) -> Int[Tensor, " N"]:
    """Keys whose last axis comes first: x, y, z becomes z, x, y."""
    return key >> AXIS | (key & MASK) << 2 * AXIS


def widened(key: Int[Tensor, " N"], reach: int) -> Int[Tensor, " M"]:
    """All keys within `reach` along the last axis of ascending ones, ascending."""
    fresh = torch.cat([key.new_tensor([2 * reach + 1]), key.diff().clamp_max(2 * reach + 1)])
    first = key + reach + 1 - fresh.cumsum(0)
    return torch.repeat_interleave(first, fresh) + torch.arange(int(fresh.sum()), device=key.device)


def has_near(ascending: Tensor, key: Tensor, reach: int) -> Tensor:
    """Whether any of the `ascending` keys is within `reach` of each key along the last axis."""
    next_one = torch.searchsorted(ascending, key - reach).clamp_max(len(ascending) - 1)
    return (ascending[next_one] - key).abs() <= reach
