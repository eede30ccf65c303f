"""Which points lie within a radius of which, in 3-D, by a hash of voxels."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from texsss.types import Float, Int, Tensor

PAIRS = 1 << 22  # candidate pairs looked at once
KEY = 1 << 20  # voxels per axis that one key holds


@dataclass(frozen=True, eq=False)
class Cells:
    """Points sorted by voxel.

    `order` (P,): the points, voxel by voxel; `keys` (N,): occupied voxels, ascending; `first`, `count`
    (N,): their places in `order`; `cell` (P,): the voxel of each point.
    """

    order: Int[Tensor, " P"]
    keys: Int[Tensor, " N"]
    first: Int[Tensor, " N"]
    count: Int[Tensor, " N"]
    cell: Int[Tensor, " P"]


def cells(points: Float[Tensor, "P 3"], edge: float, low: Float[Tensor, "3"]) -> Cells:
    """The points sorted into voxels of `edge` [mm], counted from the corner `low`."""
    key = _keys(points, low, edge)
    keys, cell, count = torch.unique(key, return_inverse=True, return_counts=True)
    order = torch.argsort(cell, stable=True)
    return Cells(order, keys, count.cumsum(0) - count, count, cell)


def pairs_within(
    targets: Float[Tensor, "Q 3"], points: Float[Tensor, "P 3"], radius: float
) -> Iterator[tuple[slice, Int[Tensor, " M"], Int[Tensor, " M"], Float[Tensor, " M"]]]:
    """Blocks of (targets, row in the block, point, squared distance [mm²]) closer than `radius` [mm].

    Rows ascend within a block and blocks follow each other.
    """
    edge = radius / 2
    low = torch.minimum(points.amin(0), targets.amin(0))
    there = cells(points, edge, low)
    here = there if targets is points else cells(targets, edge, low)
    step = torch.arange(-2, 3, device=points.device)
    offset = torch.cartesian_prod(step, step, step)
    offset = offset[(offset.abs() - 1).clamp_min(0).square().sum(1) < 4]  # voxels that the radius reaches
    around = _packed(_unpacked(here.keys)[:, None] + offset)  # (N, offsets)
    found = torch.searchsorted(there.keys, around).clamp_max(len(there.keys) - 1)
    exists = there.keys[found] == around
    per_cell = torch.where(exists, there.count[found], 0).sum(1)
    # neighbour voxels of every target voxel, flat
    cell_of, which = torch.nonzero(exists, as_tuple=True)
    neighbour = found[cell_of, which]
    neighbours = exists.sum(1)
    neighbour_first = neighbours.cumsum(0) - neighbours

    sorted_points = points[there.order]
    per_target = per_cell[here.cell]
    ends = per_target.cumsum(0)
    begin = 0
    total = len(targets)
    while begin < total:
        before = int(ends[begin - 1]) if begin else 0
        end = int(torch.searchsorted(ends, before + PAIRS, right=True))
        end = min(max(end, begin + 1), total)
        block = slice(begin, end)
        cell = here.cell[block]
        row, slot = _ranges(neighbours[cell])
        other = neighbour[neighbour_first[cell][row] + slot]
        length = there.count[other]
        base = there.first[other] - (length.cumsum(0) - length)
        row = torch.repeat_interleave(row, length)
        place = torch.repeat_interleave(base, length) + torch.arange(len(row), device=row.device)
        away = sorted_points.index_select(0, place) - targets[block].index_select(0, row)
        squared = away.square().sum(1)
        close = torch.nonzero(squared < radius * radius)[:, 0]
        point = there.order.index_select(0, place.index_select(0, close))
        yield block, row.index_select(0, close), point, squared.index_select(0, close)
        begin = end


def voxel_clusters(points: Float[Tensor, "P 3"], edge: float) -> tuple[Int[Tensor, " P"], int]:
    """The voxel of `edge` [mm] that each point lies in, numbered from 0, and how many there are."""
    sorted_points = cells(points, edge, points.amin(0))
    return sorted_points.cell, len(sorted_points.keys)


def _ranges(lengths: Tensor) -> tuple[Tensor, Tensor]:
    """For lengths (2, 0, 3): owners (0, 0, 2, 2, 2) and places (0, 1, 0, 1, 2)."""
    owner = torch.repeat_interleave(torch.arange(len(lengths), device=lengths.device), lengths)
    first = lengths.cumsum(0) - lengths
    return owner, torch.arange(len(owner), device=lengths.device) - first[owner]


def _keys(points: Tensor, low: Tensor, edge: float) -> Tensor:
    return _packed(torch.floor((points - low) / edge).long())


def _packed(voxel: Tensor) -> Tensor:
    x, y, z = (voxel + 4).clamp(0, KEY - 1).unbind(-1)
    return (x * KEY + y) * KEY + z


def _unpacked(key: Tensor) -> Tensor:
    return torch.stack([key // (KEY * KEY), key // KEY % KEY, key % KEY], -1) - 4
