"""A symmetric kernel between the points of one set, four bytes for most of its entries."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch

from texsss.numerics.sparse import Sparse, starts
from texsss.transport.loops import call, products
from texsss.types import Float, Int, Tensor

WHOLE = (1 << 15) - 1  # that weights are counted in: the weight of a point's own value
NEAR = 1 << 15  # points; closer ones are named by their distance in 16 bits


@dataclass(frozen=True, eq=False)
class Entries:
    """Where entries of rows begin (P + 1), which point each is of (M), and its weight in parts of WHOLE (M)."""

    start: Int[Tensor, " starts"]
    point: Int[Tensor, " M"]
    weight: Int[Tensor, " M"]


@dataclass(frozen=True, eq=False)
class Kernel:
    """The mean y_i = Σ_j w_ij A_j x_j / Σ_j w_ij A_j over points of one set, w_ij = w_ji.

    `near`: entries less than NEAR points away, `point` is how far; `far`: all others. `area` A (P,) [mm²];
    `share` (P,): 1 / Σ_j w_ij A_j.
    """

    near: Entries
    far: Entries
    area: Float[Tensor, " P"]
    share: Float[Tensor, " P"]

    @property
    def bytes(self) -> int:
        """Memory that the entries take."""
        held = (part for way in (self.near, self.far) for part in (way.start, way.point, way.weight))
        return sum(part.numel() * part.element_size() for part in (*held, self.share))

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
        x = x.contiguous()
        held = (part for way in (self.near, self.far) for part in (way.start, way.point, way.weight))
        result, scaled = torch.empty_like(x) if out is None else out, torch.empty_like(x)
        call(found.kernel_times, len(x), *held, before, after, x, x.shape[1], scaled, result)
        return result

    @cached_property
    def _plain(self) -> Sparse:
        """The weights, for torch."""
        count = [way.start.diff().long() for way in (self.near, self.far)]
        row = [torch.arange(len(self.area), device=n.device).repeat_interleave(n) for n in count]
        column = torch.cat([row[0] + self.near.point, self.far.point])
        order = torch.argsort(torch.cat(row), stable=True)
        weight = torch.cat([self.near.weight, self.far.weight]).to(self.area)
        return Sparse(starts(count[0] + count[1]), column[order].int(), weight[order], len(self.area))

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
    away = column.long() - row
    near = away.abs() < NEAR
    ways = []
    for kept, point in ((near, away.to(torch.int16)), (~near, column)):
        here = torch.bincount(row[kept], minlength=len(count))
        ways.append(Entries(starts(here), point[kept], whole[kept]))
    return Kernel(ways[0], ways[1], area, 1 / total)
