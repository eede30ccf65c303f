"""From few points on a surface to many: smooth, exact for what changes evenly, blind to charts."""

import torch

from texsss.numerics.sparse import Sparse
from texsss.transport.clusters import Clusters
from texsss.transport.neighbours import pairs_within, with_nearest
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled

REACH = 2.6  # standard deviations
TAMED = 3.0  # largest change of a weight by either
RIDGE = 0.02  # of the kernel's variance: keeps corrections tame where points are in line


def interpolation(
    clusters: Clusters,
    place: Float[Tensor, "Q 3"],
    deviation: float,
    variance: float,
    cancel: Cancel | None = None,
) -> Sparse:
    """Gaussian means over clusters at places [mm], exact for linear functions.

    A Gaussian of `deviation` [mm], whose weights w are corrected twice: by 1 + a (|p - x|² - mean), so that
    they have `variance` [mm²], and by 1 - b·(p - m), so that their mean place m is x. A target out of reach
    takes the nearest cluster. Raises Cancelled.
    Source: moving least squares, Lancaster & Salkauskas 1981.
    """
    counts, columns, values = [], [], []
    for pairs in pairs_within(place, clusters.centre, REACH * deviation):
        check_cancelled(cancel)
        weight = (
            (pairs.squared / (-2 * deviation**2)).exp_().mul_(clusters.area.index_select(0, pairs.column))
        )
        away = clusters.centre.index_select(0, pairs.column)
        away -= place[pairs.block].repeat_interleave(pairs.count, 0)
        weight = _corrected(weight, away, pairs.count, deviation, variance)
        counts.append(pairs.count)
        columns.append(pairs.column)
        values.append(weight)
    return with_nearest(torch.cat(counts), torch.cat(columns), torch.cat(values), clusters.centre, place)


def _corrected(
    weight: Float[Tensor, " M"],
    away: Float[Tensor, "M 3"],
    count: Int[Tensor, " rows"],
    deviation: float,
    variance: float,
) -> Float[Tensor, " M"]:
    weight = weight / _sums(weight, count).clamp_min(1e-30).repeat_interleave(count)
    squared = away.square().sum(1)
    second, fourth = _sums(torch.stack([weight * squared, weight * squared * squared], 1), count).unbind(1)
    slope = (2 * variance - second) / (fourth - second * second).clamp_min((RIDGE * deviation**2) ** 2)
    weight = _changed(
        weight, (squared - second.repeat_interleave(count)) * slope.repeat_interleave(count), count
    )
    mean = _sums(away * weight[:, None], count)
    away -= mean.repeat_interleave(count, 0)
    outer = (away[:, :, None] * away[:, None, :]).reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
    moment = _sums(outer * weight[:, None], count)[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    ridge = RIDGE * deviation**2 * torch.eye(3, dtype=moment.dtype, device=moment.device)
    slope = torch.linalg.solve(moment + ridge, mean[:, :, None])[:, :, 0]
    return _changed(weight, -(away * slope.repeat_interleave(count, 0)).sum(1), count)


def _changed(
    weight: Float[Tensor, " M"], change: Float[Tensor, " M"], count: Int[Tensor, " rows"]
) -> Float[Tensor, " M"]:
    """Weights × (1 + change), the change held to TAMED in every row; rows sum to 1 again."""
    most = torch.segment_reduce(change.abs(), "max", lengths=count, unsafe=True, initial=0.0)
    weight = weight * (1 + change * (TAMED / most.clamp_min(TAMED)).repeat_interleave(count))
    return weight / _sums(weight, count).clamp_min(1e-30).repeat_interleave(count)


def _sums(values: Tensor, count: Int[Tensor, " rows"]) -> Tensor:
    return torch.segment_reduce(values, "sum", lengths=count, axis=0, unsafe=True, initial=0.0)
