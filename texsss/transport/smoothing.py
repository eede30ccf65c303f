"""A Gaussian between the points of one set, which is its own transpose but for a factor."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from texsss.numerics.sparse import Sparse, starts
from texsss.transport.neighbours import Neighbourhood
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled, chunks

REACH = 2.5  # the kernel ends at this many standard deviations; its variance is right all the same
UNEVEN = 1.5  # points as many times the typical distance apart get no wider kernel
ROUNDS = 2  # of correcting widths
COARSE = 0.6  # of a distance; narrower deviations are corrected, as samples miss the variance of no others
NARROW = 0.35  # of a distance²: narrower variances reach the next points hardly at all
ROWS = 1 << 14  # worked on at once: temporaries stay in the cache


def smoothing(
    around: Neighbourhood,
    area: Float[Tensor, " P"],
    edge: Float[Tensor, " P"],
    variance: float,
    cancel: Cancel | None = None,
) -> Sparse:
    """The Gaussian mean over points of `area` [mm²], about `edge` [mm] apart: rows sum to 1.

    Weights are exp(-d² (β_i + β_j) / 2) A_j. Where points are few for that, β is such that the row has
    `variance` [mm²] as sampled and cut. Areas are above 0. Raises Cancelled.
    """
    typical = float(edge.median())
    sharpness = 0.5 / sampled_width(variance, edge.clamp_max(UNEVEN * typical))
    coarse = variance < (COARSE * edge) ** 2
    near = [_near(around, sharpness, rows) for rows in _rows(area, cancel)]
    start = starts(torch.cat([part.count for part in near]))
    column = torch.cat([part.column for part in near])
    for _ in range(ROUNDS):
        sharper = sharpness.clone()
        for rows, part in zip(_rows(area, cancel), near, strict=True):
            weight = part.weight(sharpness, area, rows)
            sums, moments = part.sums(weight), part.sums(weight * part.squared)
            # two axes share the mean squared distance
            wrong = moments / sums / (2 * variance)
            sharper[rows] *= torch.where(coarse[rows] & (wrong > 0), wrong, 1).clamp(0.5, 2)
        sharpness = sharper
    value, total = area.new_empty(len(column)), torch.empty_like(area)
    for rows, part in zip(_rows(area, cancel), near, strict=True):
        weight = part.weight(sharpness, area, rows)
        total[rows] = sums = part.sums(weight)
        at = slice(int(start[rows.start]), int(start[rows.stop]))
        value[at] = weight.mul_((1 / sums).repeat_interleave(part.count))
    return Sparse(start, column, value, len(area), area * total)


@dataclass(frozen=True, eq=False)
class _Near:
    """Pairs of some rows: `count` of each, `column` and `squared` distance [mm²] of all."""

    count: Int[Tensor, " rows"]
    column: Int[Tensor, " M"]
    squared: Float[Tensor, " M"]

    def weight(self, sharpness: Tensor, area: Tensor, rows: slice) -> Float[Tensor, " M"]:
        """Of every pair, not yet to sum 1."""
        exponent = sharpness.index_select(0, self.column)
        exponent += sharpness[rows].repeat_interleave(self.count)
        return exponent.mul_(self.squared).mul_(-0.5).exp_().mul_(area.index_select(0, self.column))

    def sums(self, values: Float[Tensor, " M"]) -> Float[Tensor, " rows"]:
        """Of every row."""
        return torch.segment_reduce(values, "sum", lengths=self.count, unsafe=True)


def _near(around: Neighbourhood, sharpness: Float[Tensor, " P"], rows: slice) -> _Near:
    """The pairs that a kernel reaches."""
    part = slice(int(around.start[rows.start]), int(around.start[rows.stop]))
    column, squared = around.column[part], around.squared[part]
    count = around.start[rows.start : rows.stop + 1].diff().long()
    reach = sharpness.index_select(0, column)
    reach += sharpness[rows].repeat_interleave(count)
    kept = reach.mul_(squared) < REACH**2
    index = torch.nonzero(kept)[:, 0]
    left = torch.segment_reduce(kept.float(), "sum", lengths=count, unsafe=True).long()
    return _Near(left, column.index_select(0, index), squared.index_select(0, index))


def _rows(area: Tensor, cancel: Cancel | None) -> Iterator[slice]:
    for rows in chunks(len(area), ROWS):
        check_cancelled(cancel)
        yield rows


def sampled_width(variance: float, edge: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
    """Variance of a Gaussian [mm²] that, sampled on a square lattice of `edge` [mm], has about `variance`."""
    share = (variance / edge.square()).clamp(1e-6, 0.9)
    # two neighbours of weight q on a line: 2 q / (1 + 2 q)
    narrow = 0.5 / torch.log(2 * (1 - share) / share).clamp_min(1e-3) * edge.square()
    return torch.where(share < NARROW, narrow, variance / (1 - truncation(REACH)))


def truncation(reach: float) -> float:
    """Share of a Gaussian's variance in the plane that is lost beyond `reach` standard deviations."""
    half = reach**2 / 2
    return half / math.expm1(half)
