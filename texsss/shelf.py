"""Results kept on disk from one run to the next, under the content they depend on, bounded by bytes."""

import hashlib
import os
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from platformdirs import user_cache_dir

from texsss.errors import DomainError

ENDING = ".pt"
DEFAULT_MB = 4096
KILLED_S = 3600  # a save that takes longer was killed


@dataclass(frozen=True)
class Item:
    """A file on the shelf: its `path`, `bytes`, and when it was last of use [seconds since 1970]."""

    path: Path
    bytes: int
    used: float


class Shelf:
    """Files in `folder`, at most `max_bytes` in all; the ones longest without use go first.

    `kinds`: the classes that results may be made of, beside tensors and plain values: nothing else is
    ever made from a file. Files that cannot be read count as absent, and a full or read-only disk as a
    shelf that keeps nothing.
    """

    def __init__(self, folder: Path, max_bytes: int, kinds: tuple[type, ...] = ()):
        self.folder, self.max_bytes, self.kinds = folder, max_bytes, kinds
        # what was made of classes of other fields is of no use
        form = repr([(kind.__qualname__, list(kind.__annotations__)) for kind in kinds])
        self._ending = f"-{hashlib.sha256(form.encode()).hexdigest()[:8]}{ENDING}" if kinds else ENDING

    def get(self, key: str) -> Any | None:
        """The result under `key`, or None."""
        path = self.folder / f"{key}{self._ending}"
        if not path.is_file():
            return None
        try:
            with torch.serialization.safe_globals(list(self.kinds)):
                value = torch.load(path, weights_only=True, mmap=True)
            os.utime(path)
        except Exception:  # a file cut short, or of another version: made anew
            with suppress(OSError):
                path.unlink()
            return None
        return value

    def put(self, key: str, value: Any, size: int) -> None:
        """Keep `value`, of about `size` bytes, if it fits; older files make room."""
        if size > self.max_bytes:
            return
        with suppress(OSError, RuntimeError):
            self.folder.mkdir(parents=True, exist_ok=True)
            self._make_room(self.max_bytes - size)
            handle, name = tempfile.mkstemp(dir=self.folder, suffix=".part")
            os.close(handle)
            try:
                torch.save(value, name)
                os.replace(name, self.folder / f"{key}{self._ending}")
            finally:
                Path(name).unlink(missing_ok=True)

    def items(self) -> list[Item]:
        """What is there, longest without use first."""
        found = []
        for path in self.folder.glob(f"*{ENDING}") if self.folder.is_dir() else ():
            with suppress(OSError):  # another run took it away
                status = path.stat()
                found.append(Item(path, status.st_size, status.st_mtime))
        return sorted(found, key=lambda item: item.used)

    def clear(self) -> int:
        """Take everything away; how many files that were."""
        removed = 0
        self._sweep()
        for item in self.items():
            with suppress(OSError):  # another run took it away, or it may not be touched
                item.path.unlink()
                removed += 1
        return removed

    def _sweep(self) -> None:
        """Takes away what saves that were killed left behind."""
        for path in self.folder.glob("*.part"):
            with suppress(OSError):
                if time.time() - path.stat().st_mtime > KILLED_S:
                    path.unlink()

    def _make_room(self, allowed: int) -> None:
        self._sweep()
        items = self.items()
        total = sum(item.bytes for item in items)
        for item in items:
            if total <= allowed:
                return
            item.path.unlink(missing_ok=True)
            total -= item.bytes


def users_shelf(kinds: tuple[type, ...] = (), size_mb: float | None = None) -> Shelf:
    """The shelf of whoever runs this, in TEXSSS_CACHE_DIR or the user's cache.

    `size_mb` takes the place of TEXSSS_DISK_MB.

    Raises DomainError: when TEXSSS_DISK_MB is not a number of 0 or more; 0 keeps nothing.
    """
    folder = Path(os.environ.get("TEXSSS_CACHE_DIR") or user_cache_dir("texsss")) / "operators"
    if size_mb is None:
        size_mb = _told_mb()
    return Shelf(folder, int(size_mb * (1 << 20)), kinds)


def _told_mb() -> float:
    text = os.environ.get("TEXSSS_DISK_MB", str(DEFAULT_MB))
    try:
        size = float(text)
    except ValueError:
        size = -1.0
    if not 0 <= size < float("inf"):
        raise DomainError(
            f"TEXSSS_DISK_MB: expected a number of MB, 0 or more, got {text!r}; 0 keeps nothing."
        )
    return size
