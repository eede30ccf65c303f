"""Profiles of many rows, block by block: what a block has in hand stays in the processor's cache."""

from collections.abc import Callable
from typing import Any, NamedTuple

import torch

from texsss.media.stack import LayerTable
from texsss.profiles.slab import layers_of
from texsss.types import Float, Tensor, chunks

ROWS = 16_384  # prepared at once: more operations than work otherwise
VALUES = 50_000  # frequencies × columns solved at once: .2 MB per tensor


class Solver(NamedTuple):
    """A model's R̂ or T̂, by `side`, in two steps.

    `prepare(layers, *asked)` gives nested tuples of tensors (1, N) and numbers, `spectrum` of that and
    the frequencies (S, 1) the profile (S, N). `unreduced`: prepare wants the layers with their true
    coefficients, or None, as a last argument.
    """

    prepare: Callable[..., Any]
    asked: tuple[Any, ...]
    spectrum: Callable[[Any, Tensor], Tensor]
    side: str
    unreduced: bool | None = None


def solved(table: LayerTable, s: Float[Tensor, " S"], solver: Solver) -> Float[Tensor, "S N"]:
    """R̂ or T̂ of all channels and rows, flattened to N; 0 below a stack without a bottom."""
    if solver.side == "transmittance" and table.bottomless:
        return s.new_zeros(len(s), table.sigma_a[..., 0, :].numel())
    parts = [table]
    if len(table.batch) == 1:
        parts = [table.rows(part) for part in chunks(table.batch[0], ROWS)]
    column = s[:, None]
    solved: list[Tensor] = []
    for rows in parts:
        asked = solver.asked
        if solver.unreduced is not None:
            asked = (*asked, layers_of(rows, reduced=False) if solver.unreduced else None)
        layers = layers_of(rows)
        count = layers[0].sigma.shape[1]
        prepared = solver.prepare(layers, *asked)
        width = max(VALUES // len(s), 1)
        blocks = [
            solver.spectrum(prepared if width >= count else _columns(prepared, columns), column)
            for columns in chunks(count, width)
        ]
        solved.append(torch.cat(blocks, 1) if len(blocks) > 1 else blocks[0])
    if len(solved) == 1:
        return solved[0]
    return torch.cat([x.view(len(s), table.channels, -1) for x in solved], 2).flatten(1)


def _columns(tree: Any, columns: slice) -> Any:
    """Some columns of all tensors (1, N) in nested tuples."""
    if isinstance(tree, Tensor):
        return tree[:, columns] if tree.ndim else tree
    if not isinstance(tree, (tuple, list)):
        return tree
    parts = [_columns(x, columns) for x in tree]
    return type(tree)(*parts) if hasattr(tree, "_fields") else type(tree)(parts)
