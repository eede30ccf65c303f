"""Loops in C++ behind the operators of the surface: float32 on the processor. Else torch does it, slower."""

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from texsss.numerics.memory import room
from texsss.numerics.native import check_memory, library
from texsss.types import Float, Int, Tensor

PRODUCTS = Path(__file__).with_name("products.cpp")
PAIRS = Path(__file__).with_name("pairs.cpp")


def products(*values: Tensor) -> ctypes.CDLL | None:
    """The products of matrices with `values`; None where torch is to make them."""
    return _found(PRODUCTS, values)


def making(*values: Tensor) -> ctypes.CDLL | None:
    """What makes the matrices from `values`; None where torch is to."""
    return _found(PAIRS, values)


def _found(source: Path, values: tuple[Tensor, ...]) -> ctypes.CDLL | None:
    if any(v.dtype != torch.float32 or v.device.type != "cpu" for v in values):
        return None
    return library(source, {})


def call(function: Any, *args: Tensor | int | float | None) -> None:
    """`function` of tensors by their addresses, whole numbers of 64 bits and floats, on torch's threads.

    Tensors are to be contiguous, of the types that the loop expects; the last argument is added here.
    Raises DomainError: when the system has no memory for what the loop needs.
    """
    function.restype = ctypes.c_bool
    enough = function(*map(_argument, args), ctypes.c_int64(torch.get_num_threads()))
    check_memory(enough, "Surface diffusion")


def _argument(value: Tensor | int | float | None) -> Any:
    if isinstance(value, torch.Tensor):
        return ctypes.c_void_p(value.data_ptr())
    if isinstance(value, int):
        return ctypes.c_int64(value)
    return ctypes.c_void_p(None) if value is None else ctypes.c_float(value)


class Scratch:
    """Memory that results in between share, one after the other: new memory is dear."""

    def __init__(self, like: Tensor):
        self.like, self.held = like, [like.new_empty(0)] * 2

    def parts(self, sizes: tuple[int, int]) -> list[Float[Tensor, " numbers"]]:
        """Two of them, of at least these `sizes`; good until they are asked for the next time."""
        for k, size in enumerate(sizes):
            if size > len(self.held[k]):
                self.held[k] = room(self.like, size)
        return self.held


def addresses(tensors: Sequence[Tensor]) -> Int[Tensor, " groups"]:
    """Where each of them begins in memory."""
    return torch.tensor([t.data_ptr() for t in tensors], dtype=torch.int64)
