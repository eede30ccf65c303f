"""Radiance HDR (.hdr, .pic) images, as environment maps often come."""

import re

import numpy as np
import torch

from texsss.errors import AssetError
from texsss.io.files import check_pixels
from texsss.types import Float, Tensor

MAGIC = b"#?"
BLOCK = 1 << 18  # pixels that are scaled at once
_HEADER = re.compile(rb"(.*?)\r?\n\r?\n([^\n]{1,100})\n", re.DOTALL)
_SIZE = re.compile(rb"([-+])Y (\d{1,9}) ([-+])X (\d{1,9})$")


def read_hdr(data: bytes, *, name: str = "image.hdr", max_pixels: int) -> Float[Tensor, "H W 3"]:
    """Linear values of a Radiance picture, top row first.

    Flat and run-length encoded pixels, both generations of the latter; EXPOSURE is divided out.
    Raises AssetError: when it is damaged, rotated, not RGBE or has more than `max_pixels`.
    Source: Ward, "Real Pixels", Graphics Gems II; Radiance's color.c.
    """
    header, start = _header(data, name)
    size = _SIZE.match(header[-1])
    if size is None:
        raise AssetError(
            f"{name}: expected rows along X, got {header[-1][:40]!r}; rotate and export it again."
        )
    down, height, right, width = size[1] == b"-", int(size[2]), size[3] == b"+", int(size[4])
    check_pixels(width, height, name, max_pixels)
    formats = [line.partition(b"=")[2].strip() for line in header if line.startswith(b"FORMAT=")]
    if any(found != b"32-bit_rle_rgbe" for found in formats):
        raise AssetError(f"{name}: expected RGBE colours, got another FORMAT; export it again.")
    exposure = _exposure(header, name)
    try:
        rgbe = _pixels(data, start, height, width)[:: 1 if down else -1, :: 1 if right else -1]
    except (IndexError, ValueError) as error:
        raise AssetError(
            f"{name}: expected {width} × {height} pixels, got fewer; download it again."
        ) from error
    image = np.empty((height, width, 3), np.float32)
    step = max(BLOCK // width, 1)
    for row in range(0, height, step):
        _scaled(rgbe[row : row + step], exposure, image[row : row + step])
    return torch.from_numpy(image)


def _exposure(header: list[bytes], name: str) -> float:
    """What values are to be divided by: the product of all that is stated."""
    exposure = 1.0
    for line in header:
        if line.startswith(b"EXPOSURE="):
            try:
                exposure *= float(line.partition(b"=")[2])
            except ValueError:
                raise AssetError(
                    f"{name}: expected a number as EXPOSURE, got {line[9:40]!r}; export it again."
                ) from None
    return exposure if 0 < exposure < np.inf else 1.0


def _scaled(rgbe: np.ndarray, exposure: float, out: np.ndarray) -> None:
    """Writes the values of some rows to `out`; what float32 cannot hold is its greatest number."""
    power = rgbe[..., 3, None]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        np.add(rgbe[..., :3], np.float32(0.5), out=out, dtype=np.float32)
        out *= np.ldexp(np.float32(1), power.astype(np.int32) - (128 + 8)).astype(np.float32)
        out /= np.float32(exposure)
    out[rgbe[..., 3] == 0] = 0
    np.minimum(out, np.finfo(np.float32).max, out=out)


def _header(data: bytes, name: str) -> tuple[list[bytes], int]:
    """Lines up to the size, and where pixels start."""
    found = _HEADER.match(data[: 1 << 16])
    if found is None:
        raise AssetError(
            f"{name}: expected a Radiance picture, got no size in its header; download it again."
        )
    return [*(line.strip() for line in found[1].split(b"\n")), found[2].strip()], found.end()


def _pixels(data: bytes, at: int, height: int, width: int) -> np.ndarray:
    """RGBE of every pixel, (H, W, 4) bytes."""
    out = np.zeros((height, width, 4), np.uint8)
    for row in range(height):
        lead = data[at : at + 4]
        if 8 <= width < 32768 and lead[:2] == b"\x02\x02" and lead[2] << 8 | lead[3] == width:
            at = _runs(data, at + 4, out[row])
        else:
            at = _old_runs(data, at, out[row])
    return out


def _runs(data: bytes, at: int, row: np.ndarray) -> int:
    """One scanline, its four components apart, each in runs and literals."""
    width = row.shape[0]
    found = bytearray()  # appended to: a run is a few bytes, an array's slice would take ten times as long
    for stop in range(width, 5 * width, width):
        while len(found) < stop:
            count = data[at]
            if count > 128:
                found += data[at + 1 : at + 2] * (count - 128)
                at += 2
            else:
                found += data[at + 1 : at + 1 + count]
                at += 1 + count
        if len(found) > stop:
            raise ValueError("run beyond the row")
    row[:] = np.frombuffer(found, np.uint8).reshape(4, width).T
    return at


def _old_runs(data: bytes, at: int, row: np.ndarray) -> int:
    """One scanline of whole pixels; 1 1 1 n repeats the last one n times, 256 n if it follows another."""
    width = row.shape[0]
    flat = np.frombuffer(data, np.uint8, min(row.size, len(data) - at) // 4 * 4, at).reshape(-1, 4)
    repeats = (flat[:, :3] == 1).all(1)
    repeats[:1] = False
    number = np.arange(len(flat))
    pixel = np.maximum.accumulate(np.where(repeats, 0, number))  # the last one that is none
    shift = 8 * np.minimum(number - pixel - 1, 4)
    counts = np.where(repeats, flat[:, 3].astype(np.int64) << np.maximum(shift, 0), 1)
    upto = np.cumsum(counts)
    used = int(np.searchsorted(upto, width)) + 1
    if used > len(flat) or upto[used - 1] != width:
        raise ValueError("run beyond the row, or too few pixels")
    row[:] = np.repeat(flat[pixel[:used]], counts[:used], 0)
    return at + 4 * used
