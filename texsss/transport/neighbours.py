"""Which points lie within a radius of which, in 3-D, by a hash of voxels."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import torch

from texsss.numerics.sparse import starts
from texsss.transport.loops import call, making
from texsss.types import Bool, Cancel, Float, Int, Tensor, check_cancelled

PAIRS = 1 << 19  # candidate pairs looked at once: temporaries stay in the cache
KEY = 1 << 20  # voxels per axis that one key holds
MARGIN = 4  # voxels around all points, so that neighbours' keys are plain sums
LANES = 16  # that a vector of the loops has at most
CROWDED = 16  # points per voxel from which voxels of half the radius save candidates


@dataclass(frozen=True, eq=False)
class Pairs:
    """Points around the targets of `block`, target by target.

    `count` (rows): how many each target has; `row` (M,): target, counted within the block; `column` (M,):
    point; `squared` (M,): squared distance [mm²].
    """

    block: slice
    count: Int[Tensor, " rows"]
    row: Int[Tensor, " M"]
    column: Int[Tensor, " M"]
    squared: Float[Tensor, " M"]


def pairs_within(
    targets: Float[Tensor, "Q 3"], points: Float[Tensor, "P 3"], radius: float
) -> Iterator[Pairs]:
    """The points closer than `radius` [mm] to each target, in consecutive blocks of targets."""
    grid = _grid(points, torch.minimum(points.amin(0), targets.amin(0)), radius)
    key, order, axes, steps = grid.key, grid.order, grid.axes, grid.steps
    voxels, voxel = torch.unique(voxel_keys(targets, grid.low, grid.edge), return_inverse=True)
    around = voxels[:, None] + grid.offset
    first = torch.searchsorted(key, around - steps)
    length = torch.searchsorted(key, around + steps, right=True) - first

    candidates = length.sum(1)[voxel]
    ends = candidates.cumsum(0)
    begin, total = 0, len(targets)
    while begin < total:
        before = int(ends[begin - 1]) if begin else 0
        end = int(torch.searchsorted(ends, before + PAIRS, right=True))
        end = min(max(end, begin + 1), total)
        block = slice(begin, end)
        here = length[voxel[block]].flatten()
        base = (first[voxel[block]].flatten() - (here.cumsum(0) - here)).to(torch.int32)
        place = torch.repeat_interleave(base, here)
        place += torch.arange(len(place), dtype=torch.int32, device=place.device)
        row = torch.arange(end - begin, dtype=torch.int32, device=place.device)
        row = row.repeat_interleave(candidates[block])
        squared = None
        for axis, coordinate in zip(axes, targets[block].T.contiguous(), strict=True):
            away = axis.index_select(0, place).sub_(coordinate.index_select(0, row)).square_()
            squared = away if squared is None else squared.add_(away)
        assert squared is not None, "points have three axes"
        close = torch.nonzero(squared < radius**2)[:, 0]
        row = row.index_select(0, close)
        column = order.index_select(0, place.index_select(0, close))
        count = torch.bincount(row, minlength=end - begin)
        yield Pairs(block, count, row, column, squared.index_select(0, close))
        begin = end


@dataclass(frozen=True, eq=False)
class _Grid:
    """Points in the order of their voxels: `key`, `order` (which point each is), `axes` (3, P).

    `offset`: from a voxel to the columns of 2·`steps` + 1 voxels around it. `low`, `edge`: of the voxels.
    """

    key: Int[Tensor, " P"]
    order: Int[Tensor, " P"]
    axes: Float[Tensor, "3 P"]
    offset: Int[Tensor, " columns"]
    steps: int
    low: Float[Tensor, "3"]
    edge: float


def _grid(points: Float[Tensor, "P 3"], low: Float[Tensor, "3"], radius: float) -> _Grid:
    steps, edge = 1, radius
    key = voxel_keys(points, low, edge)
    if len(points) > CROWDED * len(torch.unique(key)):
        steps, edge = 2, radius / 2
        key = voxel_keys(points, low, edge)
    key, order = torch.sort(key)
    axes = points[order].T.contiguous()  # rows are gathered faster one by one
    # voxels of one column along z follow each other in `key`: one range of points per column
    step = torch.arange(-steps, steps + 1, device=points.device)
    columns = torch.cartesian_prod(step, step)
    columns = columns[(columns.abs() - 1).clamp_min(0).square().sum(1) < steps**2]
    offset = (columns[:, 0] * KEY + columns[:, 1]) * KEY
    return _Grid(key, order.to(torch.int32), axes, offset, steps, low, edge)


def voxel_keys(points: Float[Tensor, "P 3"], low: Float[Tensor, "3"], edge: float) -> Int[Tensor, " P"]:
    """One number per voxel of `edge` [mm], counted from the corner `low`; ascends in x, then y, then z."""
    voxel = torch.floor((points - low) / edge).long() + MARGIN
    x, y, z = voxel.clamp(MARGIN, KEY - 1 - MARGIN).unbind(-1)
    return (x * KEY + y) * KEY + z


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """The points around every point of one set, itself among them, in compressed rows.

    `start` (P + 1,); `column` (M,): point; `squared` (M,): squared distance [mm²].
    """

    start: Int[Tensor, " starts"]
    column: Int[Tensor, " M"]
    squared: Float[Tensor, " M"]


def neighbourhood(points: Float[Tensor, "P 3"], radius: float, cancel: Cancel | None = None) -> Neighbourhood:
    """All pairs of points closer than `radius` [mm], by torch. Raises Cancelled."""
    counts, columns, squares = [], [], []
    for pairs in pairs_within(points, points, radius):
        check_cancelled(cancel)
        counts.append(pairs.count)
        columns.append(pairs.column)
        squares.append(pairs.squared)
    return Neighbourhood(starts(torch.cat(counts)), torch.cat(columns), torch.cat(squares))


class Search:
    """The same by loops in C++, for some points at a time: all pairs may be more than fit into memory."""

    def __init__(self, points: Float[Tensor, "P 3"], radius: float):
        found = making(points)
        assert found is not None, "there are loops"
        grid = _grid(points, points.amin(0), radius)
        around = len(grid.offset), grid.offset, grid.steps, radius**2
        self.found, self.args = found, (len(points), grid.key, grid.order, *grid.axes, *around)
        self.count = self._counted(slice(0, len(points)), None)

    def blocks(self, pairs: int, rows: int) -> list[slice]:
        """Consecutive points, multiples of `rows`, that have about so many pairs at the most."""
        ends, found = self.count.cumsum(0), [0]
        while found[-1] < len(ends):
            before = int(ends[found[-1] - 1]) if found[-1] else 0
            end = int(torch.searchsorted(ends, before + pairs, right=True))
            if end < len(ends):
                end = min(max(end // rows * rows, found[-1] + rows), len(ends))
            found.append(end)
        return [slice(*ends) for ends in pairwise(found)]

    def within(self, rows: slice, asked: Bool[Tensor, " rows"] | None = None) -> Neighbourhood:
        """What is around the points of `rows`; where some are `asked` for, around these."""
        start = starts(self.count[rows] if asked is None else self._counted(rows, asked))
        column, squared = torch.empty(int(start[-1]), dtype=torch.int32), torch.empty(int(start[-1]))
        call(self.found.pairs, *self.args, rows.start, rows.stop, asked, None, start, column, squared)
        return Neighbourhood(start, column, squared)

    def _counted(self, rows: slice, asked: Tensor | None) -> Int[Tensor, " rows"]:
        count = torch.zeros(rows.stop - rows.start, dtype=torch.int32)
        call(self.found.pairs, *self.args, rows.start, rows.stop, asked, count, None, None, None)
        return count


def spread_around(
    points: Float[Tensor, "P 3"], normals: Float[Tensor, "P 3"], radius: float
) -> Float[Tensor, "P 10"] | None:
    """What lies closer than `radius` [mm] to every point, itself included, and faces as it does.

    How many, then the sums of their x, y, z, xx, xy, xz, yy, yz and zz, seen from the point. `normals`: unit;
    those that point away are left out. None where there is no loop in C++ for it.
    """
    found = making(points, normals)
    if found is None:
        return None
    grid = _grid(points, points.amin(0), radius)
    facing = normals[grid.order.long()].T
    axes = [torch.nn.functional.pad(x, (0, LANES)).contiguous() for x in (*grid.axes, *facing)]
    result = torch.empty(len(points), 10)
    around = len(grid.offset), grid.offset, grid.steps
    call(found.spread, len(points), grid.key, grid.order, *axes, *around, radius**2, result)
    return result
