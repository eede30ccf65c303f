"""Names, units and signs, said once.

Units       lengths mm, coefficients 1/mm, angles radians, colour linear Rec.709 RGB;
            irradiance and exitance W/m², intensity W/sr, radiance W/(m² sr).
World       y up, front +z. Directions point away from the surface.
`eta`       refractive index inside / outside, always.
`variance`  of a Gaussian, per axis [mm²]; `sigma` is only ever a coefficient.
uv          u right, v down: texel (i, j) has its centre at ((j + ½)/W, (i + ½)/H).
Shapes      P points · H W images · V F mesh · U table rows · C channels · K Gaussians ·
            L layers · S frequencies · R radii · N lights. Images are H W C, point data P C.
"""

from collections.abc import Callable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from texsss.errors import Cancelled

__all__ = ["Bool", "Cancel", "Float", "Int", "Progress", "Tensor", "check_cancelled", "chunks"]

Progress = Callable[[str, float], None]
"""Called as progress(stage, fraction in 0..1) by long stages."""

Cancel = Callable[[], bool]
"""Asked between steps of every long loop; True stops it with `Cancelled`."""


def check_cancelled(cancel: Cancel | None) -> None:
    """Raises Cancelled if `cancel` says so."""
    if cancel is not None and cancel():
        raise Cancelled("texsss: stopped on request; nothing was written.")


def chunks(count: int, size: int) -> list[slice]:
    """Slices of at most `size` that cover range(count) in order."""
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


def unit(x: Float[Tensor, "*B 3"]) -> Float[Tensor, "*B 3"]:
    """`x` scaled to length 1; vectors of length 0 stay 0."""
    return x / torch.linalg.vector_norm(x, dim=-1, keepdim=True).clamp_min(1e-30)
