"""Kernels under torch.compile, and what happens where there is no compiler."""

import os
import shutil
import sysconfig
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, no_type_check

import torch
from platformdirs import user_cache_dir

# gathers fuse with what uses them; texel indices are in range by construction
OPTIONS = {"max_fusion_size": 512, "cpp.min_chunk_size": 4096, "assert_indirect_indexing": False}

_constants: list[Callable[..., Any]] = []
"""Not told to the compiler yet: telling it imports all of it, which takes four seconds."""


@cache
def compiler_found() -> bool:
    """Whether C++ can be compiled here: a compiler and Python's own headers."""
    header = Path(sysconfig.get_path("include")) / "Python.h"
    found = shutil.which(os.environ.get("CXX", "g++")) or shutil.which("clang++")
    return bool(found) and header.is_file()


@cache
def compiled(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """`kernel`, compiled on its first call for each set of shapes.

    Without a compiler it is `kernel` itself, with one notice. The result of compilation is kept on disk
    in the user's cache directory, unless TORCHINDUCTOR_CACHE_DIR names another place.
    """
    if not compiler_found():
        notice("no C++ compiler or no Python.h was found")
        return kernel
    # before the imports, which name a temporary folder where nothing is said
    os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", str(Path(user_cache_dir("texsss")) / "inductor"))
    from torch._dynamo.exc import TorchDynamoException  # seconds to import, so only here
    from torch._inductor.exc import InductorError

    while _constants:
        torch.compiler.assume_constant_result(_constants.pop())
    fast = torch.compile(kernel, dynamic=False, fullgraph=True, options=OPTIONS)
    state = {"call": fast}

    def call(*args: Any) -> Any:
        try:
            return state["call"](*args)
        except (TorchDynamoException, InductorError) as error:
            notice(f"compilation failed ({type(error).__name__})")
            state["call"] = kernel
            return kernel(*args)

    return call


@no_type_check
def constant(function):
    """`function` of plain values, kept, and a constant to the compiler, which cannot see into it."""
    kept = cache(function)

    @no_type_check
    def known(*args):
        return kept(*args)

    known.__name__, known.__doc__ = function.__name__, function.__doc__
    _constants.append(known)
    return known


@cache
def notice(why: str) -> None:
    warnings.warn(
        f"texsss: march and profiles run uncompiled, ten times slower, because {why}.",
        RuntimeWarning,
        stacklevel=3,
    )
