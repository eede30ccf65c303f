"""Layered textures with depth parallax: an outer layer to look through, inner ones that shift."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import torch
from torch.nn.functional import interpolate

from texsss.errors import DomainError, ShapeError
from texsss.numerics.sampling import Texture, bilinear
from texsss.types import Float, Tensor, unit

Blur = Callable[[Float[Tensor, "H W C"], float], Float[Tensor, "H W C"]]
"""A Gaussian blur of an image by a deviation [texels]."""

LEAST_DOWN = 0.05  # of the transmission vector's z: at grazing angles the shift stays finite


@dataclass(frozen=True, eq=False)
class InnerLayer:
    """A flat layer below the surface: `base` (H, W, 3) linear colour, tiled; `depth_mm` below the one above.

    `opacity` (H, W, 1), 0..1: of layers that have another one below; None is opaque. `spread`: radius
    of the blur of `base` per distance looked through, mm per mm. `copies`: `base`, and blurred ones whose
    deviations double, from one texel of its longer side to the whole tile.
    """

    base: Float[Tensor, "H W 3"]
    depth_mm: float
    opacity: Float[Tensor, "h w 1"] | None = None
    spread: float = 0.25
    copies: tuple[Texture, ...] = field(init=False)

    def __post_init__(self):
        if not (0 <= self.depth_mm < float("inf") and 0 <= self.spread < float("inf")):
            raise DomainError(
                f"InnerLayer: expected a finite depth [mm] and spread >= 0, got "
                f"{self.depth_mm:g} and {self.spread:g}."
            )
        object.__setattr__(self, "copies", _copies(self.base))


def transmission(view: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
    """Unit vector from the surface to the inner layer, in tangent space (z outwards).

    `view`: unit, to the eye; `normal`: from the normal map. The view is mirrored about the normal and
    then about the surface, so that a bumpy surface bends it. Its z is at most -LEAST_DOWN before it is
    scaled to unit length. Differentiable. Source: Oat 2006; Norberg 2010, eqs. 15 and 16.
    """
    mirrored = 2 * (view * normal).sum(-1, keepdim=True) * normal - view
    return unit(torch.cat([mirrored[:, :2], -mirrored[:, 2:].abs().clamp_min(LEAST_DOWN)], -1))


def shade_layers(
    uv: Float[Tensor, "P 2"],
    uv_per_mm: Float[Tensor, "P 2 2"],
    view: Float[Tensor, "P 3"],
    normal: Float[Tensor, "P 3"],
    outer: Float[Tensor, "P 3"],
    opacity: Float[Tensor, "P 1"],
    outer_light: Float[Tensor, "P 3"],
    inner: Sequence[InnerLayer],
    inner_light: Sequence[Float[Tensor, "P 3"]],
    specular: Float[Tensor, "P 3"] | None = None,
    across: Callable[[Float[Tensor, "P 2"]], Float[Tensor, "P 2"]] | None = None,
) -> Float[Tensor, "P 3"]:
    """Colour of an outer layer over inner ones, as far as it lets see through [units of the lights].

    `uv`, and `uv_per_mm` (P, 2, 2): texture coordinates and their change per mm along the tangent
    frame, as rows (u, v) × columns (T, B). `view`, `normal`: unit, tangent space. `outer` colour and
    `opacity` (1 hides what is below) of the surface, lit by `outer_light`. `inner_light`: for each
    layer of `inner`, from the surface down, the lightmap blurred for its depth. `specular` is added.
    `across`: where the points come to when they move by as much in uv, as `Onward.at` knows of meshes with
    seams; straight on if None.
    Seen at a grazing angle, the outer layer wins. Differentiable in all tensors.
    Raises ShapeError: when layers and lights differ in number. Source: Oat 2006; Norberg 2010, 2.2.
    """
    if len(inner) != len(inner_light):
        raise ShapeError(
            f"parallax: expected a lightmap per inner layer, got {len(inner_light)} for {len(inner)}; "
            "blur one for each."
        )
    down = transmission(view, normal)
    per_depth = 1 / -down[:, 2:]
    facing = (view * normal).sum(-1, keepdim=True).clamp(0, 1)
    colour = outer * outer_light
    # share of the picture that is still open to the layers below
    seen = torch.ones_like(opacity)
    through = (1 - opacity) * facing
    total = torch.zeros_like(colour)
    depth = 0.0
    for layer, light in zip(inner, inner_light):
        total = total + seen * (1 - through) * colour
        seen = seen * through
        depth += layer.depth_mm
        distance = depth * per_depth  # s = d / |T_z|
        shift = (uv_per_mm @ (distance * down[:, :2])[..., None])[..., 0]
        place = uv + shift if across is None else across(shift)
        radius = layer.spread * distance * torch.linalg.matrix_norm(uv_per_mm)[:, None] / 2**0.5
        colour = _blurred(layer, place, radius[:, 0]) * light
        if layer.opacity is None:
            through = torch.zeros_like(opacity)
        else:
            through = (1 - bilinear(layer.opacity.to(colour), place, wrap="repeat")) * facing
    # the last layer hides whatever would be below it
    total = total + seen * colour
    return total if specular is None else total + specular


def opacity_from_photograph(
    photograph: Float[Tensor, "H W 3"],
    *,
    least: float = 0.2,
    most: float = 0.9,
    detail_texels: float = 8.0,
    blur: Blur | None = None,
) -> Float[Tensor, "H W 1"]:
    """Opacity of a skin in `least`..`most`, from its photograph alone: pale and even is see-through.

    Local contrast (freckles, hairs, wrinkles; below `detail_texels`) and darkness make opaque. Linear
    colour, tiled, unless `blur` knows its charts, as `Beyond.smoothed` does. Differentiable.
    Raises DomainError: unless 0 <= least <= most <= 1.
    Source: Norberg 2010, 2.2, who used filters of GIMP; ours are these.
    """
    if not 0 <= least <= most <= 1:
        raise DomainError(
            f"opacity: expected 0 <= least <= most <= 1, got {least:g} and {most:g}; 1 hides what is below."
        )
    grey = _grey(photograph)
    detail = (grey - (_smoothed if blur is None else blur)(grey, detail_texels)).abs()
    spread = detail.mean().clamp_min(1e-6)
    rough = detail / (detail + 2 * spread)
    dark = 1 - grey / grey.amax().clamp_min(1e-6)
    return least + (most - least) * (1 - (1 - rough) * (1 - 0.5 * dark))


def normals_from_photograph(
    photograph: Float[Tensor, "H W 3"], *, strength: float = 1.0, detail_texels: float = 16.0
) -> Float[Tensor, "H W 3"]:
    """Unit normals in tangent space (x along u, y along v, z outwards): brightness read as height.

    Variations broader than `detail_texels` are taken for colour and left out. `strength` scales
    slopes; the typical one is then that number times 0.2. Linear colour, tiled. Differentiable.
    Raises DomainError: for a strength that is negative or not finite.
    Source: the usual emboss filter, as in Norberg 2010, 2.2.
    """
    if not 0 <= strength < float("inf"):
        raise DomainError(
            f"normals: expected a finite strength >= 0, got {strength:g}; 1 is usual, 0 makes them flat."
        )
    grey = _grey(photograph)[..., 0]
    height = grey - _smoothed(grey[..., None], detail_texels)[..., 0]
    along_u = (height.roll(-1, 1) - height.roll(1, 1)) / 2
    along_v = (height.roll(-1, 0) - height.roll(1, 0)) / 2
    typical = torch.sqrt((along_u**2 + along_v**2).mean()).clamp_min(1e-6)
    slope = 0.2 * strength / typical
    return unit(torch.stack([-along_u * slope, -along_v * slope, torch.ones_like(height)], -1))


def _grey(image: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W 1"]:
    """Luminance, Rec. 709."""
    return (image * image.new_tensor([0.2126, 0.7152, 0.0722])).sum(-1, keepdim=True)


def _smoothed(
    image: Float[Tensor, "H W C"], down: float, along: float | None = None
) -> Float[Tensor, "H W C"]:
    """Gaussian blur of a tile, exact in frequency space; deviations [texels] down, and along unless alike."""
    height, width, _ = image.shape
    fy = torch.fft.fftfreq(height, dtype=image.dtype, device=image.device)[:, None]
    fx = torch.fft.rfftfreq(width, dtype=image.dtype, device=image.device)
    along = down if along is None else along
    decay = torch.exp(-2 * torch.pi**2 * ((along * fx) ** 2 + (down * fy) ** 2))
    return torch.fft.irfft2(
        torch.fft.rfft2(image, dim=(0, 1)) * decay[..., None], s=(height, width), dim=(0, 1)
    )


def _copies(base: Float[Tensor, "H W 3"]) -> tuple[Texture, ...]:
    """`base` and blurred copies of it; the blurrier, the fewer texels they need."""
    height, width, _ = base.shape
    images = [base]
    for k in range(max(height, width).bit_length() - 1):
        # as wide in uv along both sides; four texels of a copy span a deviation
        deviations = [2.0**k * side / max(height, width) for side in (height, width)]
        size = tuple(max(1, int(n / max(1, d / 4))) for n, d in zip((height, width), deviations, strict=True))
        planes = _smoothed(base, *deviations).permute(2, 0, 1)[None]
        images.append(interpolate(planes, size=size, mode="area")[0].permute(1, 2, 0))
    return tuple(Texture.of(image, "repeat") for image in images)


def _blurred(
    layer: InnerLayer, uv: Float[Tensor, "P 2"], radius: Float[Tensor, " P"]
) -> Float[Tensor, "P 3"]:
    """Look-ups in a tiled image, each blurred by a Gaussian of its own standard deviation [uv].

    Between the two nearest of a few blurred copies, whose deviations double.
    """
    texels = radius * max(layer.base.shape[:2])
    # copy 0 is sharp, copy k has a deviation of 2^(k-1) texels
    level = torch.where(texels < 1, texels, 1 + torch.log2(texels.clamp_min(1)))
    level = level.clamp(0, len(layer.copies) - 1)
    total = uv.new_zeros(len(uv), 3, dtype=layer.base.dtype)
    for k, copy in enumerate(layer.copies):
        weight = (1 - (level - k).abs()).clamp_min(0)
        total = total + weight[:, None] * copy.at(uv)
    return total
