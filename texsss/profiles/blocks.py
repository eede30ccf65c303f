"""Profiles of many rows, block by block: what a block has in hand stays in the processor's cache."""

from collections.abc import Callable
from operator import itemgetter
from threading import Lock
from typing import Any, NamedTuple

import torch

from texsss.media.stack import LayerTable
from texsss.numerics.jitted import Loop
from texsss.numerics.recorded import Recording
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


class Loops:
    """Models made into loops of numba, for many rows at the same frequencies; from any thread.

    `wait`: until they are built, too; else those alone that lie on disk, and building of the others begins.
    """

    def __init__(self, wait: bool = False):
        self._wait = wait
        self._known: dict[Any, Loop | None] = {}
        self._lock = Lock()

    @staticmethod
    def serve(s: Float[Tensor, " S"]) -> bool:
        """Whether there are loops for such frequencies."""
        return s.dtype == torch.float32 and s.device.type == "cpu" and len(s) > 1

    def solved(self, given: Any, s: Float[Tensor, "S 1"], solver: Solver) -> Float[Tensor, "S N"] | None:
        """R̂ or T̂ of the layers `given`; None where there is no loop."""
        key = solver, tuple((layer.eta, layer.d is None) for layer in given[0])
        with self._lock:
            if key not in self._known:
                self._known[key] = self._loop(given, s, solver)
        loop = self._known[key]
        if loop is None:
            return None
        inputs = _leaves(given)
        result = s.new_empty(len(s), inputs[0].shape[1])
        loop(inputs, result)
        return result

    def _loop(self, given: Any, s: Float[Tensor, "S 1"], solver: Solver) -> Loop | None:
        try:
            return Loop(recorded(given, s, solver)[0], self._wait)
        except LookupError:
            return None


def recorded(given: Any, s: Float[Tensor, "S 1"], solver: Solver) -> tuple[Recording, list[Tensor]]:
    """What a model does to layers like those `given`, and the tensors (1, N) that it reads of these."""

    def whole(*inputs: Tensor) -> Tensor:
        left = iter(inputs)
        return solver.spectrum(_prepared(_each(given, lambda _: next(left)), solver), s)

    inputs = _leaves(given)
    return Recording(whole, inputs), inputs


def solved(
    table: LayerTable, s: Float[Tensor, " S"], solver: Solver, loops: Loops | None = None
) -> Float[Tensor, "S N"]:
    """R̂ or T̂ of all channels and rows, flattened to N; 0 below a stack without a bottom.

    `loops`: for many float32 rows without gradients, at the same `s` each time.
    """
    if solver.side == "transmittance" and table.bottomless:
        return s.new_zeros(len(s), table.sigma_a[..., 0, :].numel())
    parts = [table]
    if loops is None and len(table.batch) == 1:
        parts = [table.rows(part) for part in chunks(table.batch[0], ROWS)]
    solved = [_solved(rows, s[:, None], solver, loops) for rows in parts]
    if len(solved) == 1:
        return solved[0]
    return torch.cat([x.view(len(s), table.channels, -1) for x in solved], 2).flatten(1)


def _solved(
    rows: LayerTable, s: Float[Tensor, "S 1"], solver: Solver, loops: Loops | None
) -> Float[Tensor, "S N"]:
    layers = layers_of(rows)
    given = (layers, layers_of(rows, reduced=False) if solver.unreduced else None)
    made = None if loops is None else loops.solved(given, s, solver)
    if made is None:
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
    prepared = _prepared(given, solver)
    count, width = given[0][0].sigma.shape[1], max(VALUES // len(s), 1)
    if width >= count:
        return solver.spectrum(prepared, s)
    parts = [_each(prepared, itemgetter((slice(None), part))) for part in chunks(count, width)]
    return torch.cat([solver.spectrum(part, s) for part in parts], 1)


def _prepared(given: Any, solver: Solver) -> Any:
    layers, unreduced = given
    asked = solver.asked if solver.unreduced is None else (*solver.asked, unreduced)
    return solver.prepare(layers, *asked)


def _each(tree: Any, change: Callable[[Tensor], Any]) -> Any:
    """Nested tuples with all tensors (1, N) in them changed."""
    if isinstance(tree, Tensor):
        return change(tree) if tree.ndim else tree
    if not isinstance(tree, (tuple, list)):
        return tree
    parts = [_each(x, change) for x in tree]
    return type(tree)(*parts) if hasattr(tree, "_fields") else type(tree)(parts)


def _leaves(tree: Any) -> list[Tensor]:
    found: list[Tensor] = []
    _each(tree, found.append)
    return found
