"""Gaussians on lattices ever coarser, each filled from the one before, and the way back."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from texsss.numerics.memory import room
from texsss.numerics.sparse import Sparse
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
    last: Sequence[Float[Tensor, " P"]] | None,
) -> None:
    """Put what all Gaussians of the levels make of `x` times `scale`, times `last`, into `out`."""
    channels, scratch = x.shape[1], Scratch(x)
    held: list[Tensor] = []
    parts, factor = [x], [scale]
    for level in levels:
        held.append(level.ways.down(parts, factor))
        parts, factor = held[-1:], None
    # of each level: room for what wider Gaussians make, then its own
    together: Tensor | None = None
    wide = 0  # Gaussians so far
    for k, level in reversed(list(enumerate(levels))):
        columns = room(x, level.ways.nodes, padded(channels * (wide + len(level.blurs))))
        if together is not None:
            levels[k + 1].ways.up(together, [columns[:, : together.shape[1]]])
        for own in level.blurs:
            own.times(held[k][:, :channels], columns[:, channels * wide : channels * (wide + 1)], scratch)
            wide += 1
        together = columns
    assert together is not None, "there are levels"
    scales = None if last is None else _widest_first(levels, last)
    levels[0].ways.up(together, _widest_first(levels, out), scales)


def over_transposed(
    levels: tuple[Level, ...],
    parts: Sequence[Float[Tensor, "Q C"]],
    scale: Sequence[Float[Tensor, " P"]],
    out: Float[Tensor, "P C"],
    last: Float[Tensor, " P"],
    rim: Sparse | None = None,
) -> None:
    """Put the transpose of `over`: the sum of what Gaussians make of parts, times `last`, into `out`.

    `rim`: the matrix (P, Q - P) by which points first get what is behind them in `parts`; else Q is P.
    """
    channels, scratch = out.shape[1], Scratch(out)
    wide, held = len(parts), []
    parts, factor = _widest_first(levels, parts), _widest_first(levels, scale)
    for level in levels:
        x = level.ways.down(parts, factor, rim)
        held.append(x)
        wide -= len(level.blurs)
        parts, factor, rim = [x[:, : padded(channels * wide)]], None, None
    together: Tensor | None = None
    for k, (level, x) in reversed(list(enumerate(zip(levels, held, strict=True)))):
        filled = together is not None
        if together is None:
            together = room(out, level.ways.nodes, padded(channels))
        for own in level.blurs:
            part = x[:, channels * wide : channels * (wide + 1)]
            own.times(part, together[:, :channels], scratch, added=filled)
            filled, wide = True, wide + 1
        if k:
            together = level.ways.up(together)
        else:
            level.ways.up(together, [out], [last])


def _widest_first(levels: tuple[Level, ...], of: Sequence[Tensor]) -> list[Tensor]:
    """What every Gaussian has, in the order of columns: by levels in reverse."""
    ends = accumulate(len(level.blurs) for level in levels)
    own = [of[end - len(level.blurs) : end] for level, end in zip(levels, ends, strict=True)]
    return [one for level in reversed(own) for one in level]
