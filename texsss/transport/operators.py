"""Gaussian diffusion on the surface itself: fixed sparse operators over texels, blind to charts and seams.

Texture space is only storage here: every Gaussian is a kernel over the 3-D distance between points. Narrow
ones go from texel to texel. Of the others, light × area is summed up on
lattices in space, where a Gaussian is three short convolutions; on lattices ever coarser, each filled from
the one before, as variances add in space. What comes back is divided by what comes back of area alone.
The gutter has no area: it gets what the surface has at its place.
Source: the sums of Greengard & Strain 1991 (fast Gauss transform), by lattices as of Adams et al. 2009.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch

from texsss.errors import DomainError
from texsss.numerics.memory import room
from texsss.numerics.sparse import Sparse
from texsss.surface.points import TexelMaps
from texsss.transport.gutter import fill_gutter, gutter_means
from texsss.transport.kernels import Kernel, Planes
from texsss.transport.lattice import NARROWEST, blur, lattice
from texsss.transport.levels import Level, over, over_transposed
from texsss.transport.smoothing import smoothing
from texsss.transport.stencil import VARIANCE
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled

LATTICE_FROM = 2.3  # even texels; standard deviation from which Gaussians go over lattices
TRACE = 1e-6  # of a texel: the weight of one on a face without area
EDGES = 0.9, 1.6  # of a lattice per standard deviation, at the least: of MANY texels and more, and of few
MANY = 650_000
MOST_EDGES = 2.0  # per standard deviation
COST = 0.4  # edges per standard deviation where that is a texel; more where lattices are small
APART = 1.4  # edges of lattices, at the least


@dataclass(frozen=True, eq=False)
class Operators:
    """Surface diffusion for one geometry, atlas size and ladder.

    `variances` (K,) [mm²], in the order asked for. Results are numbered: 0 is the lightmap, then one per
    kernel of `steps`, from texel to texel, then those of all `levels`. `result` (K,): the number that each
    variance has. `area` (L,) [mm²]:
    of the texels that the surface covers, which come first. `share` (W, L): 1 / what comes back of it over
    the levels, for each of their Gaussians. `gutter` (P - L, L): what the other texels make of these.
    """

    variances: Float[Tensor, " K"]
    result: tuple[int, ...]
    steps: tuple[Kernel, ...]
    levels: tuple[Level, ...]
    area: Float[Tensor, " L"]
    share: Float[Tensor, "W L"]
    gutter: Sparse

    @property
    def count(self) -> int:
        """How many Gaussians there are."""
        return len(self.steps) + sum(len(level.blurs) for level in self.levels)

    @property
    def bytes(self) -> int:
        """Memory of all matrices."""
        blurs = [blur for level in self.levels for blur in level.blurs]
        wide = [part for level in self.levels for part in (level.ways, *(b.bricks for b in level.blurs[:1]))]
        held = [*self.steps, *blurs, *wide, self.gutter]
        return sum(matrix.bytes for matrix in held) + 4 * self.share.numel()

    def only(self, chosen: Sequence[int]) -> "Operators":
        """Those of the `chosen` variances, by their places, and the lattices that these are made from."""
        numbers = {self.result[k] for k in chosen}
        kept = [number for number in range(1, 1 + self.count) if number in numbers]
        place = {number: 1 + k for k, number in enumerate(kept)} | {0: 0}
        first = 1 + len(self.steps)
        steps = [self.steps[number - 1] for number in kept if number < first]
        levels, used, number = [], 0, first
        for level in self.levels:
            own = [k for k in range(len(level.blurs)) if number + k in numbers]
            number += len(level.blurs)
            variances, blurs = (tuple(of[k] for k in own) for of in (level.variances, level.blurs))
            levels.append(replace(level, variances=variances, blurs=blurs))
            used = len(levels) if own else used
        wide = [number - first for number in kept if number >= first]
        result = tuple(place[self.result[k]] for k in chosen)
        variances, share = self.variances[list(chosen)], self.share[wide]
        return replace(
            self,
            variances=variances,
            result=result,
            steps=tuple(steps),
            levels=tuple(levels[:used]),
            share=share,
        )

    def applied(self, values: Float[Tensor, "P C"]) -> Float[Tensor, "K P C"]:
        """`values` convolved with every Gaussian, in the order of `variances`. Differentiable in `values`."""
        return _Applied.apply(values, self)  # pyright: ignore[reportReturnType]


class _Applied(torch.autograd.Function):
    """Every result goes straight to where it is to stand: new memory is dear."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, operators: Operators) -> Tensor:
        ctx.operators = operators
        copies = room(values, len(operators.result), *values.shape)
        place = {number: k for k, number in reversed(list(enumerate(operators.result)))}
        lightmap = values[: len(operators.area)]

        def own(number: int) -> Tensor:
            """Where a result goes."""
            return copies[place[number]][: len(lightmap)]

        if 0 in place:
            copies[place[0]] = values
        planes = Planes()
        for number, step in enumerate(operators.steps, 1):
            step.times(lightmap, own(number), planes)
        first = 1 + len(operators.steps)
        if operators.levels:
            wide = [own(number) for number in range(first, 1 + operators.count)]
            over(operators.levels, lightmap, operators.area, wide, list(operators.share))
        fill_gutter(operators.gutter, [copies[k] for number, k in place.items() if number])
        for k, number in enumerate(operators.result):
            if place[number] != k:
                copies[k] = copies[place[number]]
        return copies

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        operators: Operators = ctx.operators
        (grad,) = grads
        covered, area, rim = len(operators.area), operators.area, operators.gutter.transpose
        result = room(grad, *grad.shape[1:])
        own = result[:covered]
        sent: list[Tensor | None] = [None] * (1 + operators.count)
        for k, number in enumerate(operators.result):
            before = sent[number]
            sent[number] = grad[k] if before is None else before + grad[k]
        lightmap, *sent = sent
        result[covered:] = 0
        if operators.levels:
            wide = [
                torch.zeros_like(result) if part is None else part for part in sent[len(operators.steps) :]
            ]
            over_transposed(operators.levels, wide, list(operators.share), own, area, rim)
        else:
            own.zero_()
        for step, part in zip(operators.steps, sent, strict=False):
            if part is not None:
                step.back(part, own, rim)
        return result if lightmap is None else result.add_(lightmap), None


