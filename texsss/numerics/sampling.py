"""Bilinear look-ups in images, with texsss' convention for texel centres."""

from typing import Literal

import torch

from texsss.types import Float, Tensor


def bilinear(
    image: Float[Tensor, "H W C"], uv: Float[Tensor, "P 2"], wrap: Literal["clamp", "repeat"] = "clamp"
) -> Float[Tensor, "P C"]:
    """Values of `image` at `uv`, interpolated bilinearly between texel centres.

    Texel (i, j) has its centre at ((j + ½)/W, (i + ½)/H), v down. Outside the square the image is
    continued by its edge (`clamp`) or tiled (`repeat`). Differentiable in `image` and `uv`.
    """
    height, width, channels = image.shape
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
    left, top = torch.floor(x), torch.floor(y)
    fx, fy = (x - left)[:, None], (y - top)[:, None]

    def axis(start: Tensor, size: int) -> tuple[Tensor, Tensor]:
        if wrap == "repeat":
            return (start % size).long(), ((start + 1) % size).long()
        return start.clamp(0, size - 1).long(), (start + 1).clamp(0, size - 1).long()

    (x0, x1), (y0, y1) = axis(left, width), axis(top, height)
    flat = image.reshape(-1, channels)
    upper = torch.lerp(flat[y0 * width + x0], flat[y0 * width + x1], fx.to(image.dtype))
    lower = torch.lerp(flat[y1 * width + x0], flat[y1 * width + x1], fx.to(image.dtype))
    return torch.lerp(upper, lower, fy.to(image.dtype))
