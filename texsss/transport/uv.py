"""Gaussian diffusion along the two axes of texture space, as wide as the metric says.

The wider Gaussian is made from the narrower one (variances add), one axis at a time and, once it is
smooth enough, on a grid of half the resolution. Every pass is a symmetric kernel between texels,
scaled so that it keeps constants and, weighted by area, the sum: what a diffusion on the surface does
but for shear and seams, which this method does not know.
"""

from dataclasses import dataclass, replace

import torch
from torch.nn.functional import interpolate, pad

from texsss.errors import DomainError
from texsss.surface.points import TexelMaps, face_jacobian
from texsss.transport.spread import REACH, sharpness, spread
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled

WIDEST_REACH = 64  # texels; a grid whose kernels are wider is left for a coarser one
COARSEN_AT = 4.0  # standard deviation in texels; half as many leave 6e-4 after interpolating back
SMALLEST_GRID = 8
CROWDED = 0.999  # share of texels whose density counts; a few tiny ones must not widen every kernel
GUTTER_TRACE = 1e-6  # a gutter texel's weight: nothing, unless no covered texel is in reach
TRANSFER = 0.75  # variance of (1 3 3 1)/8, which moves an image between grids [fine texels²]


def diffuse_uv(
    values: Float[Tensor, "P C"],
    texels: TexelMaps,
    variances: Float[Tensor, " K"],
    *,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "K P C"]:
    """`values` convolved with the unit Gaussian of every variance, along u, then v [as `values`].

    `values` are given at the texels of the atlas, gutter included; gutter texels receive the blurred
    value at their place but emit nothing. `variances` [mm²], in any order; 0 gives `values` themselves.
    The metric of every texel turns mm into texels per axis. Charts closer than a kernel's width mix,
    and nothing crosses a seam on purpose.
    Differentiable in `values`. Raises DomainError: when a variance is negative or not finite.
    Source: d'Eon, Luebke & Enderton 2007, with kernels made symmetric (Sinkhorn & Knopp 1967).
    """
    if not bool((torch.isfinite(variances) & (variances >= 0)).all()):
        raise DomainError(f"diffuse_uv: expected variances of 0 or more, got {variances.tolist()}; in mm².")
    if is_grey(values):
        one = diffuse_uv(values[:, :1], texels, variances, progress=progress, cancel=cancel)
        return one.expand(-1, -1, values.shape[1])
    blurred: list[Tensor] = [values] * len(variances)
    order = torch.argsort(variances).tolist()
    grid = _finest(values, texels)
    for step, k in enumerate(order):
        check_cancelled(cancel)
        if progress is not None:
            progress("diffusion", step / len(order))
        variance = float(variances[k])
        if variance > 0:
            grid = _blurred(grid, variance)
            blurred[k] = texels.from_image(_refined(grid, texels.size).permute(1, 2, 0))
    return torch.stack(blurred)


def is_grey(values: Float[Tensor, "P C"]) -> bool:
    """Whether all channels are the same, as under white lights, so that one blur serves them all."""
    if values.shape[1] < 2 or values.requires_grad:
        return False
    return all(torch.equal(values[:, 0], values[:, c]) for c in range(1, values.shape[1]))


@dataclass(frozen=True, eq=False)
class _Grid:
    """An image in the middle of its diffusion, on a grid that may be coarser than the atlas.

    Pairs are (along v, along u). `density`: squared texels of this grid per mm². `spent`: variance
    that the image already has; `owed`: what interpolation to the atlas will add [texels² of this grid].
    `typical`: median density of the covered texels.
    """

    values: Float[Tensor, "C h w"]
    area: Float[Tensor, "h w"]
    density: Float[Tensor, "2 h w"]
    spent: Float[Tensor, "2 h w"]
    owed: tuple[float, float]
    typical: tuple[float, float]
    sizes: tuple[tuple[int, int], ...]  # of the finer grids that this one was made from, finest first


def _finest(values: Float[Tensor, "P C"], texels: TexelMaps) -> _Grid:
    """`values` on the grid of the atlas."""
    height, width = texels.size
    jacobian = face_jacobian(texels.mesh, texels.atlas_uv).detach()
    squared = (jacobian**2).sum(1).flip(-1).to(values.dtype)  # (F, 2), v first [mm² per unit of uv²]
    floor = squared.amax() * 1e-12 + 1e-30  # faces without extent have any number of texels per mm
    density = squared.new_tensor([height**2, width**2]) / squared.clamp_min(floor)
    density = density[texels.points.face.long()]
    area = texels.area.detach().to(values.dtype)
    trace = GUTTER_TRACE * area[texels.covered].mean() if bool(texels.covered.any()) else area.new_tensor(1.0)
    area = torch.where(area > 0, area, trace)
    typical, crowded = _quantiles(density[texels.covered] if bool(texels.covered.any()) else density)
    density = torch.minimum(density, crowded)
    return _Grid(
        values=texels.to_image(values).permute(2, 0, 1),
        area=texels.to_image(area[:, None])[..., 0],
        density=texels.to_image(density).permute(2, 0, 1),
        spent=density.new_zeros(2, height, width),
        owed=(0.0, 0.0),
        typical=(float(typical[0]), float(typical[1])),
        sizes=(),
    )


