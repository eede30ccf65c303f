"""What the operators of surface diffusion take in memory, before they are built."""

import math

import torch

from texsss.surface.points import TexelMaps
from texsss.transport.operators import BLOCKS_AT, ENTRIES, POINTS, REACH, SOURCES, TEXELS_TO, fine_texel
from texsss.types import Bool, Float, Tensor

ENTRY_BYTES = 8  # an int32 index and a float32 value
SHARED_ENTRIES = 10  # per texel for all above the texels: blocks and the way back
NARROW_ENTRIES = 18 + 30  # per texel for the narrowest: kernels, and all pairs that they are chosen from
MIDDLE_ENTRIES = 30  # per texel from blocks to texels
WIDE_ENTRIES = 4  # per texel beside the kernel: from clusters and to them


def affordable(
    texels: TexelMaps, variances: Float[Tensor, " K"], budget_bytes: float | int
) -> Bool[Tensor, " K"]:
    """Which Gaussians have surface operators within `budget_bytes`: the widest, as far as it goes.

    Seams show the more the wider the Gaussian. Variances of 0 cost nothing. An upper bound for evenly
    sized texels, without the transposes that gradients need.
    """
    texel = fine_texel(texels)
    spread = 2 * math.pi * (REACH * SOURCES * POINTS) ** 2 * float(texels.area.sum()) / len(texels)
    left = budget_bytes / (ENTRY_BYTES * len(texels)) - SHARED_ENTRIES
    fits = torch.zeros(len(variances), dtype=torch.bool)
    for k in torch.argsort(variances, descending=True).tolist():
        variance = float(variances[k])
        deviation = variance**0.5 / texel
        if deviation > BLOCKS_AT:
            left -= min(ENTRIES, spread / variance) + WIDE_ENTRIES
        elif deviation > TEXELS_TO:
            left -= MIDDLE_ENTRIES
        elif deviation > 0:
            left -= NARROW_ENTRIES
        fits[k] = left >= 0
    return fits
