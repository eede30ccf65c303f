"""Loops of numba on disk: each a folder with its source, compiled by a process of its own."""

import hashlib
import importlib.util
import os
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from texsss.numerics.native import cache_folder, notice, processor, run, sweep, written

# what the process does: it gives way to others, ends even if nobody waits for it any more, waits for one that
# does the same, and says at last how long it took
_CHILD = """import os, signal, sys, time
folder, name, built, patience, asker = sys.argv[1:]
if hasattr(signal, "SIGALRM"):
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(int(patience))
os.nice(10)
lock = open(os.path.join(folder, "lock"), "w")
try:
    import fcntl
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except BlockingIOError:
            if os.getppid() != int(asker):
                sys.exit()  # who asked has gone, and another does it
            time.sleep(0.1)
except (ImportError, OSError):
    pass  # some systems and folders know no locks: both do it then
if not os.path.exists(built):
    sys.path.insert(0, folder)
    __import__(name)
    with open(built, "w") as file:
        file.write(f"{time.process_time():.1f} s of processor time")
"""
PATIENCE_S = 900.0
_LOCKS: dict[Path, threading.Lock] = {}
_BEGUN: set[Path] = set()
_FAILED: dict[Path, str] = {}


def loop(text: str, wait: bool) -> Callable[..., None]:
    """The function `loop` of a source. `wait`: until it is compiled.

    Raises LookupError: where it is not, or cannot be; unless told to wait, compiling then begins, and goes
    on when this process ends.
    """
    try:
        folder = kept(text)
        if not wait and not _built(folder).is_file():
            _begin(folder)
        elif build(folder):
            return _loaded(folder)
        why = _FAILED.get(folder)
    except OSError as error:  # a folder may be closed
        why = type(error).__name__
    if why is not None:
        notice(f"numba could not build a loop ({why})", "profiles")
    raise LookupError("Loop: it is not built.")


def kept(text: str) -> Path:
    """The folder of a source, which is written there."""
    name = f"loop_{hashlib.sha256(text.encode()).hexdigest()[:24]}"
    folder = cache_folder() / name
    source = folder / f"{name}.py"
    if not source.is_file():  # it may have gone since it was tried
        _BEGUN.discard(folder)
        _FAILED.pop(folder, None)
    written(source, text)
    return folder


def build(folder: Path, cancel: Callable[[], bool] = lambda: False) -> bool:
    """Whether what lies in `folder` is compiled for this machine; does it first.

    Once `cancel` says so, what compiles is no longer waited for, but goes on, in one process: runs that are
    shorter than it would never come to its end.
    """
    with _LOCKS.setdefault(folder, threading.Lock()):  # whoever comes second waits for what the first builds
        with suppress(OSError):  # of others, perhaps
            os.utime(folder)  # still in use
        if _built(folder).is_file():
            return True
        if folder in _FAILED:
            return False
        try:
            sweep(folder.parent)
            given = [str(folder), folder.name, str(_built(folder)), f"{PATIENCE_S:.0f}", str(os.getpid())]
            run([sys.executable, "-c", _CHILD, *given], folder, cancel, PATIENCE_S, outlives=True)
        except (OSError, subprocess.SubprocessError) as error:
            if folder.is_dir() and not cancel():  # one that has gone may be written anew
                _FAILED[folder] = type(error).__name__
        return _built(folder).is_file()


def _begin(folder: Path) -> None:
    """Builds in a thread, once."""
    if folder not in _BEGUN:
        _BEGUN.add(folder)
        threading.Thread(target=build, args=(folder,), name="numba", daemon=True).start()


def _built(folder: Path) -> Path:
    """The file that says that `folder` is compiled, for such a processor and by such a numba."""
    return folder / f"built-{_kind()}"


@cache
def _kind() -> str:
    try:
        numba = version("numba")
    except PackageNotFoundError:
        numba = ""
    return hashlib.sha256(f"{numba} {sys.version} {processor()}".encode()).hexdigest()[:12]


@cache
def _loaded(folder: Path) -> Callable[..., None]:
    spec = importlib.util.spec_from_file_location(folder.name, folder / f"{folder.name}.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[folder.name] = importlib.util.module_from_spec(spec)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numba's own
        spec.loader.exec_module(module)
    return module.loop
