"""Gaussians on lattices ever coarser, each filled from the one before, and the way back."""

from dataclasses import dataclass

import torch

from texsss.numerics.sparse import Sparse
from texsss.transport.lattice import Blur
from texsss.types import Float, Tensor


@dataclass(frozen=True, eq=False)
class Level:
    """Gaussians on one lattice.

    `up`: from its nodes to the points before it, texels or a finer lattice's nodes; `down`: the way there.
    `variances` [mm²] that `blurs` come to at the texels.
    """

    up: Sparse
    down: Sparse
    variances: tuple[float, ...]
    blurs: tuple[Blur, ...]


def over(levels: tuple[Level, ...], x: Float[Tensor, "P C"]) -> Float[Tensor, "P D"]:
    """What all Gaussians of the levels make of `x`, side by side, narrowest first."""
    held = []
    for level in levels:
        x = level.down.times(x)
        held.append([b.times(x) for b in level.blurs])
    back: list[Tensor] = []
    for level, own in reversed(list(zip(levels, held, strict=True))):
        # wider ones come along as further channels
        back = [level.up.times(torch.cat([*own, *back], 1))]
    return back[0]


def over_transposed(levels: tuple[Level, ...], x: Float[Tensor, "P D"]) -> Float[Tensor, "P C"]:
    """The transpose of `over`: the sum of what every Gaussian makes of its own columns."""
    channels = x.shape[1] // sum(len(level.blurs) for level in levels)
    held = []
    for level in levels:
        own, x = level.down.times(x).tensor_split([channels * len(level.blurs)], 1)
        parts = own.split(channels, 1) if level.blurs else ()
        held.append([b.times(part) for b, part in zip(level.blurs, parts, strict=True)])
    back: list[Tensor] = []
    for level, own in reversed(list(zip(levels, held, strict=True))):
        back = [level.up.times(torch.stack([*own, *back]).sum(0))]
    return back[0]
