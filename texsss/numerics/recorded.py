"""What a function does to every column of its inputs, recorded as a list of elementwise operations.

It is run once, on a few columns. Equal operations are done once, idle ones left out, and what does not
depend on the inputs is a number.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from torch.overrides import TorchFunctionMode

from texsss.types import Tensor

COLUMNS = 11  # that are recorded: a width that nothing else has
# fmt: off
ELEMENTWISE = {
    "abs", "add", "addcdiv", "addcmul", "atan", "clamp", "clamp_max", "clamp_min", "cos", "div", "exp",
    "expm1", "ge", "gt", "le", "lerp", "lt", "maximum", "minimum", "mul", "neg", "pow", "reciprocal", "rsqrt",
    "sin", "sqrt", "sub", "where",
}
# fmt: on
SAME = ("contiguous", "detach", "expand_as")  # the same numbers
REVERSED = {"__rsub__": "sub", "__rdiv__": "div", "__rpow__": "pow"}
SHAPED = ("empty_like", "full_like", "new_full", "new_zeros", "ones_like", "zeros_like")  # by shape alone


class Value(NamedTuple):
    """What an operation reads: the result of an earlier one, or an input."""

    number: int


class Operation(NamedTuple):
    name: str
    inputs: tuple[Any, ...]  # values, and numbers and tensors that are the same for all columns
    options: tuple[tuple[str, Any], ...]
    rows: int  # of its result
    value: Value


class Recording:
    """The operations of `function` on inputs (1, N), of which the result (S, N) has S > 1 rows.

    Raises LookupError: where it does something else than operations on every column by itself.
    """

    def __init__(self, function: Callable[..., Tensor], inputs: Sequence[Tensor]):
        assert all(x.shape[0] == 1 and x.shape[1] for x in inputs)
        few = [x[:, torch.arange(COLUMNS, device=x.device) % x.shape[1]] for x in inputs]
        self._values = {id(x): Value(k) for k, x in enumerate(few)}
        self._constants: dict[int, Any] = {}
        self._known: dict[Any, Operation] = {}
        self.inputs = [Value(k) for k in range(len(few))]
        with torch.no_grad(), _Tape() as tape:
            result = function(*few)
        for name, inputs, options, made in tape.done:
            self._note(name, inputs, options, made)
        self.result = self._values[id(result)]
        self.operations = self._needed()
        del self._known, self._constants, self._values

    def _note(self, name: str, inputs: Any, options: dict[str, Any], made: Any) -> None:
        reads = [self._read(x) for x in inputs]
        if name == "__get__" and not isinstance(made, Tensor):  # shape, dtype and the like
            return
        if name in SHAPED or not any(isinstance(x, Value) for x in reads):
            if isinstance(made, Tensor):
                self._constants[id(made)] = _narrow(made)
            return
        if name in SAME:
            self._values[id(made)] = reads[0]
            return
        if name in REVERSED:
            name, reads = REVERSED[name], [_number(reads[1], made), reads[0]]
        name = name.removesuffix("_")
        if name == "where":
            reads = [x if isinstance(x, Value) else _number(x, made) for x in reads]
        if name not in ELEMENTWISE or made.shape[-1] != COLUMNS:
            raise LookupError(f"Recording: {name} is no operation on every column by itself.")
        key = name, tuple(map(_key, reads)), tuple(sorted(options.items()))
        value = Value(len(self.inputs) + len(self._known))
        rows = made.shape[0] if made.ndim > 1 else 1
        new = Operation(name, tuple(reads), key[2], rows, value)
        self._values[id(made)] = self._known.setdefault(key, new).value

    def _read(self, x: Any) -> Any:
        if not isinstance(x, Tensor):
            return x
        return self._values.get(id(x), self._constants.get(id(x), x))

    def _needed(self) -> list[Operation]:
        needed, kept = {self.result}, []
        for operation in reversed(self._known.values()):
            if operation.value in needed:
                kept.append(operation)
                needed.update(x for x in operation.inputs if isinstance(x, Value))
        return kept[::-1]


class _Tape(TorchFunctionMode):
    """Notes every operation, and holds what it read and made."""

    def __init__(self):
        super().__init__()
        self.done: list[tuple[str, Any, dict[str, Any], Any]] = []

    def __torch_function__(self, func, types, args=(), kwargs=None):
        made = func(*args, **(kwargs or {}))
        self.done.append((func.__name__, args, kwargs or {}, made))
        return made


def _narrow(constant: Tensor) -> Tensor:
    """A tensor that is the same for all columns, in one column."""
    wide = constant.ndim and constant.shape[-1] == COLUMNS
    return (constant[..., :1] if wide else constant).clone()


def _number(x: Any, like: Tensor) -> Tensor:
    return x if isinstance(x, Tensor) else torch.tensor(x, dtype=like.dtype)


def _key(x: Any) -> Any:
    if isinstance(x, (int, float)) or (isinstance(x, Tensor) and x.numel() == 1):
        return "number", float(x)
    return ("tensor", id(x)) if isinstance(x, Tensor) else x
