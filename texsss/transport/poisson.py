"""Blur by a Poisson disc of samples, in passes and at reduced resolution, as real-time engines began."""

import math

import torch
from torch.nn.functional import avg_pool2d, grid_sample, interpolate, pad

from texsss.errors import DomainError
from texsss.surface.metric import texel_mm_per_axis
from texsss.surface.points import TexelMaps
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled

CANDIDATES = 40  # darts per sample, of which the one farthest from all others stays
# of the square that a disc's radius may take: tiny faces have any number of texels per mm
WIDEST_SHARE = 0.25
GUTTER_TRACE = 1e-4  # a gutter texel's weight: it is blurred, and shines on no other to speak of
TURN = math.pi * (3 - math.sqrt(5))  # from pass to pass, so that the disc's pattern does not repeat


def poisson_disc(count: int, seed: int = 0) -> Float[Tensor, "N 2"]:
    """`count` points of a disc, far from each other, whose mean is 0 and whose variance per axis is 1.

    Raises DomainError: when there is none to place. Source: Mitchell 1991 (best candidate); Cook 1986.
    """
    if count < 1:
        raise DomainError(f"poisson: expected at least 1 sample in the disc, got {count}; 12 serve well.")
    generator = torch.Generator().manual_seed(seed)
    chosen = torch.zeros(1, 2)
    while len(chosen) < count:
        radius, angle = torch.rand(2, CANDIDATES * len(chosen), generator=generator)
        radius, angle = radius.sqrt(), angle * 2 * math.pi
        darts = torch.stack([radius * angle.cos(), radius * angle.sin()], 1)
        best = torch.cdist(darts, chosen).amin(1).argmax()
        chosen = torch.cat([chosen, darts[best : best + 1]])
    chosen = chosen - chosen.mean(0)
    spread = chosen.square().sum() / (2 * count)
    return chosen / spread.sqrt() if count > 1 else chosen


def diffuse_poisson(
    values: Float[Tensor, "P C"],
    texels: TexelMaps,
    variances: Float[Tensor, " K"],
    *,
    taps: int = 12,
    passes: int = 2,
    reduction: int = 2,
    seed: int = 0,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "K P C"]:
    """`values` blurred by discs of `taps` samples, as wide as Gaussians of `variances` [mm²].

    Every pass takes the mean of the texels at the disc's points around each one, its radius in texels
    as the metric has it along u and v; `passes` share the variance. Computed on an image `reduction`
    times smaller. Stops at seams, and knows no shear. Empty texels are left out of the means.
    Differentiable in `values`. Raises DomainError: for taps, passes or a reduction below 1, or a variance
    that is negative or not finite; Cancelled.
    Source: Oat 2006; Norberg 2010, sections 2.2 and 4.2 (passes, reduced resolution).
    """
    if passes < 1 or reduction < 1:
        raise DomainError(
            f"poisson: expected passes and reduction >= 1, got {passes} and {reduction}; 2 serve well."
        )
    if not bool((torch.isfinite(variances) & (variances >= 0)).all()):
        raise DomainError(f"poisson: expected variances of 0 or more, got {variances.tolist()}; in mm².")
    disc = poisson_disc(taps, seed).to(values)
    lit = torch.where(texels.covered, 1, GUTTER_TRACE)[:, None].to(values)
    scale = (1 / texel_mm_per_axis(texels).detach().clamp_min(1e-12)).to(values)  # texels per mm
    image = _reduced(texels.to_image(torch.cat([values * lit, scale * lit, lit], 1)), reduction)
    cover = image[-1:]
    filled = torch.where(cover > 0, cover, 1)
    light, per_mm = image[:-3] / filled, image[-3:-1] / filled / reduction
    copies = []
    for k, variance in enumerate(variances.tolist()):
        blurred = light
        for number in range(passes if variance > 0 else 0):
            check_cancelled(cancel)
            step = math.sqrt(variance / passes) * _turned(disc, number * TURN)
            blurred = _pass(blurred, cover, per_mm, step)
            if progress is not None:
                progress("poisson", (k * passes + number + 1) / (len(variances) * passes))
        copies.append(_enlarged(blurred, cover, texels, reduction) if variance > 0 else values)
    return torch.stack(copies)


def _pass(
    light: Float[Tensor, "C h w"],
    cover: Float[Tensor, "1 h w"],
    per_mm: Float[Tensor, "2 h w"],
    disc: Float[Tensor, "N 2"],
) -> Float[Tensor, "C h w"]:
    """The mean of `light` over a disc [mm] around every texel, as far as there is a surface."""
    height, width = cover.shape[1:]
    weighted = torch.cat([light * cover, cover])[None]
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    place = torch.stack([x, y], -1).to(light) + 0.5
    size = light.new_tensor([width, height])
    most = WIDEST_SHARE * size / disc.abs().amax().clamp_min(1e-12)
    radius = torch.minimum(per_mm.permute(1, 2, 0), most)  # texels per mm
    total = torch.zeros_like(weighted)
    for offset in disc:
        at = (place + radius * offset) / size * 2 - 1
        total = total + grid_sample(weighted, at[None], align_corners=False, padding_mode="zeros")
    total = total[0]
    found = total[-1:] > 1e-9
    return torch.where(found, total[:-1] / torch.where(found, total[-1:], 1), light)


def _reduced(image: Float[Tensor, "H W D"], reduction: int) -> Float[Tensor, "D h w"]:
    """The image, channels first, averaged over squares of `reduction` texels, empty beyond its edges."""
    height, width = image.shape[:2]
    planes = pad(image.permute(2, 0, 1), (0, -width % reduction, 0, -height % reduction))
    return avg_pool2d(planes, reduction)


def _enlarged(
    light: Float[Tensor, "C h w"], cover: Float[Tensor, "1 h w"], texels: TexelMaps, reduction: int
) -> Float[Tensor, "P C"]:
    """The reduced image at the texels, bilinearly between those with a surface."""
    weighted = torch.cat([light * cover, cover])[None]
    large = interpolate(weighted, scale_factor=float(reduction), mode="bilinear", align_corners=False)[0]
    large = large[:, : texels.size[0], : texels.size[1]]
    near = texels.from_image(large.permute(1, 2, 0))  # every texel's own square has some cover
    return near[:, :-1] / near[:, -1:]


def _turned(disc: Float[Tensor, "N 2"], angle: float) -> Float[Tensor, "N 2"]:
    cos, sin = math.cos(angle), math.sin(angle)
    return disc @ disc.new_tensor([[cos, -sin], [sin, cos]])
