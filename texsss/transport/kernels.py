"""A symmetric kernel between the points of one set, a byte for an entry."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from jaxtyping import UInt8

from texsss.numerics.memory import room
from texsss.numerics.sparse import Sparse, starts
from texsss.transport.gutter import entries, with_rim
from texsss.transport.loops import call, products
from texsss.types import Float, Int, Tensor

WHOLE = 255  # that weights are counted in: the weight of a point's own value
STRIP = 16  # rows whose entries stand side by side


@dataclass(frozen=True, eq=False)
class Kernel:
    """The mean y_i = Σ_j w_ij A_j x_j / Σ_j w_ij A_j over points of one set, w_ij = w_ji.

    Points of a texture follow each other, and so do their neighbours: of a strip of rows, entries as far
    from the middle as each other make a diagonal. `start` (S + 1): where diagonals of each strip begin;
    `distance` (D,): from row to column; `weight` (D, STRIP), in parts of WHOLE. `area` A (P,) [mm²]; `share`
    (P,): 1 / Σ_j w_ij A_j.
    """

    start: Int[Tensor, " starts"]
    distance: Int[Tensor, " D"]
    weight: UInt8[Tensor, "D STRIP"]
    area: Float[Tensor, " P"]
    share: Float[Tensor, " P"]

    @property
    def bytes(self) -> int:
        """Memory that the entries take."""
        held = self.start, self.distance, self.weight, self.share
        return sum(part.numel() * part.element_size() for part in held)

    def times(
        self,
        x: Float[Tensor, "P C"],
        out: Float[Tensor, "P C"] | None = None,
        planes: "Planes | None" = None,
    ) -> Float[Tensor, "P C"]:
        """The mean of the columns of `x`, without gradients; in `out`, contiguous, if there is one.

        `planes`: where `x` times area is kept for other kernels of the same points.
        """
        return self._scaled(x, self.area, self.share, out, planes or Planes())

    def back(self, x: Float[Tensor, "Q C"], to: Float[Tensor, "P C"], rim: Sparse | None = None) -> None:
        """Adds the transpose of `times` to what is in `to`, contiguous.

        `rim`: the matrix (P, Q - P) by which points first get what is behind them in `x`; else Q is P.
        """
        self._scaled(x, self.share, self.area, to, Planes(), rim, added=True)

    def _scaled(
        self,
        x: Tensor,
        before: Tensor,
        after: Tensor,
        out: Tensor | None,
        planes: "Planes",
        rim: Sparse | None = None,
        *,
        added: bool = False,
    ) -> Tensor:
        found = products(x, before, after)
        points, count = len(before), x.shape[1]
        result = x.new_empty(points, count) if out is None else out
        if found is None:
            (x,) = with_rim([x], rim)
            made = self._plain.times(x * before[:, None].to(x)) * after[:, None].to(x)
            return result.add_(made) if added else result.copy_(made)
        fresh = planes.held is None
        if planes.held is None:
            planes.held = room(x, count, points + 2 * STRIP)
        matrix = points, self.start, self.distance, self.weight, before, after
        args = *matrix, x if fresh else None, count, *x.stride(), *entries(rim), planes.held
        call(found.kernel_times, *args, result, int(added))
        return result

    @cached_property
    def _plain(self) -> Sparse:
        """The weights, for torch."""
        strip = torch.arange(len(self.start) - 1, device=self.start.device) * STRIP
        strip = strip.repeat_interleave(self.start.diff().long())
        along = strip[:, None] + torch.arange(STRIP, device=self.weight.device)
        there = self.weight != 0
        row, column = along[there], (along + self.distance[:, None])[there]
        order = torch.argsort(row, stable=True)
        counts = torch.bincount(row, minlength=len(self.area))
        weight = self.weight[there][order].to(self.area)
        return Sparse(starts(counts), column[order].int(), weight, len(self.area))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_plain"}


class Planes:
    """Columns times area, with zeros around them, once they are made."""

    def __init__(self) -> None:
        self.held: Tensor | None = None


def kernel_of(
    start: Int[Tensor, " starts"],
    column: Int[Tensor, " M"],
    weight: Float[Tensor, " M"],
    area: Float[Tensor, " P"],
) -> Kernel:
    """The kernel of weights 0 to 1 in compressed rows, symmetric, 1 for a point itself."""
    count = start.diff().long()
    row = torch.arange(len(count), device=count.device).repeat_interleave(count)
    whole = (weight * WHOLE).round()
    total = torch.zeros_like(area).index_add_(0, row, whole * area[column])
    points, strips = len(area), -(-len(area) // STRIP)
    key = row // STRIP * (2 * points) + column - row + points
    key, place = torch.unique(key, return_inverse=True)
    weights = torch.zeros(len(key), STRIP, dtype=torch.uint8, device=area.device)
    weights[place, row % STRIP] = whole.to(torch.uint8)
    begin = starts(torch.bincount(key // (2 * points), minlength=strips))
    return Kernel(begin, (key % (2 * points) - points).int(), weights, area, 1 / total)
