"""OpenEXR images: linear, half or float."""

import io
import re
from pathlib import Path

import numpy as np
import OpenEXR
import torch

from texsss.errors import AssetError, ShapeError
from texsss.io.files import check_pixels, read_bytes, replacing
from texsss.types import Float, Tensor

MAGIC = b"v/1\x01"
MAX_PIXELS = 8192 * 8192
_NAMES = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}
_HALF_MOST = 65504.0


def write_exr(path: str | Path, image: Float[Tensor, "H W C"], half: bool = False) -> None:
    """Writes linear values, ZIP compressed: 1 channel as Y, 3 as RGB, 4 as RGBA; whole or not at all.

    `half`: 16-bit floats, clipped to ±65504. Raises ShapeError: for another number of channels.
    Raises AssetError: when the file cannot be written.
    """
    names = _NAMES.get(image.shape[2])
    if names is None or 0 in image.shape:
        raise ShapeError(
            f"{path}: expected an image with 1, 3 or 4 channels, got shape {tuple(image.shape)}."
        )
    array = image.detach().cpu().float().numpy()
    array = array.clip(-_HALF_MOST, _HALF_MOST).astype(np.float16) if half else array
    channels = {name: np.ascontiguousarray(array[..., k]) for k, name in enumerate(names)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with replacing(path) as beside:
        try:
            OpenEXR.File(header, channels).write(str(beside))
        except RuntimeError as error:
            raise AssetError(f"{path}: could not be written: {error}.") from error


def read_exr(
    source: str | Path | bytes, *, name: str = "image.exr", max_pixels: int = MAX_PIXELS
) -> Float[Tensor, "H W C"]:
    """Linear values of the first part: 3 channels, 4 with alpha, or 1.

    Colours of a named layer (`diffuse.R`) are taken when there are none without a name. `name` stands
    for bytes in messages. The size is checked before pixels are read.
    Raises AssetError: when it is no readable OpenEXR, has too many pixels, no colours, or NaN.
    """
    data, name = (source, name) if isinstance(source, bytes) else (read_bytes(source), str(source))
    if not data.startswith(MAGIC):
        raise AssetError(f"{name}: expected an OpenEXR image, got something else; check the file.")
    try:
        header = OpenEXR.File(io.BytesIO(data), header_only=True).header()
        low, high = header["dataWindow"]
        width, height = (int(h) - int(l) + 1 for l, h in zip(low, high))
        check_pixels(width, height, name, max_pixels)
        chosen = _colours([channel.name for channel in header["channels"]], name)
        found = OpenEXR.File(io.BytesIO(data), separate_channels=True).channels()
        planes = [np.asarray(found[c].pixels, dtype=np.float32) for c in chosen]
    except (AssetError, MemoryError):
        raise
    # the binding raises RuntimeError, ValueError, TypeError for damage of all kinds
    except Exception as error:
        raise AssetError(
            f"{name}: expected an OpenEXR image, got a damaged one ({error}); export it again."
        ) from error
    if any(plane.shape != (height, width) for plane in planes):
        raise AssetError(f"{name}: expected channels of one size, got subsampled ones; export RGB.")
    image = np.stack(planes, -1)
    if not np.isfinite(image).all():
        raise AssetError(f"{name}: expected finite values, got NaN or infinity; repair the image.")
    return torch.from_numpy(image)


def _colours(names: list[str], file: str) -> list[str]:
    """Which channels make the picture."""
    layers = sorted({n.rpartition(".")[0] for n in names})  # "" first: no layer
    for layer in layers:
        dot = f"{layer}." if layer else ""
        if all(dot + c in names for c in "RGB"):
            return [dot + c for c in "RGBA" if dot + c in names]
    for single in names:
        if re.fullmatch(r"(.*\.)?Y", single) or len(names) == 1:
            return [single]
    raise AssetError(f"{file}: expected channels R, G, B or Y, got {', '.join(names)}; export colours.")
