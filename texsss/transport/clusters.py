"""Wide Gaussians on a surface: from clusters of texels to texels, or to a coarse grid around them."""

import math
from dataclasses import dataclass

import torch

from texsss.numerics.sparse import Sparse, starts
from texsss.transport.neighbours import KEY, pairs_within, voxel_keys, voxel_of
from texsss.transport.steps import truncation
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled

FLOOR = 0.3  # of the variance asked for, below which corrections never take it
CORNERS = torch.cartesian_prod(*[torch.arange(2)] * 3)  # of a voxel (8, 3)
NEAREST_ROWS = 64  # lost targets whose nearest cluster is looked for at once


@dataclass(frozen=True, eq=False)
class Clusters:
    """Texels gathered in voxels.

    `centre` (N, 3), `area` (N,) [mm²], `spread` (N,): variance of the texels within, per axis of the surface
    [mm²]. `mean`: the area-weighted mean of values at the texels.
    """

    centre: Float[Tensor, "N 3"]
    area: Float[Tensor, " N"]
    spread: Float[Tensor, " N"]
    mean: Sparse


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes of the voxels of edge `edge` [mm] that hold some points.

    `node` (N, 3) [mm]; `up`: trilinear interpolation at the points.
    """

    edge: float
    node: Float[Tensor, "N 3"]
    up: Sparse


def texel_clusters(position: Float[Tensor, "P 3"], area: Float[Tensor, " P"], edge: float) -> Clusters:
    """Clusters of the texels with area in voxels of `edge` [mm]."""
    lit = torch.nonzero(area > 0)[:, 0]
    place, weight = position[lit], area[lit]
    _, member, count = torch.unique(
        voxel_keys(place, place.amin(0), edge), return_inverse=True, return_counts=True
    )
    total = weight.new_zeros(len(count)).index_add(0, member, weight)
    share = weight / total[member]
    centre = place.new_zeros(len(count), 3).index_add(0, member, place * share[:, None])
    squared = (place - centre[member]).square().sum(1) * share
    spread = weight.new_zeros(len(count)).index_add(0, member, squared) / 2
    order = torch.argsort(member, stable=True)
    mean = Sparse(starts(count), lit[order].to(torch.int32), share[order], len(area))
    return Clusters(centre, total, spread, mean)


def grid_around(points: Float[Tensor, "Q 3"], edge: float) -> Grid:
    """The grid of `edge` [mm] around `points`."""
    low = points.amin(0)
    cells, cell = torch.unique(voxel_keys(points, low, edge), return_inverse=True)
    x, y, z = CORNERS.to(points.device).unbind(1)
    keys, node = torch.unique(cells[:, None] + (x * KEY + y) * KEY + z, return_inverse=True)
    fraction = ((points - low) / edge - voxel_of(cells)[cell]).clamp(0, 1)
    ends = torch.stack([1 - fraction, fraction], -1)  # (Q, 3, 2)
    weight = ends[:, 0, x] * ends[:, 1, y] * ends[:, 2, z]
    start = torch.arange(0, 8 * len(points) + 1, 8, dtype=torch.int32, device=points.device)
    up = Sparse(start, node.to(torch.int32)[cell].flatten(), weight.flatten(), len(keys))
    return Grid(edge, low + voxel_of(keys) * edge, up)


def gaussian_between(
    clusters: Clusters,
    targets: Float[Tensor, "Q 3"],
    width: Float[Tensor, " N"],
    reach: float,
    cancel: Cancel | None = None,
) -> Sparse:
    """Area × exp(-d²/2w) / w between targets and clusters of widths w [mm²], cut at `reach` deviations."""
    sharpness, height = -1 / (2 * width), clusters.area / width
    counts, columns, values = [], [], []
    for pairs in pairs_within(targets, clusters.centre, reach * math.sqrt(float(width.max()))):
        check_cancelled(cancel)
        value = (pairs.squared * sharpness.index_select(0, pairs.column)).exp_()
        values.append(value.mul_(height.index_select(0, pairs.column)))
        columns.append(pairs.column)
        counts.append(pairs.count)
    return Sparse(starts(torch.cat(counts)), torch.cat(columns), torch.cat(values), len(clusters.area))


def widths(clusters: Clusters, variance: float, owed: float, reach: float) -> Float[Tensor, " N"]:
    """The variance of a kernel [mm²] that, with those of the clusters and `owed`, has `variance` once cut."""
    kept = (variance - owed - clusters.spread).clamp_min(FLOOR * variance)
    return kept / (1 - truncation(reach))


def mean_from(
    clusters: Clusters,
    targets: Float[Tensor, "Q 3"],
    variance: float,
    reach: float,
    cancel: Cancel | None = None,
) -> Sparse:
    """The Gaussian mean of `variance` [mm²] over clusters at every target: rows sum to 1.

    A target out of reach takes the nearest cluster.
    """
    kernel = gaussian_between(clusters, targets, widths(clusters, variance, 0.0, reach), reach, cancel)
    count = kernel.start.diff().long()
    total = kernel.times(clusters.area.new_ones(len(clusters.area), 1))[:, 0]
    value = kernel.value * (1 / total).repeat_interleave(count)
    lost = torch.nonzero(count == 0)[:, 0]
    if not len(lost):
        return Sparse(kernel.start, kernel.column, value, kernel.columns)
    row = torch.cat([torch.arange(len(count), device=count.device).repeat_interleave(count), lost])
    order = torch.argsort(row, stable=True)
    column = torch.cat([kernel.column, _nearest(targets[lost], clusters.centre).to(torch.int32)])[order]
    value = torch.cat([value, value.new_ones(len(lost))])[order]
    return Sparse(starts(count.clamp_min(1)), column, value, kernel.columns)


def moments_of(
    clusters: Clusters,
    position: Float[Tensor, "P 3"],
    width: Float[Tensor, " N"],
) -> Sparse:
    """What kernels of widths w [mm²] need of the values in each cluster, as a matrix of 4 N rows.

    exp(-|x-p|²/2w) ≈ exp(-|x-c|²/2w) (1 + (p-c)·(x-c)/w) for p near c is a sum of four products of what
    depends on p and of (1, x): the rows give Σ_p (1 - (p-c)·c/w) first, then Σ_p (p-c)/w for each axis,
    as shares of the cluster's area.
    """
    mean = clusters.mean
    count = mean.start.diff().long()
    centre = clusters.centre.repeat_interleave(count, 0)
    away = (position[mean.column.long()] - centre) / width.repeat_interleave(count)[:, None]
    first = mean.value * (1 - (away * centre).sum(1))
    value = torch.cat([first, *(away * mean.value[:, None]).T])
    return Sparse(starts(count.repeat(4)), mean.column.repeat(4), value, mean.columns)


def _nearest(targets: Tensor, points: Tensor) -> Int[Tensor, " Q"]:
    parts = targets.split(NEAREST_ROWS)
    return torch.cat([torch.cdist(part, points).argmin(1) for part in parts])
