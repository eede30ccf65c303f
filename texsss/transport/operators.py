"""Gaussian diffusion on the surface itself: fixed sparse operators over texels, blind to charts and seams.

Texture space is only storage here: every Gaussian is a kernel over the 3-D distance between points, and
each is made from a narrower one's result, so that few points say all: texels for the narrowest, then
blocks of four texels, then clusters that grow with the Gaussian. Results of the latter come back to the
texels together, from coarse to fine.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import torch

from texsss.errors import DomainError
from texsss.numerics.sparse import Sparse, product
from texsss.surface.points import TexelMaps
from texsss.transport.blocks import from_blocks, texel_blocks
from texsss.transport.clusters import Clusters, mean_from, voxel_clusters
from texsss.transport.interpolation import interpolation
from texsss.transport.neighbours import Neighbourhood, neighbourhood
from texsss.transport.smoothing import smoothing
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled

TEXELS_TO = 1.35  # texels; standard deviation up to which Gaussians go from texels to texels
AT_ONCE = 0.85  # texels; widest exchange between texels: several small ones take less room than a large one
AROUND = 2.4  # texels; that those exchanges reach
BLOCKS_FROM = 0.95  # texels; of the result that blocks can stand for
BLOCKS_AT = 3.0  # texels; standard deviation from which results live on blocks
CLUSTERS_AT = 5.5  # texels; and from which on clusters
SOURCES, POINTS = (
    2.0,
    2.8,
)  # per standard deviation: clusters that a Gaussian is made from, and where it is known
ENTRIES = 13  # per texel that a Gaussian on clusters may cost; samples get sparser for it
UP = 0.7  # standard deviation of the way back, in distances of points
UP_VARIANCE = 0.2  # that it adds, in distances²
ROUGH = 8.0  # texels; standard deviation from which blocks may stand for the lightmap itself
WIDENING = 2.3  # a Gaussian is made from one at most so many times narrower at the texels
NARROWER = (
    5.0  # and from one at least so many times narrower above: folds of the surface count from the start
)
LEAST = 0.2  # share of its variance that a Gaussian's own kernel keeps
APART = 1.25  # times narrower, at the least, at the texels
NEAR_REACH, REACH = 2.6, 3.3  # standard deviations
GUTTER_TRACE = 1e-6  # a gutter texel's weight: it receives and sends nothing to speak of


@dataclass(frozen=True, eq=False)
class Step:
    """A Gaussian of another's result: `kernel`, `times` over, × (`mean` × result `source`), then `up` towards
    the texels.

    `variance` [mm²]: that of the result once at the texels. `held` [mm²]: before it comes back.
    """

    variance: float
    held: float
    source: int
    mean: tuple[Sparse, ...]
    kernel: Sparse
    up: Sparse | None = None
    times: int = 1


@dataclass(frozen=True, eq=False)
class Operators:
    """Surface diffusion for one geometry, atlas size and ladder.

    `variances` (K,) [mm²], in the order asked for. Results are numbered: 0 is the lightmap, then one per
    step at the `texels`, then those `above`, on ever coarser points. `result` (K,): the number that each
    variance has.
    """

    variances: Float[Tensor, " K"]
    result: tuple[int, ...]
    texels: tuple[Step, ...]
    above: tuple[Step, ...]

    @property
    def matrices(self) -> list[Sparse]:
        """All of them; those without a measure keep a transpose, too, once gradients were asked for."""
        steps = (*self.texels, *self.above)
        return [m for s in steps for m in (*s.mean, s.kernel, s.up) if m is not None]

    @property
    def bytes(self) -> int:
        """Memory of all matrices, without transposes."""
        return sum({id(matrix): matrix.bytes for matrix in self.matrices}.values())

    def applied(self, values: Float[Tensor, "P C"]) -> Float[Tensor, "K P C"]:
        """`values` convolved with every Gaussian, in the order of `variances`. Differentiable in `values`."""
        results = [values]
        means: dict[tuple[int, int], Tensor] = {}
        for step in (*self.texels, *self.above):
            x = results[step.source]
            for matrix in step.mean:
                known = (id(x), id(matrix))
                x = means[known] = means[known] if known in means else product(matrix, x)
            for _ in range(step.times):
                x = product(step.kernel, x)
            results.append(x)
        first = 1 + len(self.texels)
        coarser: tuple[Tensor, ...] = ()
        for step, own in reversed(list(zip(self.above, results[first:], strict=True))):
            coarser = (own, *coarser)
            if step.up is not None:
                # all coarser ones come along as further channels
                coarser = product(step.up, torch.cat(coarser, 1)).split(values.shape[1], 1)
        results[first:] = coarser
        chosen = [results[number] for number in self.result]
        return torch.stack(chosen) if chosen else values.new_empty(0, *values.shape)


def surface_operators(
    texels: TexelMaps,
    variances: Float[Tensor, " K"],
    *,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Operators:
    """The operators that convolve values at the texels with the unit Gaussian of every variance [mm²].

    Distances are straight lines in 3-D, so light crosses seams and thin parts. Gutter texels receive
    and do not emit. Constants stay; Σ M dA is kept but for some .1 %. Variances far below a texel² are
    the identity.
    Raises DomainError: when a variance is negative or not finite; Cancelled.
    """
    if not bool((torch.isfinite(variances) & (variances >= 0)).all()):
        raise DomainError(
            f"surface_operators: expected variances of 0 or more, got {variances.tolist()}; in mm²."
        )
    builder = _Builder(texels, progress, cancel)
    ladder = sorted({float(v) for v in variances if v > 0})
    for number, variance in enumerate(ladder):
        builder.tell(number / max(1, len(ladder)))
        builder.add(variance)
    builder.tell(1.0)
    numbers = {0.0: 0} | {s.variance: 1 + i for i, s in enumerate((*builder.near, *builder.above))}
    result = tuple(numbers[float(v)] for v in variances)
    return Operators(variances, result, tuple(builder.near), tuple(builder.above))


def fine_texel(texels: TexelMaps) -> float:
    """Edge of a texel [mm] that counts the small ones, so that there are never too many within reach."""
    area = texels.area[texels.area > 0].detach()
    harmonic = float((1 / area.double()).mean().rsqrt()) if len(area) else 0.0
    return max(min(texels.texel_mm, harmonic), 1e-30)


class _Builder:
    """Operators in the making, narrowest first."""

    def __init__(self, texels: TexelMaps, progress: Progress | None, cancel: Cancel | None):
        self.texels, self.progress, self.cancel = texels, progress, cancel
        place = texels.points.position(texels.mesh).detach()
        self.place = place - place.mean(0)
        self.area = texels.area.detach().to(self.place)
        self.typical = fine_texel(texels)
        self.near: list[Step] = []
        self.above: list[Step] = []
        self.around: Neighbourhood | None = None
        self.points: list[Clusters] = []  # where the results above are evaluated
        self.owed = 0.0  # variance that the way from the coarsest points to the texels adds

    def tell(self, done: float) -> None:
        check_cancelled(self.cancel)
        if self.progress is not None:
            self.progress("operators", done)

    def add(self, variance: float) -> None:
        """Add the Gaussian of `variance` [mm²], and narrower ones on the way where they are too far."""
        last = max((s.variance for s in (*self.near, *self.above)), default=0.0)
        std = math.sqrt(variance) / self.typical
        if std <= TEXELS_TO and not self.above:
            return self._between_texels(variance, last)
        served = last >= (BLOCKS_FROM * self.typical) ** 2
        if not served and std < ROUGH:
            self.add(((BLOCKS_FROM + 0.2) * self.typical) ** 2)
            return self.add(variance)
        if served and math.sqrt(variance / last) > WIDENING:
            self.add(math.sqrt(variance * last))
            return self.add(variance)
        if std < BLOCKS_AT:
            self._to_texels(variance)
        else:
            self._above(variance, std)

    def _between_texels(self, variance: float, last: float) -> None:
        lit = self.area > 0
        area = torch.where(lit, self.area, GUTTER_TRACE * self.typical**2)
        edge = torch.where(lit, self.area.sqrt(), self.typical)
        added = variance - last
        times = math.ceil(added / (AT_ONCE * self.typical) ** 2)
        if self.around is None:
            self.around = neighbourhood(self.place, AROUND * self.typical, self.cancel)
        kernel = smoothing(self.around, area, edge, added / times, self.cancel)
        self.near.append(Step(variance, variance, len(self.near), (), kernel, times=times))

    def _to_texels(self, variance: float) -> None:
        source, held = self._near_source(variance, APART)
        self.around = None
        kernel = mean_from(self.blocks, self.place, variance - held, NEAR_REACH, self.cancel)
        self.near.append(Step(variance, variance, source, (self.blocks.mean,), kernel))

    def _near_source(self, variance: float, narrower: float) -> tuple[int, float]:
        """Number and variance of the widest result at the texels that is so many times narrower.

        Or else of the narrowest that blocks can stand for, or of the lightmap itself.
        """
        able = [
            (1 + i, s.variance)
            for i, s in enumerate(self.near)
            if s.variance >= (BLOCKS_FROM * self.typical) ** 2
        ]
        first = able[0] if able else (0, 0.0)
        return max((a for a in able if a[1] * narrower**2 <= variance), default=first)

    @cached_property
    def blocks(self) -> Clusters:
        """Texels in fours."""
        return self._blocks[0]

    @cached_property
    def _blocks(self) -> tuple[Clusters, Int[Tensor, "h w"]]:
        return texel_blocks(self.texels, self.place, self.area, self.typical)

    def _above(self, variance: float, std: float) -> None:
        below = self.points[-1] if self.points else None
        up = None
        if below is None:
            points = self.blocks
            deviation = UP * 2 * self.typical
            up, added = from_blocks(
                self.texels, points, self._blocks[1], self.place, self.typical, deviation, self.cancel
            )
            self.owed += added
        elif std < CLUSTERS_AT:
            points = below
        else:
            edge = math.sqrt(variance) / (POINTS * self._share(variance))
            points = voxel_clusters(below.centre, below.area, edge)
            added = UP_VARIANCE * edge**2
            up = interpolation(points, below.centre, UP * edge, added, self.cancel)
            self.owed += added
        held = variance - self.owed
        number, source, mean, held_there = self._source(variance)
        kernel = mean_from(
            source, points.centre, max(held - held_there, LEAST * variance), REACH, self.cancel
        )
        self.above.append(Step(variance, held, number, mean, kernel, up))
        self.points.append(points)

    def _share(self, variance: float) -> float:
        """How densely to sample, against the constants' advice: as far as ENTRIES allow."""
        # voxels cut a surface into some 1.4 clusters per edge²
        entries = 1.4**2 * math.pi * (REACH * SOURCES * POINTS) ** 2 * float(self.area.sum()) / variance
        return min(1.0, (ENTRIES * len(self.place) / entries) ** 0.25)

    def _source(self, variance: float) -> tuple[int, Clusters, tuple[Sparse, ...], float]:
        """Result number, clusters that stand for it, the way to them, the variance it holds."""
        able = [i for i, s in enumerate(self.above) if s.held * NARROWER**2 <= variance]
        edge = math.sqrt(variance) / (SOURCES * self._share(variance))
        if not able:
            number, held = self._near_source(variance, NARROWER)
            mean, points = (self.blocks.mean,), self.blocks
        else:
            number = able[-1]
            mean, held, points = (), self.above[number].held, self.points[number]
            number += 1 + len(self.near)
        if points is self.blocks and edge < 2.7 * self.typical:
            return number, points, mean, held
        source = voxel_clusters(points.centre, points.area, edge)
        return number, source, (*mean, source.mean), held
