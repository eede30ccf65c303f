"""Deep TIFFs: 16-bit and float samples, which pillow reduces to eight bits, inverts or refuses.

The directory is read here; strips and tiles are unpacked by libtiff under pillow, to which every sample is
described as so many grey bytes side by side.
"""

import io
import struct

import numpy as np
from PIL import ImageFile, TiffImagePlugin

from texsss.io.files import check_held, check_pixels
from texsss.types import chunks

WIDTH, HEIGHT, BITS, PACKING, MEANING, STRIPS, ORIENTATION = 256, 257, 258, 259, 262, 273, 274
SAMPLES, STRIP_ROWS, STRIP_BYTES, PLANES, PREDICTOR = 277, 278, 279, 284, 317
TILE_WIDTH, TILE_HEIGHT, TILES, TILE_BYTES, EXTRA, FORMAT = 322, 323, 324, 325, 338, 339
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB = 0, 1, 2
KINDS = {(1, 16): "u2", (3, 16): "f2", (3, 32): "f4", (3, 64): "f8"}
PACKINGS = (1, 5, 8, 32773, 32946, 34925, 50000)  # none, LZW, deflate, PackBits, deflate, LZMA, Zstandard
HORIZONTAL, FLOATING = 2, 3
BAND = 1 << 24  # bytes that are copied at once
NO_ALPHA, MULTIPLIED, STRAIGHT = -1, 1, 2  # what EXTRA says of a sample beyond colours; -1: nothing


