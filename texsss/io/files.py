"""Files that appear whole or not at all."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from texsss.errors import AssetError, TooLarge


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A path beside `path` to write to; it takes the place of `path` when the block ends well.

    Raises AssetError: when the folder is missing or cannot be written to; `path` is then as before.
    """
    path = Path(path)
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
        os.close(handle)
    except OSError as error:
        raise AssetError(
            f"{path}: expected a folder to write into, got: {error.strerror}; choose another."
        ) from error
    try:
        yield Path(name)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)  # mkstemp makes files that only the owner reads
        os.replace(name, path)
    except OSError as error:
        raise AssetError(f"{path}: could not be written: {error.strerror or error}.") from error
    finally:
        Path(name).unlink(missing_ok=True)


def read_bytes(path: str | Path) -> bytes:
    """The content of a file. Raises AssetError: when it is missing, a folder, unreadable or empty."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise AssetError(
            f"{path}: expected a readable file, got: {error.strerror}; check the path."
        ) from error
    if not data:
        raise AssetError(f"{path}: expected an image, got an empty file; export it again.")
    return data


def check_pixels(width: int, height: int, name: str, max_pixels: int) -> None:
    """Raises AssetError: when an image has no pixels, TooLarge: when it has more than `max_pixels`."""
    if width <= 0 or height <= 0:
        raise AssetError(f"{name}: expected an image, got one of {width} × {height} pixels; export it again.")
    if width * height > max_pixels:
        raise TooLarge(
            f"{name}: expected at most {max_pixels} pixels, got {width} × {height}; scale it down.",
            max_pixels,
            width * height,
        )


def check_held(held: int, name: str, max_pixels: int) -> None:
    """Raises TooLarge: when decoded samples take more bytes than four floats of `max_pixels` pixels."""
    most = 16 * max_pixels
    if held > most:
        raise TooLarge(
            f"{name}: expected at most {most:,} bytes in all channels, got {held:,}; save colours alone, "
            "or scale it down.",
            most,
            held,
        )
