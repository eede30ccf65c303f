"""What the operators of surface diffusion take in memory, before they are built."""

import torch

from texsss.surface.points import TexelMaps
from texsss.transport.operators import GRID_ENTRIES, GRID_FROM
from texsss.types import Bool, Float, Tensor

ENTRY_BYTES = 8  # an int32 index and a float32 value
NARROW_ENTRIES = 40  # per texel and Gaussian up to GRID_FROM; measured 21 to 28 on a head
OWN_ENTRIES = 5  # per texel and wide Gaussian: moments
SHARED_ENTRIES = 8  # per texel for all wide ones: interpolation


def affordable(
    texels: TexelMaps, variances: Float[Tensor, " K"], budget_bytes: float | int
) -> Bool[Tensor, " K"]:
    """Which Gaussians have surface operators within `budget_bytes`: the widest, as far as it goes.

    Seams show the more the wider the Gaussian. Variances of 0 cost nothing. An upper bound for evenly
    sized texels, without the transposes, as large again, that gradients need.
    """
    per_texel = ENTRY_BYTES * len(texels)
    left = budget_bytes - SHARED_ENTRIES * per_texel
    fits = torch.zeros(len(variances), dtype=torch.bool)
    for k in torch.argsort(variances, descending=True).tolist():
        deviation = float(variances[k]) ** 0.5
        wide = deviation > GRID_FROM * texels.texel_mm
        entries = GRID_ENTRIES + OWN_ENTRIES if wide else NARROW_ENTRIES
        left -= entries * per_texel if deviation > 0 else 0
        fits[k] = left >= 0
    return fits
