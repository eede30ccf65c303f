"""What the operators of surface diffusion take in memory, before they are built."""

import math

import torch

from texsss.surface.points import TexelMaps
from texsss.transport.gutter import BYTES as gutter_bytes
from texsss.transport.operators import LATTICE_FROM, edge_for, fine_texel
from texsss.transport.smoothing import REACH
from texsss.types import Bool, Float, Tensor

ENTRY_BYTES = 8  # an int32 index and a float32 value
CROWDED = 1.3  # texels are that much denser than typical ones where kernels are counted
NODES = 2.7  # of a lattice per edge² of surface
PASSES = 26  # entries per node of three convolutions, times edges per standard deviation
WAYS = 16  # entries per point between it and the next lattice, there and back
MAKING = 25  # entries' worth of room, per texel, that making those ways takes


def affordable(
    texels: TexelMaps, variances: Float[Tensor, " K"], budget_bytes: float | int
) -> Bool[Tensor, " K"]:
    """Which Gaussians have surface operators within `budget_bytes`: the widest, as far as it goes.

    Seams show the more the wider the Gaussian. Variances of 0 cost nothing. An upper bound for evenly
    sized texels, what building takes included.
    """
    texel = fine_texel(texels)
    gutter = (len(texels) - texels.covered_count) * gutter_bytes
    left = (budget_bytes - gutter) / (ENTRY_BYTES * max(texels.covered_count, 1))
    kept, making = 0.0, 0.0
    fits = torch.zeros(len(variances), dtype=torch.bool)
    for k in torch.argsort(variances, descending=True).tolist():
        deviation = float(variances[k]) ** 0.5 / texel
        if deviation >= LATTICE_FROM:
            edge = edge_for(deviation, 1.0)
            nodes = min(8.0, NODES / edge**2)
            kept += nodes * (PASSES * deviation / edge + WAYS) + (0 if making else WAYS)
            making = MAKING
        elif deviation > 0:
            around = CROWDED * math.pi * (REACH * deviation) ** 2
            kept += around
            making = max(making, around)  # all pairs within reach
        fits[k] = kept + making <= left
    return fits
