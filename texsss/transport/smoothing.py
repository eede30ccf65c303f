"""A Gaussian between the points of one set, which is its own transpose but for a factor."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from texsss.numerics.sparse import starts
from texsss.transport.kernels import STRIP, WHOLE, Kernel, kernel_of
from texsss.transport.loops import call, making
from texsss.transport.neighbours import Neighbourhood, Search, neighbourhood
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled, chunks

REACH = 2.8  # the kernel ends at this many standard deviations; its variance is right all the same
UNEVEN = 1.5  # points as many times the typical distance apart get no wider kernel
ROUNDS = 2  # of correcting widths
COARSE = 0.6  # of a distance; narrower deviations are corrected, as samples miss the variance of no others
NARROW = 0.35  # of a distance²: narrower variances reach the next points hardly at all
ROWS = 1 << 14  # worked on at once: temporaries stay in the cache
PAIRS = 1 << 25  # about as many are held at once by loops


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
    radius = REACH / math.sqrt(2 * float(widest.min()))
    coarse = variance < (COARSE * edge) ** 2
    kind = _Looped if making(area, edge) is not None else _Listed
    pairs, sharpness = kind(place, radius, area, widest, cancel), widest
    for _ in range(ROUNDS if bool(coarse.any()) else 0):
        check_cancelled(cancel)
        sums, moments = pairs.moments(sharpness, coarse)
        # two axes share the mean squared distance
        wrong = moments / sums / (2 * variance)
        sharpness = sharpness * torch.where(coarse & (wrong > 0), wrong, 1).clamp(0.5, 2)
    return pairs.kernel(sharpness)


class _Looped:
    """The pairs within reach of a kernel of `widest` sharpness: loops in C++ take some rows at a time."""

    def __init__(self, place: Tensor, radius: float, area: Tensor, widest: Tensor, cancel: Cancel | None):
        self.area, self.widest, self.found, self.cancel = area, widest, making(area), cancel
        self.search = Search(place, radius)
        self.blocks = self.search.blocks(PAIRS, STRIP)
        self.held: Neighbourhood | None = None

    def moments(self, sharpness: Tensor, asked: Tensor) -> tuple[Tensor, Tensor]:
        """Sums of weight × area, and of that times the squared distance, of rows `asked` for; else 0."""
        assert self.found is not None
        sums, moments = torch.zeros(2, *sharpness.shape).unbind(0)
        for rows in self.blocks:
            pairs = self._pairs(rows, asked[rows])
            args = rows.start, rows.stop, asked[rows], *pairs, sharpness, self.area, sums[rows], moments[rows]
            call(self.found.moments, *args)
        return sums, moments

    def kernel(self, sharpness: Tensor) -> Kernel:
        """The kernel of that sharpness."""
        total = torch.empty_like(self.area)
        parts = [self._entries(rows, sharpness, total[rows]) for rows in self.blocks]
        self.held = None  # its memory is needed
        joined = parts[0] if len(parts) == 1 else [torch.cat(part) for part in zip(*parts, strict=True)]
        diagonals, distance, weight = joined
        return Kernel(starts(diagonals), distance, weight, self.area, 1 / total)

    def _entries(self, rows: slice, sharpness: Tensor, total: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """How many diagonals the strips of some rows have, their distances and weights; fills `total`."""
        assert self.found is not None
        args = rows.start, rows.stop, *self._pairs(rows, None), sharpness, self.area, float(WHOLE)
        diagonals = torch.empty(-(-(rows.stop - rows.start) // STRIP), dtype=torch.int32)
        call(self.found.entries, *args, diagonals, None, None, None, None)
        start = starts(diagonals)
        distance = torch.empty(int(start[-1]), dtype=torch.int32)
        weight = torch.zeros(len(distance), STRIP, dtype=torch.uint8)
        call(self.found.entries, *args, None, start, distance, weight, total)
        return diagonals, distance, weight

    def _pairs(self, rows: slice, asked: Tensor | None) -> tuple[Tensor, Tensor, Tensor, Tensor, float]:
        """What loops take of the pairs around some rows."""
        check_cancelled(self.cancel)
        if self.held is None or len(self.blocks) > 1:
            self.held = None  # its memory is needed
            self.held = self.search.within(rows, asked if len(self.blocks) > 1 else None)
        return self.held.start, self.held.column, self.held.squared, self.widest, float(REACH**2)


class _Listed:
    """The same by torch, some rows at a time."""

    def __init__(self, place: Tensor, radius: float, area: Tensor, widest: Tensor, cancel: Cancel | None):
        self.area, self.cancel = area, cancel
        around = neighbourhood(place, radius, cancel)
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
