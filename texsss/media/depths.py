"""Depth textures, in which four layers share the channels of one image, to stacks and back."""

from collections.abc import Sequence
from typing import Any

import torch

from texsss.errors import DomainError, ShapeError
from texsss.media.medium import Medium, expect, told
from texsss.media.stack import Layer, Stack
from texsss.types import Float, Tensor

SLACK = 1e-6  # share of the deepest boundary by which channels may decrease: what 32 bits lose
ROUNDING = 1e-3  # beyond 0..1, of values that were resampled


def stack_from_depths(
    textures: Sequence[Float[Tensor, "H W _"]],
    media: Sequence[Medium],
    range_mm: tuple[float | int, float | int],
    *,
    invert: bool = False,
    infinite: bool = False,
    sort: bool = False,
    names: Sequence[str] | None = None,
) -> Stack:
    """The layers that depth textures describe.

    Channel i of the concatenated `textures` (values 0..1, four per RGBA image) is the depth of the lower
    boundary of layer i; `range_mm` says what 0 and 1 mean [mm], exchanged by `invert`. `sort` puts
    the boundaries of every texel in order. `infinite`: one more medium lies beneath all. `names` of the
    channels, for messages. Differentiable.
    Raises ShapeError: for sizes that differ or too few channels; DomainError: for a range that is none,
    values that are not 0..1, a channel that lies above the one before it, unless they are sorted, and for
    what is no image or medium.
    """
    low, high = _ends(range_mm)
    for given, what in ((textures, "a list of images"), (media, "a list of media")):
        expect("Depth texture", given, (list, tuple), what)
    if not (0 <= low <= high and high < float("inf")):
        raise DomainError(
            f"Depth texture: expected a range 0 <= low <= high [mm], got {low:g}..{high:g}; "
            "say how deep black and white are, and use invert to exchange them."
        )
    check_images(textures)
    for medium in media:
        expect("Depth texture", medium, Medium, "media, one per layer")
    sizes = {tuple(t.shape[:2]) for t in textures}
    if len(sizes) != 1:
        listed = " and ".join(f"{width} × {height}" for height, width in sorted(sizes))
        raise ShapeError(f"Depth texture: expected images of one size, got {listed}; resize them.")
    values = torch.cat(list(textures), -1)
    finite = len(media) - infinite
    if finite < 1:
        raise ShapeError(
            f"Depth texture: expected media for one layer at least{', and one beneath' if infinite else ''}, "
            f"got {len(media)}; add media."
        )
    if finite > values.shape[-1]:
        raise ShapeError(
            f"Depth texture: expected one channel for each of {finite} layers, got {values.shape[-1]}; "
            "add an image."
        )
    values = values[..., :finite]
    least, most = (float(x) for x in values.detach().aminmax())
    if not (least >= -ROUNDING and most <= 1 + ROUNDING):
        raise DomainError(
            f"Depth texture: expected values in 0..1, got {least:g}..{most:g}; divide those of 8 bits "
            "by 255; the range says what they are in mm."
        )
    depth = low + (high - low) * (1 - values if invert else values)
    depth = in_order(depth, sort, names)
    thickness = torch.diff(depth, dim=-1, prepend=torch.zeros_like(depth[..., :1]))
    layers = [Layer(medium, thickness[..., i]) for i, medium in enumerate(media[:finite])]
    return Stack([*layers, Layer(media[-1])] if infinite else layers)


def check_images(textures: Sequence[Any]) -> None:
    """Raises ShapeError or DomainError: for what are no images, or none at all."""
    if not textures:
        raise ShapeError("Depth texture: expected at least one image, got none; a Stack needs no texture.")
    for texture in textures:
        expect("Depth texture", texture, Tensor, "images as tensors (H, W, channels)")
        check_real(texture)
        if texture.ndim != 3 or 0 in texture.shape:
            raise ShapeError(
                f"Depth texture: expected images (H, W, channels), got shape {tuple(texture.shape)}; "
                "add an axis to a grey one: image[..., None]."
            )