def surface_operators(
    texels: TexelMaps,
    variances: Float[Tensor, " K"],
    *,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Operators:
    """The operators that convolve values at the texels with the unit Gaussian of every variance [mm²].

    Distances are straight lines in 3-D, so light crosses seams and thin parts. Gutter texels have no area:
    they get what the surface has at their place. Constants stay; Σ M dA is kept but for some .1 %.
    Variances far below a texel² are the identity.
    Raises DomainError: when a variance is negative or not finite, or no texel lies on the surface; Cancelled.
    """
    if not bool((torch.isfinite(variances) & (variances >= 0)).all()):
        raise DomainError(
            f"surface_operators: expected variances of 0 or more, got {variances.tolist()}; in mm²."
        )
    if not texels.covered_count:
        raise DomainError(
            "surface_operators: expected texels on the surface, got none, as its charts lie between their "
            "centres; take a larger atlas."
        )
    ladder = sorted({float(v) for v in variances if v > 0})
    builder = _Builder(texels, len(ladder), progress, cancel)
    wide = lattice_from(texels) ** 2
    for variance in ladder:
        if variance < wide:
            builder.add_step(variance)
    builder.add_levels([v for v in ladder if v >= wide])
    numbers = {v: 1 + i for i, v in enumerate(ladder)} | {0.0: 0}
    return builder.finished(variances, tuple(numbers[float(v)] for v in variances))


def fine_texel(texels: TexelMaps) -> float:
    """Edge of a texel [mm] that counts the small ones, so that there are never too many within reach."""
    area = texels.area[texels.area > 0].detach()
    harmonic = float((1 / area.double()).mean().rsqrt()) if len(area) else 0.0
    return max(min(texels.texel_mm, harmonic), 1e-30)


def lattice_from(texels: TexelMaps) -> float:
    """Standard deviation [mm] from which lattices take less time than sums over texels.

    These cost texels × deviation², and nodes are as many as area / deviation²: of uneven texels, small ones
    are many for the area that they cover.
    """
    fine, count = fine_texel(texels), max(texels.covered_count, 1)
    uneven = float(texels.area.sum()) / count / fine**2
    return LATTICE_FROM * fine * max(uneven, 1.0) ** 0.25


def edge_for(deviation: float, texel: float, texels: int) -> float:
    """Edge [mm] of the lattice for a Gaussian of this standard deviation [mm] over `texels` of an edge [mm].

    Few texels have finer lattices, which cost them little.
    """
    low, high = EDGES
    least = min(max(low * (MANY / texels) ** 0.25, low), high)
    return deviation / min(max(COST * math.sqrt(deviation / texel), least), MOST_EDGES)


class _Builder:
    """Operators in the making, narrowest first."""

    def __init__(self, texels: TexelMaps, count: int, progress: Progress | None, cancel: Cancel | None):
        self.count, self.done, self.progress, self.cancel = count, 0, progress, cancel
        place = texels.points.position(texels.mesh).detach()
        place, covered = place - place.mean(0), texels.covered_count
        self.places, self.normal, self.place = (
            place,
            texels.points.normal(texels.mesh).detach(),
            place[:covered],
        )
        self.typical = fine_texel(texels)
        own = texels.area[:covered].detach().to(place)
        self.edge = torch.where(own > 0, own.sqrt(), self.typical)
        self.area = own.clamp_min(TRACE * self.typical**2)
        self.steps: list[Kernel] = []
        self.levels: list[Level] = []
        self.tell(0)

    def tell(self, more: int = 1) -> None:
        """Says that so many more Gaussians are done."""
        check_cancelled(self.cancel)
        self.done += more
        if self.progress is not None:
            self.progress("operators", self.done / max(self.count, 1))

    def add_step(self, variance: float) -> None:
        """Add the Gaussian of `variance` [mm²] between texels."""
        self.steps.append(smoothing(self.place, self.area, self.edge, variance, self.cancel))
        self.tell()

    def add_levels(self, ladder: list[float]) -> None:
        """Add Gaussians of these variances [mm²], ascending, over lattices."""
        points, held = self.place, 0.0  # held: variance of what is on the lattice, and comes back [mm²]
        while ladder:
            edge = self._edge(ladder[0])
            together = [v for v in ladder if self._edge(v) < APART * edge]
            # ways there and back, and the narrowest kernel, are to spread less than is asked for
            most = math.sqrt(max(ladder[0] - held, 0) / (2 * VARIANCE + NARROWEST**2))
            nodes = lattice(points, min(edge, max(most, edge / 2)), self.cancel)
            held += 2 * VARIANCE * nodes.edge**2
            ladder = ladder[len(together) :]
            blurs = []
            for variance in together:
                blurs.append(blur(nodes, variance - held, self.cancel))
                self.tell()
            self.levels.append(Level(nodes.ways, tuple(together), tuple(blurs)))
            points = nodes.place

    def _edge(self, variance: float) -> float:
        return edge_for(math.sqrt(variance), self.typical, len(self.place))

    def finished(self, variances: Float[Tensor, " K"], result: tuple[int, ...]) -> Operators:
        """All of it."""
        levels = tuple(self.levels)
        wide = self.area.new_empty(sum(len(level.blurs) for level in levels), len(self.area), 1)
        if levels:
            one = torch.ones_like(self.area)[:, None]
            over(levels, one, self.area, list(wide), None)
        gutter = gutter_means(self.places, self.normal, len(self.place), self.cancel)
        return Operators(variances, result, tuple(self.steps), levels, self.area, 1 / wide[..., 0], gutter)
