"""Convolutions along one axis of a lattice of which only some nodes exist, eight bytes per node."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch

from texsss.numerics.sparse import Sparse, starts
from texsss.transport.loops import call, making, products
from texsss.types import Float, Int, Tensor

MOST_TAPS = 32  # bits of a mask


@dataclass(frozen=True, eq=False)
class Runs:
    """The matrix whose row i has `taps[b]`, for every bit b of `mask[i]`, at columns from `first[i]` on.

    Nodes that a row adds up follow each other.
    """

    first: Int[Tensor, " rows"]
    mask: Int[Tensor, " rows"]
    taps: Float[Tensor, " taps"]
    columns: int

    @property
    def bytes(self) -> int:
        """Memory that the rows take."""
        return 8 * len(self.first)

    def times(self, x: Float[Tensor, "columns C"], out: Float[Tensor, "rows C"] | None = None) -> Tensor:
        """The product (rows, C) with the columns of `x`, without gradients; in `out`, if there is one."""
        found = products(x, self.taps)
        if found is None:
            made = self._plain.times(x)
            return made if out is None else out.copy_(made)
        x = x if x.stride(1) == 1 else x.contiguous()
        made = x.new_empty(len(self.first), x.shape[1]) if out is None else out
        taps = torch.nn.functional.pad(self.taps, (0, MOST_TAPS - len(self.taps)))
        args = len(self.first), self.columns, self.first, self.mask, taps
        call(found.runs_times, *args, x, x.stride(0), x.shape[1], made, made.stride(0))
        return made

    @cached_property
    def _plain(self) -> Sparse:
        """The matrix, for torch."""
        bit = torch.arange(len(self.taps), dtype=torch.int32, device=self.mask.device)
        there = (self.mask[:, None] >> bit & 1).bool()
        column = self.first[:, None] + there.int().cumsum(1) - 1
        taps = self.taps.expand(len(self.first), -1)[there]
        return Sparse(starts(there.sum(1)), column[there].int(), taps, self.columns)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_plain"}


def runs(source: Int[Tensor, " S"], target: Int[Tensor, " T"], taps: Float[Tensor, " taps"]) -> Runs:
    """The convolution with `taps` from the ascending keys `source` to the keys `target`.

    Along the last axis of keys, where steps of 1 are from node to node.
    """
    assert len(taps) <= MOST_TAPS, "lattices are no finer"
    reach = len(taps) // 2
    found = making(taps)
    if found is not None:
        first, mask = torch.empty(2, len(target), dtype=torch.int32).unbind(0)
        call(found.runs, len(source), source, len(target), target, reach, first, mask)
        return Runs(first, mask, taps, len(source))
    first = torch.searchsorted(source, target - reach)
    mask = torch.zeros_like(target)
    for tap in range(len(taps)):
        at = target + (tap - reach)
        there = torch.searchsorted(source, at).clamp_max(len(source) - 1)
        mask |= (source[there] == at).long() << tap
    return Runs(first.int(), mask.to(torch.int32), taps, len(source))