def check_real(depth: Tensor) -> None:
    """Raises DomainError: for complex numbers."""
    if depth.is_complex():
        raise DomainError("Depth texture: expected real numbers, got complex ones; take their real part.")


def in_order(
    depth: Float[Tensor, "H W B"],
    sort: bool = False,
    names: Sequence[str] | None = None,
    remedy: str = 'sort them (sort=True, in scenes "sort": true), or invert the grey scale',
) -> Float[Tensor, "H W B"]:
    """Depths [mm] that rise from channel to channel; put in order where `sort` asks for it.

    `remedy`: what the message advises. Differentiable.
    Raises DomainError, naming the channels: when one lies above the one before it.
    """
    if sort:
        return depth.sort(-1).values
    seen = depth.detach()
    slack = SLACK * float(seen.amax())
    named = names or [str(i) for i in range(seen.shape[-1])]
    for i in range(seen.shape[-1] - 1):
        above = seen[..., i] - seen[..., i + 1] > slack
        if bool(above.any()):
            where = above.nonzero()[0].tolist()
            raise DomainError(
                f"Depth texture: expected channel {named[i + 1]} to lie below channel {named[i]}, got "
                f"{float(seen[*where, i + 1]):g} mm under {float(seen[*where, i]):g} mm "
                f"at texel {tuple(where)} and {int(above.sum()) - 1} others; {remedy}."
            )
    return depth.cummax(-1).values


def depths_of(
    stack: Stack, range_mm: tuple[float | int, float | int], *, invert: bool = False
) -> list[Float[Tensor, "H W 4"]]:
    """RGBA depth textures of the finite layers of `stack`, the inverse of `stack_from_depths`.

    Depths beyond `range_mm` are clamped to it; channels without a layer repeat the last. Of thickness
    per channel the mean is taken. Uniform stacks give textures of one texel. Differentiable.
    Raises ShapeError: without a finite layer; DomainError: for a range that is none.
    """
    stack = stack if isinstance(stack, Stack) else Stack(stack)
    values = scaled(boundaries(stack), range_mm, invert)
    missing = -values.shape[-1] % 4
    values = torch.cat([values, values[..., -1:].expand(*values.shape[:2], missing)], -1)
    return list(values.split(4, -1))


def boundaries(stack: Stack) -> Float[Tensor, "H W L"]:
    """Depth [mm] of the lower boundary of every finite layer; of thickness per channel the mean.

    Raises ShapeError: without any.
    """
    thickness = stack.table().thickness.mean(-1)
    thickness = thickness[..., : len(stack.layers) - (stack.layers[-1].thickness is None)]
    if thickness.shape[-1] == 0:
        raise ShapeError(
            "Depth texture: expected at least one finite layer, got none; an infinite one has no depth."
        )
    depth = torch.cumsum(thickness, -1)
    return depth if depth.ndim == 3 else depth[None, None]


def scaled(
    depth: Float[Tensor, "H W L"], range_mm: tuple[float | int, float | int], invert: bool
) -> Float[Tensor, "H W L"]:
    """Depths [mm] as values 0..1 of `range_mm`, clamped to it. Raises DomainError: for no such range."""
    low, high = _ends(range_mm)
    if not 0 <= low < high < float("inf"):
        raise DomainError(
            f"Depth texture: expected a range 0 <= low < high [mm], got {low:g}..{high:g}; "
            "it says how deep black and white are."
        )
    values = ((depth - low) / (high - low)).clamp(0, 1)
    return 1 - values if invert else values


def _ends(range_mm: tuple[float | int, float | int]) -> tuple[float, float]:
    """The two numbers of a range. Raises DomainError: for something else."""
    try:
        low, high = (float(end) for end in range_mm)
    except (TypeError, ValueError):
        raise DomainError(
            f"Depth texture: expected a range of two numbers (low, high) [mm], got {told(range_mm)}; "
            "it says how deep black and white are."
        ) from None
    return low, high
