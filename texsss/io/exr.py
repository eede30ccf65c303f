"""OpenEXR images: linear, half or float."""

import io
import math
from pathlib import Path

import numpy as np
import OpenEXR
import torch

from texsss.errors import AssetError, ShapeError
from texsss.io.files import check_held, check_pixels, read_bytes, replacing
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
            f"{path}: expected an image with 1, 3 or 4 channels, got shape {tuple(image.shape)}; write more "
            "channels to several files."
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
    source: str | Path | bytes, *, name: str = "image.exr", max_pixels: int = MAX_PIXELS, alpha: bool = True
) -> Float[Tensor, "H W C"]:
    """Linear values: 3 channels, 4 with alpha unless that is not asked for, or 1.

    Taken are red, green and blue of the first part that has them, without a layer's name before those
    of a layer (`diffuse.R`); else luminance Y; else X, Y and Z of a layer, as vectors are stored; else the
    only channel of the file. `name` stands for bytes in messages. Sizes are checked before pixels are read.
    Raises AssetError: when it is no readable OpenEXR, too large in pixels or bytes, has no colours, or NaN.
    """
    data, name = (source, name) if isinstance(source, bytes) else (read_bytes(source), str(source))
    if not data.startswith(MAGIC):
        raise AssetError(f"{name}: expected an OpenEXR image, got something else; check the file.")
    try:
        headers = [part.header for part in OpenEXR.File(io.BytesIO(data), header_only=True).parts]
        part, chosen = _colours([[c.name for c in header["channels"]] for header in headers], name)
        width, height = _size(headers[part])
        check_pixels(width, height, name, max_pixels)
        # all parts are decoded together, whatever is taken of them; a header does not tell halves from floats
        held = sum(math.prod(_size(h)) * 4 * len(h["channels"]) for h in headers)
        check_held(held, name, max_pixels)
        found = OpenEXR.File(io.BytesIO(data), separate_channels=True).channels(part)
        if any(found[c].pixels.shape != (height, width) for c in chosen):
            raise AssetError(f"{name}: expected channels of one size, got subsampled ones; export RGB.")
        chosen = chosen if alpha else chosen[:3]
        for channel in found.keys() - set(chosen):
            del found[channel]
        image = np.empty((len(chosen), height, width), np.float32)
        for k, channel in enumerate(chosen):
            image[k] = found.pop(channel).pixels  # which is free then
    except (AssetError, MemoryError):
        raise
    # the binding raises RuntimeError, ValueError, TypeError for damage of all kinds
    except Exception as error:
        raise AssetError(
            f"{name}: expected an OpenEXR image, got a damaged one ({error}); export it again."
        ) from error
    if not all(np.isfinite(row).all() for plane in image for row in plane):  # row by row: no mask of all
        raise AssetError(f"{name}: expected finite values, got NaN or infinity; repair the image.")
    return torch.from_numpy(image).permute(1, 2, 0)


def _size(header: dict) -> tuple[int, int]:
    """Width and height of a part."""
    low, high = header["dataWindow"]
    width, height = (int(h) - int(l) + 1 for l, h in zip(low, high))
    return width, height


def _colours(parts: list[list[str]], file: str) -> tuple[int, list[str]]:
    """Which part and which of its channels make the picture."""
    # channels of a part by layer and lower-case name; layer "" comes first
    layers = [(k, _layers(names)) for k, names in enumerate(parts)]
    every = [(k, of[layer]) for k, of in layers for layer in sorted(of)]
    for wanted in (("r", "g", "b", "a"), ("red", "green", "blue", "alpha")):
        for k, layer in every:
            if all(c in layer for c in wanted[:3]):
                return k, [layer[c] for c in wanted if c in layer]
    for k, layer in every:
        if "y" in layer and not ("x" in layer and "z" in layer):
            return k, [layer["y"]]
    for k, layer in every:
        if all(c in layer for c in "xyz"):
            return k, [layer[c] for c in "xyz"]
    names = [name for part in parts for name in part]
    if len(names) == 1:
        return 0, names
    raise AssetError(
        f"{file}: expected channels R, G, B or Y, got {', '.join(names)}; name them so, or export one alone."
    )


def _layers(names: list[str]) -> dict[str, dict[str, str]]:
    """Channels of every layer: from the part after the last dot, in lower case, to the whole name."""
    layers: dict[str, dict[str, str]] = {}
    for name in names:
        layer, _, channel = name.rpartition(".")
        layers.setdefault(layer, {})[channel.lower()] = name
    return layers
