"""Recorded operations as one loop over columns, compiled by numba: no compiler of the system is asked.

The source is written once per recording; loop_files says where it lies and when it is compiled.
"""

from collections.abc import Sequence
from typing import Any

import torch

from texsss.numerics import loop_files
from texsss.numerics.recorded import Operation, Recording, Value
from texsss.types import Tensor

TILE = 64  # columns at once: all that is known of them fits into the first caches

# e^x, sin x, arctan x by reduced arguments and polynomials (Cephes): no branches, so loops become vectors
_HEAD = '''"""Written by texsss.numerics.jitted."""
import math
import numpy as np
from llvmlite import ir
from numba import njit, types, uintp
from numba.extending import intrinsic

F, inf, nan = np.float32, np.inf, np.nan
OPTIONS = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}

@intrinsic
def as_float(context, bits):
    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.FloatType())
    return types.float32(types.int32), generate

@njit(**OPTIONS)
def parts(x):
    k = np.floor(x * F(1.44269504) + F(0.5))
    y = x - k * F(0.693359375) + k * F(2.12194440e-4)
    p = F(1.9875691500e-4)
    p = p * y + F(1.3981999507e-3)
    p = p * y + F(8.3334519073e-3)
    p = p * y + F(4.1665795894e-2)
    p = p * y + F(1.6666665459e-1)
    p = p * y + F(0.5)
    return p * y * y + y, as_float(np.int32((np.int32(k) + np.int32(127)) << np.int32(23)))

@njit(**OPTIONS)
def exp(x):
    less, scale = parts(min(max(x, F(-87)), F(88)))
    return scale * less + scale

@njit(**OPTIONS)
def expm1(x):
    less, scale = parts(min(max(x, F(-87)), F(88)))
    return scale * less + (scale - F(1))

@njit(**OPTIONS)
def sin(x):
    k = np.floor(x * F(0.318309886) + F(0.5))
    y = x - k * F(3.140625) - k * F(9.67653589793e-4)
    half = k * F(0.5)
    z = y * y
    p = F(2.6083159e-6)
    p = p * z + F(-1.9810690e-4)
    p = p * z + F(8.3330785e-3)
    p = p * z + F(-1.6666657e-1)
    return (F(1) - F(4) * (half - np.floor(half))) * (p * z * y + y)

@njit(**OPTIONS)
def cos(x):
    return sin(x + F(1.57079633))

@njit(**OPTIONS)
def atan(x):
    y = x / (F(1) + math.sqrt(F(1) + x * x))
    y = y / (F(1) + math.sqrt(F(1) + y * y))
    z = y * y
    p = F(1 / 13)
    p = p * z + F(-1 / 11)
    p = p * z + F(1 / 9)
    p = p * z + F(-1 / 7)
    p = p * z + F(1 / 5)
    p = p * z + F(-1 / 3)
    return F(4) * (p * z * y + y)

'''
_SIGNATURE = "void(float32[:, ::1], float32[:, ::1], float32[::1], float32[:, ::1])"
_FORMS = {
    "abs": "abs({0})",
    "add": "{0} + {1}",
    "addcdiv": "{0} + {1} / {2}",
    "addcmul": "{0} + {1} * {2}",
    "atan": "atan({0})",
    "clamp_max": "min({0}, {1})",
    "clamp_min": "max({0}, {1})",
    "cos": "cos({0})",
    "div": "{0} / {1}",
    "exp": "exp({0})",
    "expm1": "expm1({0})",
    "ge": "{0} >= {1}",
    "gt": "{0} > {1}",
    "le": "{0} <= {1}",
    "lt": "{0} < {1}",
    "lerp": "{0} + ({1} - {0}) * {2}",
    "maximum": "max({0}, {1})",
    "minimum": "min({0}, {1})",
    "mul": "{0} * {1}",
    "neg": "-{0}",
    "reciprocal": "F(1) / {0}",
    "rsqrt": "F(1) / math.sqrt({0})",
    "sin": "sin({0})",
    "sqrt": "math.sqrt({0})",
    "sub": "{0} - {1}",
    "where": "{1} if {0} else {2}",
}
_POWERS = {2: "{0} * {0}", 1.5: "{0} * math.sqrt({0})", -1.5: "F(1) / ({0} * math.sqrt({0}))"}


