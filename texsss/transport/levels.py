"""Gaussians on lattices ever coarser, each filled from the one before, and the way back."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from texsss.numerics.memory import room
from texsss.transport.bricks import Blur
from texsss.transport.loops import Scratch
from texsss.transport.ways import Ways, padded
from texsss.types import Float, Tensor


@dataclass(frozen=True, eq=False)
class Level:
    """Gaussians on one lattice.

    `ways`: between its nodes and the points before it, texels or a finer lattice's nodes.
    `variances` [mm²] that `blurs` come to at the texels.
    """

    ways: Ways
    variances: tuple[float, ...]
    blurs: tuple[Blur, ...]


def over(
    levels: tuple[Level, ...],
    x: Float[Tensor, "P C"],
    scale: Float[Tensor, " P"],
    out: Sequence[Float[Tensor, "P C"]],
    last: Float[Tensor, "W P"] | None,
) -> None:
    """Put what all Gaussians of the levels make of `x` times `scale`, times `last`, into `out`."""
    channels = x.shape[1]
    scratch = Scratch(x)
    held: list[Tensor] = []  # columns of one level: its own Gaussians, then room for those of wider ones
    wide, factor = sum(len(level.blurs) for level in levels), scale[None]
    for level in levels:
        x = level.ways.down([x], factor)
        factor = None
        # rows that begin where lines of the cache do
        columns = room(x, x.shape[0], padded(channels * wide))[:, : channels * wide]
        wide -= len(level.blurs)
        for k, own in enumerate(level.blurs):
            own.times(x, columns[:, channels * k : channels * (k + 1)], scratch)
        held.append(columns)
    for finer, level, columns in reversed(list(zip(held, levels[1:], held[1:]))):
        level.ways.up(columns, [finer[:, finer.shape[1] - columns.shape[1] :]])
    levels[0].ways.up(held[0], out, last)


def over_transposed(
    levels: tuple[Level, ...], parts: Sequence[Float[Tensor, "P C"]], scale: Float[Tensor, "W P"]
) -> Float[Tensor, "P C"]:
    """The transpose of `over` but for `x`'s factor: the sum of what Gaussians make of their own parts."""
    channels, held, factor, scratch = parts[0].shape[1], [], scale, Scratch(parts[0])
    for level in levels:
        x = level.ways.down(parts, factor)
        factor = None
        own = len(level.blurs)
        columns = x.split(channels, 1)[:own]
        sums = [b.times(part, None, scratch) for part, b in zip(columns, level.blurs, strict=True)]
        held.append(torch.stack(sums).sum(0) if len(sums) > 1 else sums[0] if sums else None)
        parts = [x[:, channels * own :]]
    back: Tensor | None = None
    for level, own in reversed(list(zip(levels, held, strict=True))):
        together = own if back is None else back if own is None else own + back
        assert together is not None, "the last level has Gaussians"
        back = level.ways.up(together)
    assert back is not None, "there are levels"
    return back
