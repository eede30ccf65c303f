"""The compiled loops that most bakes need, built while everything else is loaded."""

import sys
import threading
from pathlib import Path

from texsss.numerics.native import abandon, build
from texsss.transport.march import variant

HERE = Path(__file__).parent


USUAL: tuple[tuple[Path, dict[str, int]], ...] = (
    (HERE / "transport" / "pairs.cpp", {}),
    (HERE / "transport" / "products.cpp", {}),
    (HERE / "profiles" / "fused.cpp", {"DIRECTIONS": 2}),
    *((variant.SOURCE, variant.macros(boundaries)) for boundaries in range(3)),  # the last layer endless
    (HERE / "profiles" / "fused.cpp", {"DIRECTIONS": 3}),
)
"""Sources and macros, in the order in which a bake asks for them."""


class Ahead:
    """A thread that builds them, one after the other, unless they lie on disk. It imports no torch."""

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._build, name="compiler", daemon=True)

    def start(self) -> "Ahead":
        """Begins."""
        self._thread.start()
        return self

    def stop(self) -> None:
        """Ends the compiler that runs, if one does."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _build(self) -> None:
        for source, macros in USUAL:
            if not build(source, macros, self._ended.is_set):
                return


def leave(*_: object) -> None:
    """A handler of SIGTERM: no compiler outlives the process, and its folder neither."""
    abandon()
    sys.exit(143)