def _quantiles(density: Float[Tensor, "P 2"]) -> tuple[Float[Tensor, "2"], Float[Tensor, "2"]]:
    """Median and upper bound of the density along v and u, from at most 10⁵ of the texels."""
    ordered = density[:: max(1, len(density) // 100_000)].sort(0).values
    return ordered[len(ordered) // 2], ordered[int(CROWDED * (len(ordered) - 1))]


def _blurred(grid: _Grid, variance: float) -> _Grid:
    """The grid whose image, once refined, has `variance` [mm²]; coarser where that suffices."""
    for axis in (0, 1):
        while grid.typical[axis] * variance >= COARSEN_AT**2 and grid.area.shape[axis] >= 2 * SMALLEST_GRID:
            grid = _coarser(grid, axis)
    for axis in (1, 0):
        step = (grid.density[axis] * variance - grid.owed[axis] - grid.spent[axis]).clamp_min(0)
        step = torch.where(grid.area > 0, step, 0).clamp_max((WIDEST_REACH / REACH) ** 2)
        values = _pass(grid.values, grid.area, step, axis)
        spent = grid.spent.clone()
        spent[axis] += step
        grid = replace(grid, values=values, spent=spent)
    return grid


def _pass(
    values: Float[Tensor, "C h w"], area: Float[Tensor, "h w"], variance: Float[Tensor, "h w"], axis: int
) -> Float[Tensor, "C h w"]:
    """`values` blurred along `axis` by `variance` [texels²]: weighted by area, rows scaled to sum 1."""
    reach = int(torch.ceil(REACH * variance.max().sqrt()))
    if reach == 0:
        return values
    beta = sharpness(variance, reach)
    # one round of balancing: rows that sum to one let columns do so, too, but for .1 %
    total = spread(area[None], beta, reach, axis)
    weight = area * torch.where(total > 0, total, 1).rsqrt()
    spreading = spread(torch.cat([weight * values, weight]), beta, reach, axis)
    received, total = spreading[:-1], spreading[-1:]
    return received / torch.where(total > 0, total, 1)


def _coarser(grid: _Grid, axis: int) -> _Grid:
    """The grid with half as many texels along `axis`; areas add, values are weighted by area."""
    area = _halved(grid.area[None], axis)

    def averaged(image: Tensor) -> Tensor:
        return _halved(image * grid.area, axis) / torch.where(area > 0, area, 1)

    density, spent = averaged(grid.density), averaged(grid.spent)
    density[axis] /= 4
    spent[axis] = torch.where(area[0] > 0, (spent[axis] + TRANSFER) / 4, 0)
    owed, typical = list(grid.owed), list(grid.typical)
    owed[axis] = (owed[axis] + TRANSFER) / 4
    typical[axis] /= 4
    return _Grid(
        values=averaged(grid.values),
        area=area[0],
        density=density,
        spent=spent,
        owed=(owed[0], owed[1]),
        typical=(typical[0], typical[1]),
        sizes=(*grid.sizes, (grid.area.shape[0], grid.area.shape[1])),
    )


def _halved(image: Float[Tensor, "C h w"], axis: int) -> Float[Tensor, "C g x"]:
    """(1 3 3 1)/4 around every other pair along `axis`: the transpose of linear interpolation."""
    length = image.shape[1 + axis]
    along = 2 * (1 - axis)  # pad() counts from the last axis
    image = pad(image, [0] * along + [0, length % 2])
    padded = pad(image[None], [0, 0, 1, 1] if axis == 0 else [1, 1, 0, 0], mode="replicate")[0]
    padded = padded.movedim(1 + axis, -1)
    half = (length + 1) // 2
    a, b, c, d = (padded[..., start : start + 2 * half : 2] for start in range(4))
    return (((a + d) + 3 * (b + c)) / 4).movedim(-1, 1 + axis).contiguous()


def _refined(grid: _Grid, size: tuple[int, int]) -> Float[Tensor, "C H W"]:
    """The image at the resolution of the atlas, by repeated linear interpolation to twice the size.

    All coarse texels around a covered one are covered too, since they received a part of it.
    """
    image = grid.values
    for height, width in reversed(grid.sizes):
        factor = (2 if height > image.shape[1] else 1, 2 if width > image.shape[2] else 1)
        image = interpolate(image[None], scale_factor=factor, mode="bilinear", align_corners=False)[0]
        image = image[:, :height, :width]
    return image
