"""Gaussians on lattices ever coarser, each filled from the one before, and the way back."""

from collections.abc import Sequence
from dataclasses import dataclass

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
    levels: tuple[Level, ...],
    parts: Sequence[Float[Tensor, "P C"]],
    scale: Float[Tensor, "W P"],
    out: Float[Tensor, "P C"],
    last: Float[Tensor, " P"],
) -> None:
    """Put the transpose of `over`: the sum of what Gaussians make of parts, times `last`, into `out`."""
    channels, held, factor, scratch = parts[0].shape[1], [], scale, Scratch(parts[0])
    for level in levels:
        x = level.ways.down(parts, factor)
        factor, own = None, len(level.blurs)
        made: Tensor | None = None
        for part, around in zip(x.split(channels, 1), level.blurs, strict=False):
            made = around.times(part, made, scratch, added=made is not None)
        held.append(made)
        parts = [x[:, channels * own :]]
    together: Tensor | None = held[-1]
    assert together is not None, "the last level has Gaussians"
    for level, own in reversed(list(zip(levels[1:], held))):
        made = level.ways.up(together)
        assert made is not None, "there is no place for it"
        together = made if own is None else own.add_(made)
    levels[0].ways.up(together, [out], last[None])
