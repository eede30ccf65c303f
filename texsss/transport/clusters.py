"""Points that stand for parts of a surface, and wide Gaussians from them."""

import math
from dataclasses import dataclass

import torch

from texsss.numerics.sparse import Sparse, starts
from texsss.transport.neighbours import pairs_within, voxel_keys, with_nearest
from texsss.transport.smoothing import truncation
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled

FLOOR = 0.3  # of the variance asked for, below which corrections never take it


@dataclass(frozen=True, eq=False)
class Clusters:
    """Parts of a surface.

    `centre` (N, 3) [mm], `area` (N,) [mm²], `spread` (N,): variance within, per axis of
    the surface [mm²]. `mean`: the area-weighted mean of values at the points that they were made of.
    """

    centre: Float[Tensor, "N 3"]
    area: Float[Tensor, " N"]
    spread: Float[Tensor, " N"]
    mean: Sparse

    def __len__(self) -> int:
        return len(self.area)


def gathered(
    member: Int[Tensor, " M"],
    point: Int[Tensor, " M"],
    place: Float[Tensor, "P 3"],
    area: Float[Tensor, " P"],
) -> Clusters:
    """Clusters 0, 1, … (`member`) of the points with these numbers, whose areas are above 0."""
    weight, at = area[point], place[point]
    count = torch.bincount(member)
    total = weight.new_zeros(len(count)).index_add(0, member, weight)
    share = weight / total[member]
    centre = at.new_zeros(len(count), 3).index_add(0, member, at * share[:, None])
    squared = (at - centre[member]).square().sum(1) * share
    spread = weight.new_zeros(len(count)).index_add(0, member, squared) / 2
    order = torch.argsort(member, stable=True)
    mean = Sparse(starts(count), point[order].to(torch.int32), share[order], len(area))
    return Clusters(centre, total, spread, mean)


def voxel_clusters(place: Float[Tensor, "P 3"], area: Float[Tensor, " P"], edge: float) -> Clusters:
    """Clusters of the points with area in voxels of `edge` [mm]."""
    lit = torch.nonzero(area > 0)[:, 0]
    keys = voxel_keys(place[lit], place[lit].amin(0), edge)
    _, member = torch.unique(keys, return_inverse=True)
    return gathered(member, lit, place, area)


def mean_from(
    clusters: Clusters,
    targets: Float[Tensor, "Q 3"],
    variance: float,
    reach: float,
    cancel: Cancel | None = None,
) -> Sparse:
    """The Gaussian mean of `variance` [mm²] over clusters at every target: rows sum to 1.

    Area × exp(-d²/2w) / w, cut at `reach` deviations, w of each cluster such that with its own spread the
    variance is right. A target out of reach takes the nearest cluster.
    """
    width = (variance - clusters.spread).clamp_min(FLOOR * variance) / (1 - truncation(reach))
    sharpness, height = -0.5 / width, clusters.area / width
    counts, columns, values = [], [], []
    for pairs in pairs_within(targets, clusters.centre, reach * math.sqrt(float(width.max()))):
        check_cancelled(cancel)
        weight = (pairs.squared * sharpness.index_select(0, pairs.column)).exp_()
        weight.mul_(height.index_select(0, pairs.column))
        total = torch.segment_reduce(weight, "sum", lengths=pairs.count, unsafe=True, initial=0.0)
        weight.mul_((1 / total).repeat_interleave(pairs.count))
        counts.append(pairs.count)
        columns.append(pairs.column)
        values.append(weight)
    return with_nearest(torch.cat(counts), torch.cat(columns), torch.cat(values), clusters.centre, targets)
