"""Gaussian diffusion on the surface itself: fixed sparse operators over texels, blind to charts and seams.

Texture space is only storage here: every Gaussian is a kernel over the 3-D distance between points.
The narrowest are exchanges between neighbouring texels. Each of the others takes the result of one
several times narrower, which is smooth, so that clusters of texels can stand for it: to the texels
themselves, or, where wide, to a coarse grid around the surface.
"""

import math
from dataclasses import dataclass, replace

import torch

from texsss.errors import DomainError
from texsss.numerics.sparse import Sparse, product
from texsss.surface.points import TexelMaps
from texsss.transport.clusters import (
    Clusters,
    gaussian_between,
    grid_around,
    mean_from,
    moments_of,
    texel_clusters,
    widths,
)
from texsss.transport.steps import Exchange, texel_exchange
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled

STEP = 0.85  # texels; standard deviation of the exchange between texels
CLUSTERS_FROM = 1.1  # texels; standard deviation from which clusters can stand for a Gaussian's result
GRID_FROM = 4.0  # texels; standard deviation from which Gaussians are evaluated on a grid
CLUSTER_EDGE = 1.5  # of clusters, in standard deviations of what they stand for
WIDENING = 2.2  # a Gaussian is made from one at most so many times narrower, if clusters go to texels
GRID_PER_STD = 2.0  # nodes of the grid per standard deviation
CLUSTERS_PER_STD = 2.2  # clusters of the lightmap for Gaussians on the grid, per standard deviation
FADED = 1e-3  # of the typical sum of weights: texels with less are out of reach
TEXEL_REACH = 2.8  # standard deviations
GRID_REACH = 3.3  # ends at 2.6 cost 1 % where nothing follows
GRID_ENTRIES = 30  # entries per texel that a Gaussian on the grid may cost
GUTTER_TRACE = 1e-6  # a gutter texel's weight: it receives and sends nothing to speak of


@dataclass(frozen=True, eq=False)
class Gathering:
    """A Gaussian from clusters: `kernel` × (`mean` × result number `source`)."""

    source: int
    mean: Sparse
    kernel: Sparse


@dataclass(frozen=True, eq=False)
class OnGrid:
    """A Gaussian on a grid of nodes (N, 3), straight from the lightmap, not yet normalised.

    `moments` of clusters, `kernel` from clusters to nodes, and the way `up` to the next finer Gaussian's
    nodes, or to the texels. `total` (P,): what a lightmap of 1 becomes; 0 where nothing is in reach.
    """

    moments: Sparse
    kernel: Sparse
    node: Float[Tensor, "N 3"]
    up: Sparse
    total: Float[Tensor, " P"]

    def at_nodes(self, values: Float[Tensor, "P C"]) -> Float[Tensor, "N C"]:
        """Σ area × Gaussian × values. Differentiable in `values`."""
        clusters, channels = self.kernel.columns, values.shape[1]
        gathered = product(self.moments, values).reshape(4, clusters, channels)
        # four times the channels cost a product little more: it waits for the matrix
        sent = product(self.kernel, gathered.transpose(0, 1).reshape(clusters, -1))
        sent = sent.reshape(-1, 4, channels)
        return sent[:, 0] + (sent[:, 1:] * self.node[:, :, None]).sum(1)

    def normalised(
        self, received: Float[Tensor, "P C"], values: Float[Tensor, "P C"]
    ) -> Float[Tensor, "P C"]:
        """The Gaussian mean; `values` where nothing is in reach."""
        near = (self.total > 0)[:, None]
        return torch.where(near, received / torch.where(near, self.total[:, None], 1), values)


@dataclass(frozen=True, eq=False)
class Operators:
    """Surface diffusion for one geometry, atlas size and ladder.

    `variances` (K,) [mm²], in the order asked for. Results are numbered: 0 is the lightmap, then one per
    step in `near` (between texels by the variance given, or gathered from clusters), then those of `wide`,
    finest grid first. `result` (K,): the number that each variance has.
    """

    variances: Float[Tensor, " K"]
    result: tuple[int, ...]
    exchange: Exchange | None
    near: tuple[float | Gathering, ...]
    wide: tuple[OnGrid, ...]

    @property
    def matrices(self) -> list[Sparse]:
        """All of them; those of clusters and grids keep a transpose, too, once gradients were asked for."""
        near = [m for g in self.near if isinstance(g, Gathering) for m in (g.mean, g.kernel)]
        exchange = [] if self.exchange is None else [self.exchange.weight]
        return exchange + near + [m for w in self.wide for m in (w.moments, w.kernel, w.up)]

    @property
    def bytes(self) -> int:
        """Memory of all matrices, without transposes."""
        return sum(matrix.bytes for matrix in self.matrices)

    def applied(self, values: Float[Tensor, "P C"]) -> Float[Tensor, "K P C"]:
        """`values` convolved with every Gaussian, in the order of `variances`. Differentiable in `values`."""
        results = [values]
        for step in self.near:
            if isinstance(step, Gathering):
                results.append(_gathered(step, results))
            else:
                assert self.exchange is not None, "steps between texels come with an exchange"
                results.append(self.exchange.applied(results[-1], step))
        coarser: tuple[Tensor, ...] = ()
        for level in reversed(self.wide):
            # all coarser ones come along as further channels
            own = level.at_nodes(values)
            coarser = product(level.up, torch.cat([own, *coarser], 1)).split(values.shape[1], 1)
        results.extend(w.normalised(c, values) for w, c in zip(self.wide, coarser, strict=True))
        chosen = [results[number] for number in self.result]
        return torch.stack(chosen) if chosen else values.new_empty(0, *values.shape)


