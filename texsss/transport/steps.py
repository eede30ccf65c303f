"""The narrowest diffusion on a surface: light exchanged between neighbouring texels, as often as it takes."""

import math
from dataclasses import dataclass

import torch

from texsss.numerics.sparse import Sparse, product, starts
from texsss.transport.neighbours import pairs_within
from texsss.types import Cancel, Float, Tensor, check_cancelled

REACH = 2.6  # the kernel ends at this many standard deviations; its variance is right all the same
NARROW = 0.8  # texels; a narrower Gaussian is a smaller share of this one
UNEVEN = 1.5  # texels as many times the typical edge get no wider kernel
BALANCING = 6  # roundsof the weights
GIVEN_AWAY = 0.95  # of its light that a texel may give in one step: no texel turns negative


@dataclass(frozen=True, eq=False)
class Exchange:
    """One step of diffusion by `variance` [mm²]: x → x + (W x - r x) / A.

    `weight`: W, symmetric, so that constants stay and Σ A x is kept, both exactly. `area`: A; `given`: r / A,
    the share that a texel gives away.
    """

    weight: Sparse
    area: Float[Tensor, " P"]
    given: Float[Tensor, " P"]
    variance: float

    def applied(self, x: Float[Tensor, "P C"], variance: float) -> Float[Tensor, "P C"]:
        """`x` diffused by `variance` [mm²], in equal steps. Differentiable in `x`."""
        count = math.ceil(variance / self.variance - 1e-6)
        for _ in range(count):
            share = variance / count / self.variance
            received = product(self.weight, x, symmetric=True) * (share / self.area)[:, None]
            x = torch.addcmul(received, x, (1 - share * self.given)[:, None])
        return x


def texel_exchange(
    position: Float[Tensor, "P 3"],
    area: Float[Tensor, " P"],
    edge: Float[Tensor, " P"],
    variance: float,
    cancel: Cancel | None = None,
) -> Exchange:
    """The exchange that adds `variance` [mm²] between texels of `area` [mm²] and about `edge` [mm].

    Weights D_i exp(-d² (β_i + β_j)) D_j with D such that every texel's light spreads by the variance asked
    for, or less where a texel would have to give away more than it has.
    Source: Sinkhorn & Knopp 1967 (balancing).
    """
    typical = float(edge.median())
    widened = variance / (1 - truncation(REACH))
    spread = (NARROW * edge.clamp_max(UNEVEN * typical)).square().clamp_min(widened)
    beta = 1 / (4 * spread)  # of a pair of equals: exp(-d² / (2 spread))
    counts, columns, exponents, moments = [], [], [], []
    for pairs in pairs_within(position, position, REACH * math.sqrt(float(spread.max()))):
        check_cancelled(cancel)
        own = pairs.row + pairs.block.start
        exponent = pairs.squared * (
            beta[pairs.block].repeat_interleave(pairs.count) + beta.index_select(0, pairs.column)
        )
        kept = torch.nonzero((exponent < REACH**2 / 2) & (own != pairs.column))[:, 0]
        counts.append(torch.bincount(pairs.row.index_select(0, kept), minlength=len(pairs.count)))
        columns.append(pairs.column.index_select(0, kept))
        exponents.append(exponent.index_select(0, kept).neg_().exp_())
        moments.append(pairs.squared.index_select(0, kept))
    count, column, value = torch.cat(counts), torch.cat(columns), torch.cat(exponents)
    start = starts(count)
    moment = Sparse(start, column, value * torch.cat(moments), len(area))
    kernel = Sparse(start, column, value, len(area))

    # Σ_j W_ij d² = 2 axes × variance × A_i
    scale = area.clone()
    for _ in range(BALANCING):
        check_cancelled(cancel)
        reached = moment.times(scale[:, None])[:, 0]
        scale = torch.where(reached > 0, (scale * 2 * variance * area / reached.clamp_min(1e-30)).sqrt(), 0)
    given = scale * kernel.times(scale[:, None])[:, 0] / area
    scale = scale * (GIVEN_AWAY / given.clamp_min(GIVEN_AWAY))
    given = scale * kernel.times(scale[:, None])[:, 0] / area
    value = value.mul_(scale.repeat_interleave(count)).mul_(scale.index_select(0, column))
    return Exchange(Sparse(start, column, value, len(area)), area, given, variance)


def truncation(reach: float) -> float:
    """Share of a Gaussian's variance in the plane that is lost beyond `reach` standard deviations."""
    half = reach**2 / 2
    return half / math.expm1(half)
