"""Profiles of many rows, block by block: what a block has in hand stays in the processor's cache."""

from collections.abc import Callable
from typing import Any, NamedTuple

import torch

from texsss.media.stack import LayerTable
from texsss.numerics.compiled import compiled as fast
from texsss.profiles.slab import layers_of
from texsss.types import Float, Tensor, chunks

ROWS = 4096  # prepared at once: more operations than work otherwise
VALUES = 36_000  # frequencies × columns solved at once: .15 MB per tensor


class Solver(NamedTuple):
    """A model's R̂ or T̂, by `side`, in two steps.

    `prepare(layers, *asked)` gives nested tuples of tensors (N,) and numbers, `spectrum` of that and
    the frequencies (S, 1) the profile (S, N). `unreduced`: prepare wants the layers with their true
    coefficients, or None, as a last argument.
    """

    prepare: Callable[..., Any]
    asked: tuple[Any, ...]
    spectrum: Callable[[Any, Tensor], Tensor]
    side: str
    unreduced: bool | None = None


def solved(
    table: LayerTable, s: Float[Tensor, " S"], solver: Solver, compiled: bool = False
) -> Float[Tensor, "S N"]:
    """R̂ or T̂ of all rows and channels, flattened to N; 0 below a stack without a bottom."""
    if solver.side == "transmittance" and table.bottomless:
        return s.new_zeros(len(s), table.sigma_a[..., 0, :].numel())
    parts = [table]
    if len(table.batch) == 1:
        parts = [table.rows(part) for part in chunks(table.batch[0], ROWS)]
    prepare, spectrum = solver.prepare, solver.spectrum
    if compiled:
        prepare, spectrum = fast(prepare), fast(spectrum)
    column = s[:, None]
    blocks: list[Tensor] = []
    for rows in parts:
        asked = solver.asked
        if solver.unreduced is not None:
            asked = (*asked, layers_of(rows, reduced=False) if solver.unreduced else None)
        layers = layers_of(rows)
        prepared = prepare(layers, *asked)
        count = len(layers[0].sigma)
        width = count if compiled else max(VALUES // len(s), 1)
        for columns in chunks(count, width):
            part = prepared if width >= count else _columns(prepared, columns)
            blocks.append(spectrum(part, column))
    return torch.cat(blocks, 1)


def _columns(tree: Any, columns: slice) -> Any:
    """Some columns of all tensors (N,) in nested tuples."""
    if isinstance(tree, Tensor):
        return tree[columns] if tree.ndim else tree
    if isinstance(tree, tuple):
        parts = [_columns(x, columns) for x in tree]
        return type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)
    return tree
