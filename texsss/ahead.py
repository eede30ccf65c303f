"""The compiled loops that most bakes need, built while everything else is loaded."""

import atexit
import hashlib
import signal
import subprocess
import sys
import threading
from importlib.metadata import version
from pathlib import Path

from texsss.numerics import loop_files
from texsss.numerics.native import abandon, build, cache_folder, run, written
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

RECORDS = "import sys; sys.path.insert(0, sys.argv[1]); from texsss.profiles import usual; usual.keep()"
RECORDED = ("profiles", "media", "numerics")  # folders of what is recorded


class Ahead:
    """A thread that builds them, one after the other, unless they lie on disk. It imports no torch.

    Where C++ cannot be compiled it builds loops of numba instead, of which processes of their own record
    what torch does.
    """

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._build, name="compiler", daemon=True)

    def start(self) -> "Ahead":
        """Begins."""
        self._thread.start()
        return self

    def stop(self) -> None:
        """Ends the compiler that runs, if one does; numba goes on with its loop, if one is being made."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _build(self) -> None:
        ended = self._ended.is_set
        if all(build(source, macros, ended) for source, macros in USUAL) or ended():
            return
        try:
            all(loop_files.build(cache_folder() / name, ended) for name in self._recorded().split())
        except (OSError, subprocess.SubprocessError):
            return

    def _recorded(self) -> str:
        """The names of the usual loops, recorded once for these versions of everything.

        And anew where a folder has gone, as all do that nobody used for a month.
        """
        sources = [path.read_bytes() for room in RECORDED for path in sorted((HERE / room).glob("*.py"))]
        key = hashlib.sha256(b"".join([*sources, version("torch").encode()])).hexdigest()[:24]
        known, folder = cache_folder() / f"usual-{key}", cache_folder()
        names = known.read_text().split() if known.is_file() else None
        if names is None or not all((folder / name / f"{name}.py").is_file() for name in names):
            folder.mkdir(parents=True, exist_ok=True)
            known.unlink(missing_ok=True)
            command = [sys.executable, "-c", RECORDS, str(HERE.parent)]
            written(known, run(command, folder, self._ended.is_set).decode())
        return known.read_text()


def build_until_exit() -> None:
    """Starts what a bake will need while the rest is loaded; the compiler ends with the process."""
    signal.signal(signal.SIGTERM, leave)
    atexit.register(Ahead().start().stop)


def leave(*_: object) -> None:
    """A handler of SIGTERM: no compiler outlives the process, and its folder neither."""
    abandon()
    sys.exit(143)
