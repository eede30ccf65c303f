"""From linear radiance to what a display shows."""

from typing import Literal, get_args

import torch

from texsss.errors import DomainError
from texsss.types import Float, Tensor

Name = Literal["linear", "agx", "aces"]
NAMES: tuple[str, ...] = get_args(Name)

# AgX: Rec.709 to its working primaries (rows), as published; 1.4e-4 off neutral before `_neutral`
_AGX_INSET = [
    [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
    [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
    [0.0423756549057051, 0.0784336, 0.879142973793104],
]
_AGX_EV = (-12.47393, 4.026069)  # log2 of scene radiance that the curve spans
_AGX_CURVE = (15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232)  # highest power first

# ACES: Rec.709 to the rendering transform's primaries, and from the display's (rows)
_ACES_IN = [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
_ACES_OUT = [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]


def tonemap(
    image: Float[Tensor, "H W 3"], exposure_ev: float = 0.0, name: str = "agx"
) -> Float[Tensor, "H W 3"]:
    """`image` encoded for an sRGB display, 0..1.

    `image`: linear Rec.709 radiance, first multiplied by 2^exposure_ev. `name`:

    - `linear`: clipped at 1. - `agx`: Sobotka's AgX: highlights desaturate towards white; contrast as
    Wrensch's polynomial. - `aces`: Hill's fit of the ACES reference and output transforms, with the
    exposure as fitted (middle grey comes out darker than by `linear`).

    Neutral stays neutral in all three (the rows of the published matrices are scaled to sum 1, by at
    most 1.4e-4), and brighter never comes out darker. Differentiable where it is not clipped.
    Raises DomainError: when the name is unknown.
    Source: Troy Sobotka 2022, AgX; Benjamin Wrensch 2023, "Minimal AgX implementation"; Stephen Hill,
    ACES fit in MJP's BakingLab.
    """
    if name not in NAMES:
        raise DomainError(f"tonemap: expected one of {', '.join(NAMES)}, got {name!r}.")
    light = torch.nan_to_num(image, posinf=torch.finfo(image.dtype).max).clamp_min(0) * 2.0**exposure_ev
    light = light.clamp_max(1e6)  # beyond every white point; the fits square it
    if name == "linear":
        return encode(light)
    return _agx(light) if name == "agx" else encode(_aces(light))


def encode(image: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W 3"]:
    """Linear Rec.709, clipped to 0..1, as sRGB values."""
    from kornia.color import linear_rgb_to_rgb  # all of kornia comes with it: half a second

    return linear_rgb_to_rgb(image.clamp(0, 1).permute(2, 0, 1)).permute(1, 2, 0)


def decode(image: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W 3"]:
    """sRGB values in 0..1 as linear Rec.709."""
    from kornia.color import rgb_to_linear_rgb

    return rgb_to_linear_rgb(image.clamp(0, 1).permute(2, 0, 1)).permute(1, 2, 0)


def _agx(light: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W 3"]:
    inset = _neutral(_AGX_INSET, light)
    low, high = _AGX_EV
    level = torch.log2((light @ inset.T).clamp_min(2.0**low))
    level = ((level - low) / (high - low)).clamp(0, 1)
    value = torch.zeros_like(level)
    for factor in _AGX_CURVE:  # Horner
        value = value * level + factor
    # the outset brings saturation back; like Wrensch's it acts on encoded values
    return (value @ torch.linalg.inv(inset).T).clamp(0, 1)


def _aces(light: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W 3"]:
    x = light @ _neutral(_ACES_IN, light).T
    x = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081)
    return x @ _neutral(_ACES_OUT, light).T


def _neutral(rows: list[list[float]], like: Tensor) -> Float[Tensor, "3 3"]:
    """The matrix with rows that sum to 1, so that grey stays grey."""
    matrix = torch.tensor(rows, dtype=torch.float64)
    return (matrix / matrix.sum(1, keepdim=True)).to(like)
