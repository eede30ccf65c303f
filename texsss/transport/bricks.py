"""Convolutions along the axes of a lattice of which only some nodes exist, in bricks of 4 × 4 × 4."""

from dataclasses import dataclass

import torch
from torch.nn.functional import pad

from texsss.transport.keys import ascending, has_near, rotated, widened
from texsss.transport.loops import Scratch, call, products
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled, chunks

SIDE = 4  # nodes of a brick along an axis
NODES = SIDE**3
NOWHERE = -1  # in place of a brick that is not there
CHUNK = 1 << 12  # bricks at once, by torch


@dataclass(frozen=True, eq=False)
class Bricks:
    """Where the nodes of a lattice are.

    `key` (B,): of every brick, ascending, z fastest. `start` (B + 1): where the nodes of each begin; `place`
    (N,): of every node in its brick, counted along x, then y, then z.
    """

    key: Int[Tensor, " B"]
    start: Int[Tensor, " starts"]
    place: Int[Tensor, " N"]

    @property
    def bytes(self) -> int:
        """Memory that it takes."""
        return 8 * len(self.key) + 4 * len(self.start) + len(self.place)


@dataclass(frozen=True, eq=False)
class Blur:
    """A Gaussian between the nodes of a lattice, along z, y and x in turn, which is its own transpose.

    In between there are as many bricks as it takes for no way to be missing. Each of `turns` (T, 2 r + 1):
    the bricks, or NOWHERE, from which T bricks are made; within these, axes change places, so that the next
    one comes first. `last` (B,): which bricks the last turn makes.
    """

    bricks: Bricks
    turns: tuple[Int[Tensor, "_ around"], ...]
    last: Int[Tensor, " B"]
    taps: Float[Tensor, " taps"]

    @property
    def bytes(self) -> int:
        """Memory that it takes, the bricks beside."""
        return 4 * (sum(near.numel() for near in self.turns) + len(self.last))

    def times(
        self,
        x: Float[Tensor, "N C"],
        out: Float[Tensor, "N C"] | None = None,
        scratch: Scratch | None = None,
        *,
        added: bool = False,
    ) -> Float[Tensor, "N C"]:
        """`x` convolved, without gradients; in `out`, if there is one, or `added` to what is there."""
        count, bricks = x.shape[1], self.bricks
        found = products(x, self.taps)
        made = x.new_empty(x.shape) if out is None else out
        if found is None:
            convolved = self._plain(x)
            return made.add_(convolved) if added else made.copy_(convolved)
        x = x if x.stride(1) == 1 else x.contiguous()
        first, second, last = self.turns
        even = max(len(bricks.key), len(second))
        held = (scratch or Scratch(x)).parts((even * NODES * count, len(first) * NODES * count))
        sizes = len(bricks.key), len(first), len(second), first.shape[1], len(self.taps) // 2, count
        where = bricks.start, bricks.place, first, second, last, self.last
        ways = x, x.stride(0), made, made.stride(0), int(added)
        call(found.bricks_times, *sizes, *where, pad(self.taps, (SIDE, SIDE)), *held, *ways)
        return made

    def _plain(self, x: Float[Tensor, "N C"]) -> Float[Tensor, "N C"]:
        """The same by torch."""
        bricks, count = self.bricks, x.shape[1]
        row = torch.arange(len(bricks.key), device=x.device).repeat_interleave(bricks.start.diff().long())
        row = row * NODES + bricks.place.long()
        held = x.new_zeros(len(bricks.key) * NODES, count).index_copy_(0, row, x)
        for near in self.turns:
            held = self._turned(held, near)
        order = torch.argsort(self.last.long())
        return held.view(-1, NODES, count)[order].view(-1, count)[row]

    def _turned(self, held: Float[Tensor, "rows C"], near: Int[Tensor, "T around"]) -> Tensor:
        """One turn."""
        around, count, reach = near.shape[1], held.shape[1], len(self.taps) // 2
        bricks = torch.cat([held, held.new_zeros(NODES, count)]).view(-1, SIDE, SIDE * SIDE * count)
        # from what node of the row of bricks to what node of the one in the middle
        step = torch.arange(SIDE * around) - around // 2 * SIDE - torch.arange(SIDE)[:, None]
        there = step.abs() <= reach
        matrix = torch.where(there, self.taps.cpu()[(step + reach).clamp(0, 2 * reach)], 0).to(held)
        made = [
            torch.matmul(matrix, bricks[near[rows].long()].view(-1, SIDE * around, SIDE * SIDE * count))
            .view(-1, SIDE, SIDE * SIDE, count)
            .transpose(1, 2)
            .reshape(-1, count)
            for rows in chunks(len(near), CHUNK)
        ]
        return torch.cat(made)


def blur_of(bricks: Bricks, taps: Float[Tensor, " taps"], cancel: Cancel | None = None) -> Blur:
    """The convolution with `taps` along all three axes. Raises Cancelled."""
    reach = -(-(len(taps) // 2) // SIDE)
    # z first, then y, and x at last; the last axis of a key is the one whose turn it is
    after_z = widened(bricks.key, reach)
    before_x = widened(ascending(rotated(rotated(bricks.key)))[0], reach)
    check_cancelled(cancel)
    # what is on no way from node to node along y
    after_z, before_x = ascending(rotated(after_z))[0], ascending(rotated(rotated(before_x)))[0]
    after_z, before_x = (
        after_z[has_near(before_x, after_z, reach)],
        before_x[has_near(after_z, before_x, reach)],
    )
    check_cancelled(cancel)
    between = ascending(rotated(rotated(after_z)))[0]
    end, last = ascending(rotated(rotated(bricks.key)))
    turns = (
        _turn(bricks.key, between, reach),
        _turn(rotated(between), before_x, reach),
        _turn(rotated(before_x), end, reach),
    )
    return Blur(bricks, turns, last.int(), taps)


def _turn(source: Int[Tensor, " S"], target: Int[Tensor, " T"], reach: int) -> Int[Tensor, "T around"]:
    """From bricks in the order of `source` to those of the ascending `target`, along the last axis."""
    key, order = ascending(source)
    asked = target[:, None] + torch.arange(-reach, reach + 1, device=target.device)
    at = torch.searchsorted(key, asked).clamp_max(len(key) - 1)
    return torch.where(key[at] == asked, order[at], NOWHERE).int()
