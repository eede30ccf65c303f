"""Loops in C++, built on first use where there is a compiler, and kept on disk."""

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path

from platformdirs import user_cache_dir

from texsss.errors import DomainError

FLAGS = ["-O3", "-std=c++17", "-march=native", "-shared", "-fPIC", "-pthread", "-w"]
# as the compiler may fuse and vectorise; infinities and NaN stay what they are
FLAGS += ["-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math"]
PATIENCE_S = 120
POLL_S = 0.05
KEPT_S = 30 * 86_400  # libraries that nobody loads for so long are removed
SHARED = Path(__file__).parent  # of headers
_LOCKS: dict[Path, threading.Lock] = {}
_HANGS: set[str] = set()  # what did not answer once is not asked again
ALL = "*"  # ... nor is anything, after this
_RUNNING: set[subprocess.Popen[bytes]] = set()


def library(source: Path, macros: Mapping[str, int]) -> ctypes.CDLL | None:
    """The functions of one C++ file for one set of macros; None, with one notice, without a compiler.

    Building takes some seconds, once per machine, file and macros: the result stays in TEXSSS_CACHE_DIR, or
    in the user's cache.
    """
    return _library(source, tuple(sorted(macros.items())))


def check_memory(enough: bool, what: str) -> None:
    """Raises DomainError: when a loop of `what` got no memory for what it holds."""
    if not enough:
        raise DomainError(
            f"{what}: expected memory for what the loop holds, got none; choose a smaller atlas, or end "
            "other programs."
        )


def abandon() -> None:
    """Ends what compiles now: those who wait for it do without. For a process that is told to go."""
    _HANGS.add(ALL)
    for running in list(_RUNNING):
        _end(running)


def build(source: Path, macros: Mapping[str, int], cancel: Callable[[], bool]) -> bool:
    """Whether what `library` would load lies on disk; builds it first, in silence, until `cancel` says so."""
    try:
        return _built(source, tuple(sorted(macros.items())), cancel) is not None
    except (OSError, subprocess.SubprocessError):
        return False


@cache
def _library(source: Path, macros: tuple[tuple[str, int], ...]) -> ctypes.CDLL | None:
    try:
        path = _built(source, macros)
        if path is None:
            notice("no C++ compiler was found")
            return None
        try:
            with suppress(OSError):  # of others, perhaps
                os.utime(path)
            return ctypes.CDLL(str(path))
        except OSError:  # damaged: once more
            path.unlink(missing_ok=True)
            return ctypes.CDLL(str(_built(source, macros)))
    except (OSError, subprocess.SubprocessError) as error:
        notice(f"a C++ file could not be built ({type(error).__name__})")
        return None


def _built(
    source: Path, macros: tuple[tuple[str, int], ...], cancel: Callable[[], bool] = lambda: False
) -> Path | None:
    """Where the library of a source lies, built unless it is there; None without a compiler."""
    compiler = _compiler()
    if compiler is None:
        return None
    text = b"".join(x.read_bytes() for x in (source, *sorted(source.parent.glob("*.h")), SHARED / "lanes.h"))
    command = [*compiler, *FLAGS, *(f"-D{name}={value}" for name, value in macros)]
    key = hashlib.sha256(repr((command, _version(compiler), processor())).encode() + text).hexdigest()[:24]
    path = cache_folder() / f"{source.stem}-{key}.so"
    with _LOCKS.setdefault(path, threading.Lock()):  # whoever comes second waits for what the first builds
        if not path.is_file():
            _build([*command, f"-I{SHARED}", str(source)], path, cancel)
    return path


def _build(command: list[str], path: Path, cancel: Callable[[], bool]) -> None:
    """Builds beside `path`, then moves there in one step: others may build the same."""
    path.parent.mkdir(parents=True, exist_ok=True)
    sweep(path.parent)
    with tempfile.TemporaryDirectory(prefix="build-", dir=path.parent) as folder:
        made = Path(folder) / path.name
        run([*command, "-o", str(made)], folder, cancel)
        with made.open("rb") as file:
            os.fsync(file.fileno())  # whole or not at all, even if the power fails
        os.replace(made, path)


def run(
    command: list[str],
    folder: str | Path,
    cancel: Callable[[], bool] = lambda: False,
    patience_s: float | None = None,
    outlives: bool = False,
) -> bytes:
    """What a command prints. Raises SubprocessError: when it fails, is cancelled, or hangs, now or before.

    It is ended then, unless it `outlives` being cancelled.
    """
    if _HANGS & {ALL, command[0]}:
        raise subprocess.TimeoutExpired(command, 0)
    patience_s = patience_s or PATIENCE_S
    deadline = time.monotonic() + patience_s
    with tempfile.TemporaryFile(dir=folder) as said:
        running = subprocess.Popen(
            command, cwd=folder, stdout=said, stderr=subprocess.DEVNULL, start_new_session=True
        )
        _RUNNING.add(running)
        try:
            while running.poll() is None and not cancel():
                if time.monotonic() > deadline:
                    _HANGS.add(command[0])
                    raise subprocess.TimeoutExpired(command, patience_s)
                with suppress(subprocess.TimeoutExpired):
                    running.wait(POLL_S)
        finally:
            if not (outlives and cancel()):
                _end(running)
            _RUNNING.discard(running)
        if running.returncode:
            raise subprocess.CalledProcessError(running.returncode, command)
        said.seek(0)
        return said.read()


def _end(running: subprocess.Popen[bytes]) -> None:
    if running.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)  # g++ leaves the work to children
        running.wait()


def sweep(folder: Path) -> None:
    """Removes libraries that nobody loads any more, and what builds that were killed left behind."""
    for path in folder.glob("*"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime < KEPT_S:
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()


@cache
def _compiler() -> tuple[str, ...] | None:
    """The command that compiles: CXX, which may have arguments, or what is usual."""
    for name, *arguments in (shlex.split(os.environ.get("CXX", "")) or [""], ["g++"], ["clang++"]):
        if found := shutil.which(name):
            return os.path.abspath(found), *arguments
    return None


@cache
def _version(compiler: tuple[str, ...]) -> bytes:
    return run([*compiler, "--version"], tempfile.gettempdir())


@cache
def processor() -> str:
    """What -march=native depends on: caches may be shared by machines that differ."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.platform() + platform.processor()
    return "".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))


def written(path: Path, text: str) -> None:
    """Puts a text into a file in one step, unless it is there: others may do the same."""
    if path.is_file():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False) as file:
        file.write(text)
    os.replace(file.name, path)


def cache_folder() -> Path:
    """Where what is compiled lies."""
    return Path(os.environ.get("TEXSSS_CACHE_DIR") or user_cache_dir("texsss")).absolute() / "native"


@cache
def notice(why: str, what: str = "march and diffusion") -> None:
    """Says once for every reason that loops run uncompiled."""
    warnings.warn(
        f"texsss: {what} run uncompiled, several times slower, because {why}.",
        RuntimeWarning,
        stacklevel=3,
    )
