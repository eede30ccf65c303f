"""Gaussian diffusion on the surface itself: fixed sparse operators over texels, blind to charts and seams.

Texture space is only storage here. Every Gaussian is a kernel over the 3-D distance between points,
balanced so that it keeps constants and, weighted by area, sums. Narrow ones run from texel to texel,
each from the one before; wide ones between clusters of texels, interpolated back.
"""

import math
from dataclasses import dataclass, replace

import torch

from texsss.errors import DomainError
from texsss.numerics.sparse import Sparse, product
from texsss.surface.points import TexelMaps
from texsss.transport.neighbours import pairs_within, voxel_clusters
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled

REACH = 3.0  # texel kernels end at this many standard deviations
CLUSTER_REACH = 3.2  # those of clusters, which are applied alone
NARROW = 0.8  # texels; a kernel is never narrower, but blended with the identity
STEP = 1.35  # texels; wider steps between texels are split into equal ones
CLUSTER_AT = 2.3  # standard deviation in texels from which clusters serve
CLUSTERS_PER_STD = 2.0
COARSER = 1.5  # edge of clusters against that of the next finer ones, at least
FITS = 2  # rounds of fitting a kernel's width to the variance it should add
FADED = 60.0  # exp(-FADED) is nothing beside 1 and still above float32's denormal numbers
UNEVEN = 2.0  # a point may ask for this many times the variance of the others, no more
GUTTER_TRACE = 1e-6  # a gutter texel's weight: nothing, unless no covered texel is in reach
INTERPOLATION_REACH = 1.75  # cluster edges; the centroid of a texel's own cluster is always nearer


@dataclass(frozen=True, eq=False)
class Balanced:
    """A symmetric kernel S between points, as the operator x → s S (s A x) / (s S s A).

    `kernel`: S. `sent`: s A; `received`: 1 / (S s A). Rows sum to 1; columns weighted by area nearly so.
    `variance` [mm²]: what it adds along the surface, as measured. `blend`: the share of the operator, the
    rest is the identity. `repeat`: how often it applies.
    """

    kernel: Sparse
    sent: Float[Tensor, " P"]
    received: Float[Tensor, " P"]
    variance: float
    blend: float = 1.0
    repeat: int = 1

    def applied(self, x: Float[Tensor, "P C"]) -> Float[Tensor, "P C"]:
        """The operator on `x`. Differentiable in `x`."""
        for _ in range(self.repeat):
            blurred = product(self.kernel, self.kernel, x * self.sent[:, None]) * self.received[:, None]
            x = blurred if self.blend == 1 else torch.lerp(x, blurred, self.blend)
        return x


@dataclass(frozen=True, eq=False)
class Clusters:
    """Clusters of texels, Gaussians between them and the way back to the next finer points.

    `up`: linear-exact interpolation to the next finer clusters, or to the texels; `down`: its transpose,
    which hands light × area on and keeps its sum and its centre. `area` (N,): what arrives of the area.
    """

    area: Float[Tensor, " N"]
    diffusions: tuple[Balanced, ...]
    up: Sparse
    down: Sparse


@dataclass(frozen=True, eq=False)
class Operators:
    """Surface diffusion for one geometry, atlas size and ladder.

    `variances` (K,) [mm²], in the order asked for; `ascending`: their places, narrowest first; then for
    each positive one a step between texels (`steps`), or a level of `clusters`, finest first.
    """

    variances: Float[Tensor, " K"]
    area: Float[Tensor, " P"]
    ascending: tuple[int, ...]
    zeros: int
    steps: tuple[Balanced, ...]
    clusters: tuple[Clusters, ...]

    @property
    def bytes(self) -> int:
        """Memory of all matrices."""
        kernels = [s.kernel for s in self.steps] + [d.kernel for c in self.clusters for d in c.diffusions]
        return sum(k.bytes for k in kernels) + sum(c.up.bytes + c.down.bytes for c in self.clusters)

    def applied(self, values: Float[Tensor, "P C"]) -> Float[Tensor, "K P C"]:
        """`values` convolved with every Gaussian, in the order of `variances`. Differentiable in `values`."""
        copies = [values] * self.zeros
        current = values
        for step in self.steps:
            current = step.applied(current)
            copies.append(current)
        channels = values.shape[1]
        gathered, light = [], values * self.area[:, None]
        for level in self.clusters:
            light = product(level.down, level.up, light)
            gathered.append(light / level.area[:, None])
        coarser: tuple[Tensor, ...] = ()
        for level, received in zip(reversed(self.clusters), reversed(gathered), strict=True):
            # all coarser levels come along as further channels
            own = [diffusion.applied(received) for diffusion in level.diffusions]
            coarser = product(level.up, level.down, torch.cat([*own, *coarser], 1)).split(channels, 1)
        copies.extend(coarser)
        place = {k: i for i, k in enumerate(self.ascending)}
        return torch.stack([copies[place[k]] for k in range(len(copies))])