def _gathered(step: Gathering, results: list[Tensor]) -> Tensor:
    return product(step.kernel, product(step.mean, results[step.source]))


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
        builder.add(math.sqrt(variance))
    builder.tell(1.0)
    near = [0.0, *builder.deviations]
    numbers = {0.0: 0} | {v: near.index(math.sqrt(v)) for v in ladder if math.sqrt(v) in near}
    numbers |= {v: len(near) + i for i, v in enumerate(v for v in ladder if math.sqrt(v) not in near)}
    result = tuple(numbers[float(v)] for v in variances)
    return Operators(variances, result, builder.exchange, tuple(builder.near), tuple(builder.wide))


class _Builder:
    """Operators in the making, narrowest first."""

    def __init__(self, texels: TexelMaps, progress: Progress | None, cancel: Cancel | None):
        self.progress, self.cancel = progress, cancel
        position = texels.points.position(texels.mesh).detach()
        self.position = position - position.mean(0)
        self.area = texels.area.detach().to(self.position)
        self.typical = max(texels.texel_mm, 1e-30)  # mm
        self.exchange: Exchange | None = None
        self.near: list[float | Gathering] = []
        self.deviations: list[float] = []  # standard deviations of the results at the texels [mm]
        self.wide: list[OnGrid] = []
        self.node, self.owed = self.position, 0.0  # of the coarsest grid so far
        self.clusters: dict[int, Clusters] = {}

    def tell(self, done: float) -> None:
        check_cancelled(self.cancel)
        if self.progress is not None:
            self.progress("operators", done)

    def add(self, deviation: float) -> None:
        """Add the Gaussian of `deviation` [mm], and narrower ones on the way where they are too far."""
        if self.wide or deviation > GRID_FROM * self.typical:
            return self._add_on_grid(deviation)
        last = self.deviations[-1] if self.deviations else 0.0
        if last < CLUSTERS_FROM * self.typical:
            if deviation > WIDENING * 1.2 * self.typical:
                self.add(1.2 * self.typical)
                return self.add(deviation)
            if self.exchange is None:
                self.exchange = self._texel_exchange()
            self.near.append(deviation**2 - last**2)
        else:
            if deviation > WIDENING * last:
                self.add(last * math.sqrt(deviation / last))
                return self.add(deviation)
            source = len(self.deviations)
            clusters = self._clusters_of(source)
            added = deviation**2 - last**2
            kernel = mean_from(clusters, self.position, added, TEXEL_REACH, self.cancel)
            self.near.append(Gathering(source, clusters.mean, kernel))
        self.deviations.append(deviation)

    def _add_on_grid(self, deviation: float) -> None:
        share = self._sampling(deviation)
        edge = deviation / (GRID_PER_STD * share)
        grid = grid_around(self.node, edge)
        self.owed += edge**2 / 6
        clusters = texel_clusters(self.position, self.area, deviation / (CLUSTERS_PER_STD * share))
        width = widths(clusters, deviation**2, self.owed, GRID_REACH)
        kernel = gaussian_between(clusters, grid.node, width, GRID_REACH, self.cancel)
        moments = moments_of(clusters, self.position, width)
        level = OnGrid(moments, kernel, grid.node, grid.up, torch.empty(0))
        total = level.at_nodes(torch.ones_like(self.position[:, :1]))
        for up in (grid.up, *(w.up for w in reversed(self.wide))):
            total = up.times(total)
        total = total[:, 0]
        total = torch.where(total > FADED * total.median(), total, 0)
        self.node = grid.node
        self.wide.append(replace(level, total=total))

    def _sampling(self, deviation: float) -> float:
        """How densely to sample, against the constants' advice: as far as GRID_ENTRIES allow."""
        area = float(self.area.sum())
        entries = 168 * (GRID_PER_STD * CLUSTERS_PER_STD) ** 2 * area / deviation**2
        return min(1.0, (GRID_ENTRIES * len(self.position) / max(entries, 1.0)) ** 0.25)

    def _clusters_of(self, number: int) -> Clusters:
        if number not in self.clusters:
            edge = CLUSTER_EDGE * self.deviations[number - 1]
            self.clusters[number] = texel_clusters(self.position, self.area, edge)
        return self.clusters[number]

    def _texel_exchange(self) -> Exchange:
        lit = self.area > 0
        area = torch.where(lit, self.area, GUTTER_TRACE * self.typical**2)
        edge = torch.where(lit, self.area.sqrt(), self.typical)
        return texel_exchange(self.position, area, edge, (STEP * self.typical) ** 2, self.cancel)
