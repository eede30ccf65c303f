"""Profiles of many rows, block by block: what a block has in hand stays in the processor's cache."""

from collections.abc import Callable
from operator import itemgetter
from typing import Any, NamedTuple

import torch

from texsss.media.stack import LayerTable
from texsss.profiles.slab import Coefficients, layers_of
from texsss.types import Bool, Float, Tensor, chunks

ROWS = 16_384  # prepared at once: more operations than work otherwise
VALUES = 50_000  # frequencies × columns solved at once: .2 MB per tensor
THIN = 0.05  # optical depth of a layer below which ...
STEEP = 300.0  # and extinction times the depth above, beyond which a column is solved in float64


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
    solved = [_solved(rows, s[:, None], solver) for rows in parts]
    if len(solved) == 1:
        return solved[0]
    return torch.cat([x.view(len(s), table.channels, -1) for x in solved], 2).flatten(1)


def _solved(rows: LayerTable, s: Float[Tensor, "S 1"], solver: Solver) -> Float[Tensor, "S N"]:
    layers = layers_of(rows)
    given = (layers, layers_of(rows, reduced=False) if solver.unreduced else None)
    made = _by_blocks(given, s, solver)
    if s.dtype != torch.float32:
        return made
    few = _delicate(layers)[0].nonzero()[:, 0]
    if not len(few):
        return made
    exact = _each(given, lambda x: x[:, few].double())
    return made.index_copy(1, few, _by_blocks(exact, s.double(), solver).to(s.dtype))


def _delicate(layers: list[Coefficients]) -> Bool[Tensor, "1 N"]:
    """Columns in which float32 loses digits to differences of nearly equal numbers."""
    above = torch.zeros_like(layers[0].sigma)
    found = torch.zeros_like(above, dtype=torch.bool)
    for layer in layers:
        found |= layer.sigma * above > STEEP
        if layer.d is not None:
            found |= layer.sigma * layer.d < THIN
            above = above + layer.d
    return found


def _by_blocks(given: Any, s: Float[Tensor, "S 1"], solver: Solver) -> Float[Tensor, "S N"]:
    layers, unreduced = given
    asked = solver.asked if solver.unreduced is None else (*solver.asked, unreduced)
    prepared = solver.prepare(layers, *asked)
    count, width = layers[0].sigma.shape[1], max(VALUES // len(s), 1)
    if width >= count:
        return solver.spectrum(prepared, s)
    parts = [_each(prepared, itemgetter((slice(None), part))) for part in chunks(count, width)]
    return torch.cat([solver.spectrum(part, s) for part in parts], 1)


def _each(tree: Any, change: Callable[[Tensor], Tensor]) -> Any:
    """Nested tuples with all tensors (1, N) in them changed."""
    if isinstance(tree, Tensor):
        return change(tree) if tree.ndim else tree
    if not isinstance(tree, (tuple, list)):
        return tree
    parts = [_each(x, change) for x in tree]
    return type(tree)(*parts) if hasattr(tree, "_fields") else type(tree)(parts)