def surface_operators(
    texels: TexelMaps,
    variances: Float[Tensor, " K"],
    *,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Operators:
    """The operators that convolve values at the texels with the unit Gaussian of every variance [mm²].

    Distances are straight lines in 3-D, so light crosses seams and thin parts. Gutter texels receive
    and do not emit. Variances far below a texel² are the identity.
    Raises DomainError: when a variance is negative or not finite; Cancelled.
    Source: Sinkhorn & Knopp 1967 (balancing), Levin 1998 (interpolation exact for linear functions).
    """
    if not bool((torch.isfinite(variances) & (variances >= 0)).all()):
        raise DomainError(
            f"surface_operators: expected variances of 0 or more, got {variances.tolist()}; in mm²."
        )
    position = texels.points.position(texels.mesh).detach()
    area = texels.area.detach().to(position)
    texel = max(texels.texel_mm, 1e-30)
    area = torch.where(area > 0, area, GUTTER_TRACE * texel**2)
    ascending = torch.argsort(variances, stable=True).tolist()
    wanted = [float(variances[k]) for k in ascending]
    zeros = sum(v <= 0 for v in wanted)
    steps: list[Balanced] = []
    levels: list[Clusters] = []
    spent, narrow = torch.zeros_like(area), zeros
    while narrow < len(wanted) and math.sqrt(wanted[narrow]) < CLUSTER_AT * texel:
        _tell(progress, cancel, narrow / len(wanted))
        wanted_here = (wanted[narrow] - spent).clamp_min(1e-3 * wanted[narrow])
        step, added = _texel_step(position, area, wanted_here, texel, cancel)
        steps.append(step)
        spent, narrow = spent + added, narrow + 1
    finer, weight, owed = position, area, 0.0
    while narrow < len(wanted):
        _tell(progress, cancel, narrow / len(wanted))
        widest = math.sqrt(wanted[narrow]) * COARSER  # Gaussians up to here share these clusters
        group = [v for v in wanted[narrow:] if math.sqrt(v) < widest]
        level, finer, owed = _level(finer, weight, group, owed, cancel)
        weight = level.area
        levels.append(level)
        narrow += len(group)
    return Operators(variances, area, tuple(ascending), zeros, tuple(steps), tuple(levels))


def _texel_step(
    position: Float[Tensor, "P 3"],
    area: Float[Tensor, " P"],
    wanted: Float[Tensor, " P"],
    texel: float,
    cancel: Cancel | None,
) -> tuple[Balanced, Float[Tensor, " P"]]:
    """The operator that adds `wanted` [mm²] between texels of about `texel` mm, and what it does add."""
    typical = float(wanted.median())
    repeat = max(1, math.ceil(typical / (STEP * texel) ** 2))
    narrowest = (NARROW * texel) ** 2
    each = (wanted / repeat).clamp(narrowest, max(UNEVEN * typical / repeat, narrowest))
    step, added = _balanced(position, area, each, REACH, FITS, cancel)
    blend = min(1.0, typical / repeat / narrowest)
    return replace(step, blend=blend, repeat=repeat), added * (blend * repeat)


def _level(
    finer: Float[Tensor, "Q 3"],
    weight: Float[Tensor, " Q"],
    group: list[float],
    owed: float,
    cancel: Cancel | None,
) -> tuple[Clusters, Float[Tensor, "N 3"], float]:
    """Gaussians of near variances on clusters, their centroids, what interpolation adds so far [mm²]."""
    edge = math.sqrt(group[0]) / CLUSTERS_PER_STD
    member, count = voxel_clusters(finer, edge)
    total = weight.new_zeros(count).index_add(0, member, weight)
    centroid = finer.new_zeros(count, 3).index_add(0, member, finer * (weight / total[member])[:, None])
    up, added = _interpolation(finer, centroid, total, edge, cancel)
    down = up.transposed()
    owed = owed + added
    area = down.times(weight[:, None])[:, 0].clamp_min(1e-3 * total)
    diffusions = []
    for variance in group:
        left = torch.full_like(area, max(variance - 2 * owed, 0.1 * variance))
        diffusions.append(_balanced(centroid, area, left, CLUSTER_REACH, 0, cancel)[0])
    return Clusters(area, tuple(diffusions), up, down), centroid, owed


def _tell(progress: Progress | None, cancel: Cancel | None, done: float) -> None:
    check_cancelled(cancel)
    if progress is not None:
        progress("operators", done)


def _balanced(
    points: Float[Tensor, "P 3"],
    area: Float[Tensor, " P"],
    wanted: Float[Tensor, " P"],
    reach: float,
    fits: int,
    cancel: Cancel | None,
) -> tuple[Balanced, Float[Tensor, " P"]]:
    """A balanced Gaussian kernel that adds `wanted` [mm²] at every point, and what it does add there.

    Cut at `reach` standard deviations. The kernel exp(-d² (β_i + β_j)) is symmetric; β follows from
    what the sampled, cut kernel turns out to add.
    """
    columns, squares, counts = [], [], []
    for block, row, column, squared in pairs_within(points, points, reach * math.sqrt(float(wanted.max()))):
        check_cancelled(cancel)
        columns.append(column.to(torch.int32))
        squares.append(squared)
        counts.append(torch.bincount(row, minlength=block.stop - block.start))
    count, column, squared = torch.cat(counts), torch.cat(columns), torch.cat(squares)
    del columns, squares

    beta = 1 / (4 * wanted)  # a pair's kernel is exp(-d² (β_i + β_j))
    for _ in range(fits):
        check_cancelled(cancel)
        beta = beta * (_kernel(beta, count, column, squared, area)[2] / wanted).clamp(0.3, 3)
    kernel, received, added = _kernel(beta, count, column, squared, area)
    variance = float((added * area).sum() / area.sum())
    return Balanced(kernel, area, received, variance), added


def _kernel(
    beta: Float[Tensor, " P"],
    count: Int[Tensor, " P"],
    column: Int[Tensor, " M"],
    squared: Float[Tensor, " M"],
    area: Float[Tensor, " P"],
) -> tuple[Sparse, Float[Tensor, " P"], Float[Tensor, " P"]]:
    """The kernel of widths β over the pairs, the inverse of its row sums, and what it adds [mm²]."""
    start = torch.cat([count.new_zeros(1), count.cumsum(0)]).to(torch.int32)
    value = torch.repeat_interleave(beta, count).add_(beta.index_select(0, column))
    value = value.mul_(squared).neg_().clamp_(min=-FADED).exp_()
    kernel = Sparse(start, column, value, len(beta))
    received = 1 / kernel.times(area[:, None])[:, 0]
    moment = Sparse(start, column, value * squared, len(beta)).times(area[:, None])[:, 0]
    return kernel, received, moment * received / 2


def _interpolation(
    targets: Float[Tensor, "Q 3"],
    points: Float[Tensor, "P 3"],
    area: Float[Tensor, " P"],
    edge: float,
    cancel: Cancel | None,
) -> tuple[Sparse, float]:
    """Weights of `points` at `targets`, exact for linear functions, and the variance that they add [mm²].

    Moving least squares of first order: Gaussian weights × area × (1 + b·d), b such that the first
    moment vanishes as far as the points around span it.
    """
    columns, values, counts, added = [], [], [], 0.0
    for block, row, column, squared in pairs_within(targets, points, INTERPOLATION_REACH * edge):
        check_cancelled(cancel)
        rows = block.stop - block.start
        weight = torch.exp(squared / (-2 * (0.6 * edge) ** 2)) * area[column]
        away = points[column] - targets[block][row]
        total = weight.new_zeros(rows).index_add(0, row, weight)
        first = away.new_zeros(rows, 3).index_add(0, row, away * weight[:, None]) / total[:, None]
        outer = (away[:, :, None] * away[:, None, :]).reshape(-1, 9)
        second = away.new_zeros(rows, 9).index_add(0, row, outer * weight[:, None]) / total[:, None]
        ridge = torch.eye(3, dtype=away.dtype, device=away.device) * (0.03 * edge**2)
        slope = torch.linalg.solve(second.reshape(-1, 3, 3) + ridge, -first)
        weight = weight * (1 + (away * slope[row]).sum(1))
        total = weight.new_zeros(rows).index_add(0, row, weight)
        weight = weight / total[row]
        added += float((weight * squared).sum()) / 2
        columns.append(column.to(torch.int32))
        values.append(weight)
        counts.append(torch.bincount(row, minlength=rows))
    count = torch.cat(counts)
    start = torch.cat([count.new_zeros(1), count.cumsum(0)]).to(torch.int32)
    return Sparse(start, torch.cat(columns), torch.cat(values), len(points)), added / len(targets)
