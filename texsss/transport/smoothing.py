"""A Gaussian between the points of one set, which is its own transpose but for a factor."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from texsss.numerics.sparse import starts
from texsss.transport.kernels import STRIP, WHOLE, Kernel, kernel_of
from texsss.transport.loops import call, making
from texsss.transport.neighbours import Neighbourhood, neighbourhood
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled, chunks

REACH = 2.8  # the kernel ends at this many standard deviations; its variance is right all the same
UNEVEN = 1.5  # points as many times the typical distance apart get no wider kernel
ROUNDS = 2  # of correcting widths
COARSE = 0.6  # of a distance; narrower deviations are corrected, as samples miss the variance of no others
NARROW = 0.35  # of a distance²: narrower variances reach the next points hardly at all
ROWS = 1 << 14  # worked on at once: temporaries stay in the cache


def smoothing(
    place: Float[Tensor, "P 3"],
    area: Float[Tensor, " P"],
    edge: Float[Tensor, " P"],
    variance: float,
    cancel: Cancel | None = None,
) -> Kernel:
    """The Gaussian mean over points at `place` [mm], of `area` [mm²], about `edge` [mm] apart.

    Weights are exp(-d² (β_i + β_j) / 2). Where points are few for that, β is such that the row has
    `variance` [mm²] as sampled and cut. Areas are above 0. Raises Cancelled.
    """
    typical = float(edge.median())
    widest = 0.5 / sampled_width(variance, edge.clamp_max(UNEVEN * typical))
    around = neighbourhood(place, REACH / math.sqrt(2 * float(widest.min())), cancel)
    coarse = variance < (COARSE * edge) ** 2
    kind = _Looped if making(area, edge) is not None else _Listed
    pairs, sharpness = kind(around, area, widest, cancel), widest
    for _ in range(ROUNDS if bool(coarse.any()) else 0):
        check_cancelled(cancel)
        sums, moments = pairs.moments(sharpness, coarse)
        # two axes share the mean squared distance
        wrong = moments / sums / (2 * variance)
        sharpness = sharpness * torch.where(coarse & (wrong > 0), wrong, 1).clamp(0.5, 2)
    return pairs.kernel(sharpness)


class _Looped:
    """The pairs that a kernel of sharpness `widest` reaches, as loops in C++ take them."""

    def __init__(self, around: Neighbourhood, area: Tensor, widest: Tensor, cancel: Cancel | None):
        self.area, self.found = area, making(area)
        self.pairs = around.start, around.column, around.squared, widest, float(REACH**2)

    def moments(self, sharpness: Tensor, asked: Tensor) -> tuple[Tensor, Tensor]:
        """Sums of weight × area, and of that times the squared distance, of rows `asked` for; else 0."""
        assert self.found is not None
        sums, moments = torch.zeros(2, *sharpness.shape).unbind(0)
        call(self.found.moments, len(asked), asked, *self.pairs, sharpness, self.area, sums, moments)
        return sums, moments

    def kernel(self, sharpness: Tensor) -> Kernel:
        """The kernel of that sharpness."""
        assert self.found is not None
        args = len(sharpness), *self.pairs, sharpness, self.area, float(WHOLE)
        diagonals = torch.empty(-(-len(sharpness) // STRIP), dtype=torch.int32)
        call(self.found.entries, *args, diagonals, None, None, None, None)
        start, total = starts(diagonals), torch.empty_like(self.area)
        distance = torch.empty(int(start[-1]), dtype=torch.int32)
        weight = torch.zeros(len(distance), STRIP, dtype=torch.uint8)
        call(self.found.entries, *args, None, start, distance, weight, total)
        return Kernel(start, distance, weight, self.area, 1 / total)


class _Listed:
    """The same by torch, some rows at a time."""

    def __init__(self, around: Neighbourhood, area: Tensor, widest: Tensor, cancel: Cancel | None):
        self.area, self.cancel = area, cancel
        self.near = [_near(around, widest, rows) for rows in _rows(area, cancel)]

    def moments(self, sharpness: Tensor, asked: Tensor) -> tuple[Tensor, Tensor]:
        """Sums of weight × area, and of that times the squared distance, of every row, `asked` for or not."""
        sums, moments = torch.empty_like(self.area), torch.empty_like(self.area)
        for rows, part in zip(_rows(self.area, self.cancel), self.near, strict=True):
            weight = part.weight(sharpness, rows).mul_(self.area.index_select(0, part.column))
            sums[rows], moments[rows] = part.sums(weight), part.sums(weight * part.squared)
        return sums, moments

    def kernel(self, sharpness: Tensor) -> Kernel:
        """The kernel of that sharpness."""
        start = starts(torch.cat([part.count for part in self.near]))
        column = torch.cat([part.column for part in self.near])
        rows = zip(_rows(self.area, self.cancel), self.near, strict=True)
        weight = torch.cat([part.weight(sharpness, own) for own, part in rows])
        return kernel_of(start, column, weight, self.area)


@dataclass(frozen=True, eq=False)
class _Near:
    """Pairs of some rows: `count` of each, `column` and `squared` distance [mm²] of all."""

    count: Int[Tensor, " rows"]
    column: Int[Tensor, " M"]
    squared: Float[Tensor, " M"]

    def weight(self, sharpness: Tensor, rows: slice) -> Float[Tensor, " M"]:
        """Of every pair, 1 for a point itself."""
        exponent = sharpness.index_select(0, self.column)
        exponent += sharpness[rows].repeat_interleave(self.count)
        return exponent.mul_(self.squared).mul_(-0.5).exp_()

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