def read_deep_tiff(data: bytes, name: str, max_pixels: int) -> tuple[np.ndarray, int] | None:
    """Samples (H, W, 1 | 2 | 3 | 4) of the first page, as stored, and its EXIF orientation.

    uint16 or float32: grey, grey + alpha, RGB, RGBA. Samples beyond alpha are left out, colours that were
    multiplied by alpha divided. None: when it is no such TIFF, but one of fewer bits, another colour model
    or another packing. Raises AssetError: when it is too large; ValueError, struct.error, …: for damage.
    Source: TIFF 6.0, sections 8, 14 and 18; Adobe, TIFF Technical Note 3, 2005 (predictor 3).
    """
    tags = _tags(data)
    bits, kinds = _all(tags, BITS, 1), _all(tags, FORMAT, 1)
    kind = KINDS.get((kinds[0], bits[0]))
    samples, meaning = int(tags.get(SAMPLES, 1)), tags.get(MEANING)
    colours = 3 if meaning == RGB else 1
    uneven = len(set(bits)) > 1 or len(set(kinds)) > 1
    if kind is None or uneven or meaning not in (WHITE_IS_ZERO, BLACK_IS_ZERO, RGB) or samples < colours:
        return None
    if tags.get(PACKING, 1) not in PACKINGS or (kind[0] == "f" and meaning == WHITE_IS_ZERO):
        return None
    width, height = int(tags[WIDTH]), int(tags[HEIGHT])
    check_pixels(width, height, name, max_pixels)
    dtype = np.dtype(kind).newbyteorder("<" if data[:2] == b"II" else ">")
    across, down = _padded(width, tags.get(TILE_WIDTH)), _padded(height, tags.get(TILE_HEIGHT))
    # held twice while it is unpacked: three floats a pixel, no more
    check_held(across * down * samples * dtype.itemsize, name, max_pixels * 3 // 4)
    planes = samples if tags.get(PLANES, 1) == 2 else 1
    parts = [_plane(data, tags, k, planes, samples // planes, dtype) for k in range(planes)]
    values = parts[0] if planes == 1 else np.concatenate(parts, -1)
    if meaning == WHITE_IS_ZERO:
        values[..., 0] = ~values[..., 0]
    return _coloured(values, colours, _all(tags, EXTRA, NO_ALPHA)), int(tags.get(ORIENTATION, 1))


class _Bytes(TiffImagePlugin.TiffImageFile):
    """A picture of bytes: their number is no sign of a bomb, pixels were counted before."""

    load_prepare = ImageFile.ImageFile.load_prepare


def _padded(extent: int, tile: int | None) -> int:
    """Pixels that whole tiles take."""
    return extent if tile is None else -(-extent // int(tile)) * int(tile)


def _tags(data: bytes) -> TiffImagePlugin.ImageFileDirectory_v2:
    """The first directory."""
    if 43 in data[2:4]:  # BigTIFF, which pillow knows by the third byte alone, whatever the byte order
        tags = TiffImagePlugin.ImageFileDirectory_v2(b"II+\0" + data[4:16], prefix=data[:2])
    else:
        tags = TiffImagePlugin.ImageFileDirectory_v2(data[:8])
    stream = io.BytesIO(data)
    stream.seek(tags.next)
    tags.load(stream)
    return tags


def _all(tags: TiffImagePlugin.ImageFileDirectory_v2, tag: int, default: int) -> tuple[int, ...]:
    """The numbers of a tag; its default where it is not stated."""
    value = tags.get(tag, default)
    return tuple(value) if isinstance(value, tuple) else (value,)


def _plane(
    data: bytes,
    tags: TiffImagePlugin.ImageFileDirectory_v2,
    plane: int,
    planes: int,
    samples: int,
    dtype: np.dtype,
) -> np.ndarray:
    """One plane (H, W, samples)."""
    width, height, step = int(tags[WIDTH]), int(tags[HEIGHT]), samples * dtype.itemsize
    tiled = TILES in tags
    across = int(tags[TILE_WIDTH]) if tiled else width  # pixels of a row that were packed together
    columns = -(-width // across)
    starts = _all(tags, TILES if tiled else STRIPS, 0)
    lengths = _all(tags, TILE_BYTES if tiled else STRIP_BYTES, 0)
    mine = slice(plane * len(starts) // planes, (plane + 1) * len(starts) // planes)
    described = {
        WIDTH: (columns * across * step,),
        HEIGHT: (height,),
        BITS: (8,),
        PACKING: (int(tags.get(PACKING, 1)),),
        MEANING: (BLACK_IS_ZERO,),
        SAMPLES: (1,),
        (TILES if tiled else STRIPS): starts[mine],
        (TILE_BYTES if tiled else STRIP_BYTES): lengths[mine],
    }
    if tiled:
        described |= {TILE_WIDTH: (across * step,), TILE_HEIGHT: (int(tags[TILE_HEIGHT]),)}
    else:
        described |= {STRIP_ROWS: (min(int(tags.get(STRIP_ROWS, height)), height),)}
    values = np.empty((height, columns * across, samples), dtype.newbyteorder("="))
    predictor = int(tags.get(PREDICTOR, 1))
    with _Bytes(io.BytesIO(_described(data, described))) as picture:
        # some rows at a time: as a whole they would be held three times
        for rows in chunks(height, max(BAND // (columns * across * step), 1)):
            raw = np.array(picture.crop((0, rows.start, columns * across * step, rows.stop)))
            packed = raw.reshape(-1, across, step)
            values[rows] = _unpredicted(packed, samples, predictor, dtype).reshape(values[rows].shape)
    return values[:, :width]


def _described(data: bytes, tags: dict[int, tuple[int, ...]]) -> bytes:
    """A TIFF whose strips lie where they do in `data`, with a directory of its own after them."""
    start = len(data) + 6 + 12 * len(tags)  # of the numbers that do not fit into their entries
    entries, beyond = [], b""
    for tag, numbers in sorted(tags.items()):
        packed = struct.pack(f"<{len(numbers)}I", *numbers)
        inside = packed if len(numbers) == 1 else struct.pack("<I", start + len(beyond))
        beyond += packed if len(numbers) > 1 else b""
        entries.append(struct.pack("<HHI", tag, 4, len(numbers)) + inside)
    directory = struct.pack("<H", len(entries)) + b"".join(entries) + bytes(4)
    return b"".join([struct.pack("<2sHI", b"II", 42, len(data)), memoryview(data)[8:], directory, beyond])


def _unpredicted(raw: np.ndarray, samples: int, predictor: int, dtype: np.dtype) -> np.ndarray:
    """Samples in the machine's byte order from rows of bytes (rows, pixels, bytes of a pixel)."""
    rows, across, step = raw.shape
    if predictor == FLOATING:  # differences of bytes, the most significant byte of all samples first
        flat = raw.reshape(rows, across * step // samples, samples)
        np.cumsum(flat, 1, np.uint8, flat)
        swapped = raw.reshape(rows, dtype.itemsize, across * samples).swapaxes(1, 2)
        values = np.ascontiguousarray(swapped).view(dtype.newbyteorder(">"))
    else:
        values = raw.view(dtype)
    values = values.reshape(rows, across, samples)
    if not values.dtype.isnative:
        values = values.byteswap(inplace=True).view(dtype.newbyteorder("="))
    if predictor == HORIZONTAL:
        whole = values.view(f"u{dtype.itemsize}")
        np.cumsum(whole, 1, whole.dtype, whole)
    return values


def _coloured(values: np.ndarray, colours: int, extra: tuple[int, ...]) -> np.ndarray:
    """Colours, and alpha where the first further sample is one; floats as float32."""
    count = values.shape[-1]
    # what a fourth sample of RGB is, nobody need say
    alpha = count > colours and (extra[0] in (MULTIPLIED, STRAIGHT) or extra[0] == NO_ALPHA)
    values = values[..., : colours + alpha]
    if values.dtype.kind == "f":
        with np.errstate(over="ignore"):  # infinity is refused with its sentence
            values = values.astype(np.float32, copy=False)
    if alpha and extra[0] == MULTIPLIED:
        most = 1.0 if values.dtype.kind == "f" else float(np.iinfo(values.dtype).max)
        for row in values:  # one by one: no copies of all
            share = row[:, -1:] / np.float32(most)
            straight = row[:, :-1] / np.where(share > 0, share, 1)
            row[:, :-1] = straight if values.dtype.kind == "f" else (straight + 0.5).clip(0, most)
    return np.ascontiguousarray(values)
