"""A symmetric kernel between the points of one set, two bytes for most of its entries."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch

from texsss.numerics.memory import room
from texsss.numerics.sparse import Sparse, starts
from texsss.transport.loops import call, products
from texsss.types import Float, Int, Tensor

WHOLE = (1 << 15) - 1  # that weights are counted in: the weight of a point's own value
STRIP = 16  # rows whose entries stand side by side
ALIKE = 3  # rows of a strip, at the least, for which a diagonal pays
NEAR = 1 << 16  # points; diagonals are no farther from the middle


@dataclass(frozen=True, eq=False)
class Kernel:
    """The mean y_i = Σ_j w_ij A_j x_j / Σ_j w_ij A_j over points of one set, w_ij = w_ji.

    Points of a texture follow each other, and so do their neighbours: of a strip of rows, entries as far
    from the middle as each other make a diagonal. `start` (S + 1): where diagonals of each strip begin;
    `distance` (D,): from row to column; `weight` (D, STRIP), in parts of WHOLE. What is left are single
    entries: `single` (S + 1): where they begin; `lane`, `column`, `single_weight` (M,): row within the strip,
    point and weight. `area` A (P,) [mm²]; `share` (P,): 1 / Σ_j w_ij A_j.
    """

    start: Int[Tensor, " starts"]
    distance: Int[Tensor, " D"]
    weight: Int[Tensor, "D STRIP"]
    single: Int[Tensor, " starts"]
    lane: Int[Tensor, " M"]
    column: Int[Tensor, " M"]
    single_weight: Int[Tensor, " M"]
    area: Float[Tensor, " P"]
    share: Float[Tensor, " P"]

    @property
    def bytes(self) -> int:
        """Memory that the entries take."""
        return sum(part.numel() * part.element_size() for part in (*self._entries, self.share))

    @property
    def _entries(self) -> tuple[Tensor, ...]:
        diagonals = self.start, self.distance, self.weight
        return *diagonals, self.single, self.lane, self.column, self.single_weight

    def times(self, x: Float[Tensor, "P C"], out: Float[Tensor, "P C"] | None = None) -> Float[Tensor, "P C"]:
        """The mean of the columns of `x`, without gradients; in `out`, contiguous, if there is one."""
        return self._scaled(x, self.area, self.share, out)

    def back(self, x: Float[Tensor, "P C"]) -> Float[Tensor, "P C"]:
        """The transpose of `times`."""
        return self._scaled(x, self.share, self.area)

    def _scaled(self, x: Tensor, before: Tensor, after: Tensor, out: Tensor | None = None) -> Tensor:
        found = products(x, before, after)
        if found is None:
            made = self._plain.times(x * before[:, None].to(x)) * after[:, None].to(x)
            return made if out is None else out.copy_(made)
        x, (points, count) = x.contiguous(), x.shape
        result = torch.empty_like(x) if out is None else out
        scaled = room(x, count, points + 2 * self._margin + STRIP)
        args = points, self._margin, *self._entries, before, after, x, count, scaled
        call(found.kernel_times, *args, result)
        return result

    @cached_property
    def _margin(self) -> int:
        """How far diagonals reach beyond the points."""
        return int(self.distance.abs().amax()) if len(self.distance) else 0

    @cached_property
    def _plain(self) -> Sparse:
        """The weights, for torch."""
        count = [at.diff().long() for at in (self.start, self.single)]
        strip = [torch.arange(len(n), device=n.device).repeat_interleave(n) * STRIP for n in count]
        along = strip[0][:, None] + torch.arange(STRIP, device=self.weight.device)
        there = self.weight != 0
        row = torch.cat([along[there], strip[1] + self.lane])
        column = torch.cat([(along + self.distance[:, None])[there], self.column])
        weight = torch.cat([self.weight[there], self.single_weight]).to(self.area)
        order = torch.argsort(row, stable=True)
        counts = torch.bincount(row, minlength=len(self.area))
        return Sparse(starts(counts), column[order].int(), weight[order], len(self.area))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_plain"}


def kernel_of(
    start: Int[Tensor, " starts"],
    column: Int[Tensor, " M"],
    weight: Float[Tensor, " M"],
    area: Float[Tensor, " P"],
) -> Kernel:
    """The kernel of weights 0 to 1 in compressed rows, symmetric, 1 for a point itself."""
    count = start.diff().long()
    row = torch.arange(len(count), device=count.device).repeat_interleave(count)
    whole = (weight * WHOLE).round().to(torch.int16)
    total = torch.zeros_like(area).index_add_(0, row, whole * area[column])
    away, strip, lane = column - row, row // STRIP, row % STRIP
    strips = -(-len(area) // STRIP)
    near = away.abs() < NEAR
    key = (strip * 2 * NEAR + away + NEAR)[near]
    key, place, alike = torch.unique(key, return_inverse=True, return_counts=True)
    pays = alike >= ALIKE
    place = (pays.cumsum(0) - 1)[place].where(pays[place], -1)
    place = torch.full_like(row, -1).masked_scatter(near, place)
    key, along = key[pays], place >= 0
    weights = whole.new_zeros(len(key), STRIP)
    weights[place[along], lane[along]] = whole[along]
    begin = [torch.bincount(of, minlength=strips) for of in (key // (2 * NEAR), strip[~along])]
    left = lane[~along].to(torch.int16), column[~along].int(), whole[~along]
    distance = (key % (2 * NEAR) - NEAR).int()
    return Kernel(starts(begin[0]), distance, weights, starts(begin[1]), *left, area, 1 / total)
