"""Depth textures, in which four layers share the channels of one image, to stacks and back."""

from collections.abc import Sequence

import torch

from texsss.errors import DomainError, ShapeError
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.types import Float, Tensor

ROUNDING = 1e-3  # beyond 0..1, of values that were resampled


def stack_from_depths(
    textures: Sequence[Float[Tensor, "H W D"]],
    media: Sequence[Medium],
    range_mm: tuple[float, float],
    *,
    invert: bool = False,
    infinite: bool = False,
) -> Stack:
    """The layers that depth textures describe.

    Channel i of the concatenated `textures` (values 0..1, four per RGBA image) is the depth of the lower
    boundary of layer i; `range_mm` says what 0 and 1 mean [mm], exchanged by `invert`. A boundary above
    the one before it is taken to touch it. `infinite`: one more medium lies beneath all. Differentiable.
    Raises ShapeError: for sizes that differ or too few channels; DomainError: for a range that is none, or
    values that are not 0..1.
    """
    low, high = range_mm
    if not (0 <= low <= high and high < float("inf")):
        raise DomainError(
            f"Depth texture: expected a range 0 <= low <= high [mm], got {low:g}..{high:g}; "
            "say how deep black and white are, and use invert to exchange them."
        )
    if not textures:
        raise ShapeError("Depth texture: expected at least one image, got none; a Stack needs no texture.")
    sizes = {tuple(t.shape[:2]) for t in textures}
    if len(sizes) != 1:
        raise ShapeError(f"Depth texture: expected images of one size, got {sorted(sizes)}; resize them.")
    values = torch.cat(list(textures), -1)
    finite = len(media) - infinite
    if not 0 < finite <= values.shape[-1]:
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
    depth = torch.cummax(depth, -1).values
    thickness = torch.diff(depth, dim=-1, prepend=torch.zeros_like(depth[..., :1]))
    layers = [Layer(medium, thickness[..., i]) for i, medium in enumerate(media[:finite])]
    return Stack([*layers, Layer(media[-1])] if infinite else layers)


def depths_of(
    stack: Stack, range_mm: tuple[float, float], *, invert: bool = False
) -> list[Float[Tensor, "H W 4"]]:
    """RGBA depth textures of the finite layers of `stack`, the inverse of `stack_from_depths`.

    Depths beyond `range_mm` are clamped to it; channels without a layer repeat the last. Of thickness
    per channel the mean is taken. Uniform stacks give textures of one texel.
    """
    low, high = range_mm
    if not 0 <= low < high:
        raise DomainError(f"Depth texture: expected a range 0 <= low < high [mm], got {low:g}..{high:g}.")
    thickness = stack.table().thickness.mean(-1)
    thickness = thickness[..., : len(stack.layers) - (stack.layers[-1].thickness is None)]
    if thickness.shape[-1] == 0:
        raise ShapeError(
            "Depth texture: expected at least one finite layer, got none; an infinite one has no depth."
        )
    depth = torch.cumsum(thickness, -1)
    values = ((depth - low) / (high - low)).clamp(0, 1)
    values = 1 - values if invert else values
    values = values if values.ndim == 3 else values[None, None]
    missing = -values.shape[-1] % 4
    values = torch.cat([values, values[..., -1:].expand(*values.shape[:2], missing)], -1)
    return list(values.split(4, -1))