class Loop:
    """A recording of float32 operations, compiled.

    Building takes some seconds, once per machine and structure. `wait`: for that, too; else it begins beside
    what else is done. Raises LookupError: for operations that have no form here, instead of waiting, and
    where numba fails.
    """

    def __init__(self, recording: Recording, wait: bool):
        source = Source(recording)
        self._rows = torch.cat(source.rows, 1).contiguous().numpy()
        self._numbers = torch.tensor(source.numbers, dtype=torch.float32).numpy()
        self._run = loop_files.loop(source.text, wait)

    def __call__(self, inputs: Sequence[Tensor], result: Tensor) -> None:
        """Fills `result` (S, N), contiguous, for `inputs` (1, N)."""
        assert result.is_contiguous() and result.shape[0] == len(self._rows)
        self._run(torch.cat(list(inputs)).numpy(), self._rows, self._numbers, result.numpy())


class Source:
    """The text of a loop, and what it reads: numbers, and columns (S, 1).

    Materials of the same structure differ in those alone, so that they share a text.
    """

    def __init__(self, recording: Recording):
        often = [x for x in recording.operations if x.rows > 1]
        self.rows = [torch.zeros(often[-1].rows, 1)]
        self.numbers: list[float] = []
        self._row: dict[int, int] = {}
        inputs = recording.inputs
        read = {x for operation in often for x in operation.inputs if isinstance(x, Value)}
        read -= {x.value for x in often}
        place = {x: k * TILE for k, x in enumerate([*inputs, *sorted(read.difference(inputs))])}
        once = [f"v{x.number} = known[uintp({place[x]}) + n]" for x in inputs]
        once += [self._statement(x) for x in recording.operations if x.rows == 1]
        once += [f"known[uintp({k}) + n] = v{x.number}" for x, k in place.items() if x not in inputs]
        first = len(self.numbers)
        each = [f"v{x.number} = known[uintp({k}) + n]" for x, k in place.items() if x in read]
        each += [*(self._statement(x) for x in often), f"made[n] = v{recording.result.number}"]
        self.text = "\n".join(
            [
                # a function of its own: a loop within a loop would not become vectors
                _HEAD + "@njit(**OPTIONS)",
                "def pairs(known, rows, numbers, i, made):",
                *(f" r{k} = rows[i, {k}]" for k in range(1, len(self.rows))),
                *(f" c{k} = numbers[{k}]" for k in range(first, len(self.numbers))),
                f" for n in range(uintp({TILE})):",
                *(f"  {x}" for x in each),
                "",
                f'@njit("{_SIGNATURE}", cache=True, nogil=True, **OPTIONS)',
                "def loop(inputs, rows, numbers, result):",
                f" known, made = np.empty({max(len(place), 1) * TILE}, F), np.empty({TILE}, F)",
                " count, many = inputs.shape",
                *(f" c{k} = numbers[{k}]" for k in range(first)),
                f" for start in range(0, many, {TILE}):",
                f"  stop = min(many - start, {TILE})",
                "  for k in range(count):",
                f"   for n in range({TILE}):",
                f"    known[k * {TILE} + n] = inputs[k, start + min(n, stop - 1)]",
                f"  for n in range(uintp({TILE})):",
                *(f"   {x}" for x in once),
                "  for i in range(len(rows)):",
                "   pairs(known, rows, numbers, i, made)",
                "   for n in range(stop):",
                "    result[i, start + n] = made[n]",
                "",
            ]
        )

    def _statement(self, operation: Operation) -> str:
        name, options = operation.name, dict(operation.options)
        if name == "pow":
            form, inputs = _POWERS.get(operation.inputs[1]), [self._read(operation.inputs[0])]
        elif name == "clamp":
            low, high = [*operation.inputs[1:], None, None][:2]
            low, high = options.get("min", low), options.get("max", high)
            form, inputs = "{0}", [self._read(operation.inputs[0])]
            form = form if high is None else f"min({form}, F({high!r}))"
            form = form if low is None else f"max({form}, F({low!r}))"
        else:
            form, inputs = _FORMS.get(name), [self._read(x) for x in operation.inputs]
            for factor in options.values():  # alpha or value
                inputs[1] = f"F({factor!r}) * {inputs[1]}"
        if form is None:
            raise LookupError(f"Loop: {name} of {operation.inputs[1:]} has no form.")
        return f"v{operation.value.number} = {form.format(*inputs)}"

    def _read(self, x: Any) -> str:
        if isinstance(x, Value):
            return f"v{x.number}"
        if not isinstance(x, Tensor) or x.numel() == 1:
            self.numbers.append(float(x))
            return f"c{len(self.numbers) - 1}"
        if id(x) not in self._row:
            if x.shape != self.rows[0].shape:
                raise LookupError(f"Loop: nothing of shape {tuple(x.shape)} is read.")
            self._row[id(x)] = len(self.rows)
            self.rows.append(x)
        return f"r{self._row[id(x)]}"
