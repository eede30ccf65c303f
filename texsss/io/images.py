"""Images in and out: linear RGB inside, every usual encoding outside."""

import io
import struct
import warnings
import zlib
from collections.abc import Mapping
from pathlib import Path

import kornia_rs
import numpy as np
import torch
from PIL import ExifTags, Image, ImageOps, UnidentifiedImageError

from texsss.errors import AssetError, DomainError, ShapeError, TooLarge
from texsss.io import exr, hdr
from texsss.io._tiff import read_deep_tiff
from texsss.io.files import check_pixels, read_bytes, replacing
from texsss.types import Float, Tensor, chunks

SPACES = ("srgb", "linear")
CHANNELS = ("rgb", "rgba", "r", "g", "b", "a", "luminance")
MAX_PIXELS = exr.MAX_PIXELS
BAND = 1 << 16  # pixels that are turned into floats at once: they stay in the cache
FORMATS = "PNG, JPEG, WebP, TIFF, OpenEXR or Radiance HDR"
_PILLOW = ("PNG", "JPEG", "WEBP", "TIFF")
_COLOURS = ("RGB", "RGBA", "RGBX", "CMYK", "LA")
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
TIFFS = "a TIFF of grey or RGB with 8, 16 or float bits, or of other colours with 8"
RATHER = "save it as 16-bit PNG or as OpenEXR"
_PNG = b"\x89PNG\r\n\x1a\n"
_LUMINANCE = (0.2126, 0.7152, 0.0722)  # Rec.709


def read_image(
    source: str | Path | bytes,
    space: str = "srgb",
    channel: str = "rgb",
    *,
    name: str = "image",
    max_pixels: int = MAX_PIXELS,
) -> Float[Tensor, "H W C"]:
    """Linear values of an image, float32: C = 3, 4 with `channel` "rgba", else 1.

    Recognised by content: PNG, JPEG, WebP, TIFF (first page), OpenEXR, Radiance HDR. `space` says what
    8- and 16-bit values mean: "srgb" are decoded by the sRGB curve to 0..1, "linear" (data: normals,
    masks, roughness) only scaled to 0..1; float formats are linear as they are, alpha always is.
    Palettes, grey, bilevel and CMYK become RGB; EXIF rotation is applied; colour under zero alpha is
    kept; embedded colour profiles are ignored. Grey gives its value to every channel; without alpha
    that is 1. `name` stands for bytes in messages; sizes are checked before pixels are read.
    Raises AssetError: when it is missing, damaged, not an image, too large, or has NaN.
    Raises DomainError: when space or channel is unknown.
    """
    _check_choice("space", space, SPACES)
    _check_choice("channel", channel, CHANNELS)
    data, name = (source, name) if isinstance(source, bytes) else (read_bytes(source), str(source))
    if data.startswith(exr.MAGIC):
        alpha = channel in ("rgba", "a")
        return _selected(exr.read_exr(data, name=name, max_pixels=max_pixels, alpha=alpha), channel)
    if data.startswith(hdr.MAGIC):
        return _selected(hdr.read_hdr(data, name=name, max_pixels=max_pixels), channel)
    levels = _decoded(data, name, max_pixels)
    if levels.dtype.kind == "f":
        return _selected(torch.from_numpy(levels.astype(np.float32, copy=False)), channel)
    return _linear(levels, space, channel)


def write_png(
    path: str | Path, image: Float[Tensor, "H W C"], bits: int = 8, text: Mapping[str, str] | None = None
) -> None:
    """Writes values in 0..1 as they are (encode them for a display first), whole or not at all.

    1 channel is grey, 3 RGB, 4 RGBA; values outside are clipped. `text`: what the file says of itself, in
    the letters of Latin-1, by keyword.
    Raises ShapeError, DomainError: for other channels or bits. Raises AssetError: when it cannot.
    """
    data = encode_png(image, bits, text)
    with replacing(path) as beside:
        beside.write_bytes(data)


def encode_png(image: Float[Tensor, "H W C"], bits: int = 8, text: Mapping[str, str] | None = None) -> bytes:
    """The bytes of a PNG file of display values; see `write_png`.

    Raises ShapeError, DomainError: as there. Source: W3C PNG specification, 3rd edition.
    """
    height, width, channels = image.shape
    kind = {1: 0, 3: 2, 4: 6}.get(channels)
    if kind is None or 0 in image.shape:
        raise ShapeError(
            f"write_png: expected an image with 1, 3 or 4 channels, got shape {tuple(image.shape)}; "
            "write others as EXR, one to three at a time."
        )
    if bits not in (8, 16):
        raise DomainError(f"write_png: expected 8 or 16 bits, got {bits}; write_exr has floats.")
    most = 2**bits - 1
    levels = (torch.nan_to_num(image.detach().cpu()).clamp(0, 1) * most + 0.5).floor().numpy()
    rows = levels.astype(">u2" if bits == 16 else "u1").reshape(height, -1).view("u1")
    # filter 2: each row as its difference from the one above, which pictures compress well under
    difference = rows.copy()
    difference[1:] -= rows[:-1]
    body = np.concatenate([np.full((height, 1), 2, "u1"), difference], 1).tobytes()
    header = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    said = (f"{name}\0{words}".encode("latin-1") for name, words in (text or {}).items())
    parts = [_chunk(b"IHDR", header), *(_chunk(b"tEXt", one) for one in said)]
    return b"".join([_PNG, *parts, _chunk(b"IDAT", zlib.compress(body, 4)), _chunk(b"IEND", b"")])


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _decoded(data: bytes, name: str, max_pixels: int) -> np.ndarray:
    """(H, W, 1 | 2 | 3 | 4): grey, grey + alpha, RGB, RGBA; 8 or 16 bits or float32."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pillow warns of sizes that we refuse ourselves
            deep = read_deep_tiff(data, name, max_pixels) if data[:4] in _TIFF else None
            if deep is not None:
                return _finite(_turned(*deep), name)
            picture = Image.open(io.BytesIO(data), formats=_PILLOW)
            width, height = picture.size
            check_pixels(width, height, name, max_pixels)
            if _is_deep_png(data):
                turn = picture.getexif().get(ExifTags.Base.Orientation, 1)
                return _turned(_deep_png(data, height, width), turn)
            if picture.format == "TIFF" and picture.mode in _COLOURS and _bits(picture) > 8:
                raise AssetError(f"{name}: expected {TIFFS}, got {_bits(picture)}-bit colours; {RATHER}.")
            picture.load()
            ImageOps.exif_transpose(picture, in_place=True)
            return _array(picture, name)
    except (AssetError, MemoryError):
        raise
    except Image.DecompressionBombError as error:
        raise TooLarge(
            f"{name}: expected at most {max_pixels} pixels, got far more; scale it down.",
            max_pixels,
            2 * Image.MAX_IMAGE_PIXELS if Image.MAX_IMAGE_PIXELS else max_pixels + 1,
        ) from error
    except UnidentifiedImageError as error:
        if data[:4] in _TIFF:
            raise AssetError(f"{name}: expected {TIFFS}, got another kind or damage; {RATHER}.") from error
        raise AssetError(
            f"{name}: expected {FORMATS}, got something else or a damaged header; convert it."
        ) from error
    # decoders raise OSError, SyntaxError, ValueError, struct.error, kornia_rs plain Exception for damage
    except Exception as error:
        raise AssetError(
            f"{name}: expected a whole image, got a damaged one ({error}); export it again."
        ) from error


def _bits(picture: Image.Image) -> int:
    """Bits of a channel of a TIFF, as it says."""
    stated = getattr(picture, "tag_v2", {}).get(ExifTags.Base.BitsPerSample, 8)
    return max(stated) if isinstance(stated, tuple) else int(stated)


def _turned(image: np.ndarray, orientation: int) -> np.ndarray:
    """An image as its EXIF orientation shows it. Source: Exif 2.32, tag 274."""
    if orientation in (5, 6, 7, 8):
        image = image.swapaxes(0, 1)
    down = -1 if orientation in (3, 4, 7, 8) else 1
    right = -1 if orientation in (2, 3, 6, 7) else 1
    return np.ascontiguousarray(image[::down, ::right])


def _array(picture: Image.Image, name: str) -> np.ndarray:
    if picture.mode in ("P", "PA"):
        picture = picture.convert("RGBA" if "transparency" in picture.info or picture.mode == "PA" else "RGB")
    if picture.mode == "I":
        raise AssetError(f"{name}: expected 8, 16 or float bits, got 32-bit integers; convert it to 16.")
    deep = picture.mode == "F" or picture.mode.startswith("I;16")
    if not deep and picture.mode not in ("L", "LA", "RGB", "RGBA"):
        picture = picture.convert("L" if picture.mode == "1" else "RGB")
    return _finite(np.asarray(picture).reshape(picture.height, picture.width, -1), name)


def _finite(values: np.ndarray, name: str) -> np.ndarray:
    if values.dtype.kind == "f" and not all(np.isfinite(row).all() for row in values):  # no mask of all
        raise AssetError(f"{name}: expected finite values, got NaN or infinity; repair the image.")
    return values


def _is_deep_png(data: bytes) -> bool:
    """16 bits in RGB or RGBA, of which pillow keeps eight."""
    return data.startswith(_PNG) and len(data) > 26 and data[24] == 16 and data[25] in (2, 6)


def _deep_png(data: bytes, height: int, width: int) -> np.ndarray:
    mode = "rgb" if data[25] == 2 else "rgba"
    return np.asarray(kornia_rs.io.decode_image_png_u16(data, (height, width), mode))


def _linear(levels: np.ndarray, space: str, channel: str) -> Float[Tensor, "H W C"]:
    """What `channel` asks for of 8- and 16-bit levels, by table: a power per pixel takes long.

    Some rows at a time: in float32 a large image is held once, and grey for all three colours.
    """
    height, width, count = levels.shape
    most = np.iinfo(levels.dtype).max
    straight = np.arange(most + 1) / most
    plain = straight.astype(np.float32)
    curved = plain if space == "linear" else _srgb_to_linear(straight).astype(np.float32)
    grey = channel == "rgb" and count < 3
    wanted = "r" if grey else channel
    image = torch.empty(height, width, {"rgb": 3, "rgba": 4}.get(wanted, 1))
    for rows in chunks(height, max(BAND // width, 1)):
        values = curved.take(levels[rows])
        if count in (2, 4):
            values[..., -1] = plain.take(levels[rows, :, -1])
        image[rows] = _selected(torch.from_numpy(values), wanted)
    return image.expand(-1, -1, 3) if grey else image


def _srgb_to_linear(values: np.ndarray) -> np.ndarray:
    """Source: IEC 61966-2-1."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _selected(values: Float[Tensor, "H W C"], channel: str) -> Float[Tensor, "H W D"]:
    """The channels asked for, of grey, grey + alpha, RGB or RGBA; three are a view of what there is."""
    count = values.shape[-1]
    colours = values[..., :3] if count >= 3 else values[..., :1].expand(-1, -1, 3)
    if channel == "rgb":
        return colours
    if channel == "luminance":
        return (colours * colours.new_tensor(_LUMINANCE)).sum(-1, keepdim=True)
    if channel in "rgb":
        return colours[..., "rgb".index(channel), None].clone()
    alpha = values[..., -1:] if count in (2, 4) else torch.ones_like(values[..., :1])
    return alpha.clone() if channel == "a" else torch.cat([colours, alpha], -1)


def _check_choice(what: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise DomainError(f"read_image: expected {what} to be one of {', '.join(choices)}, got {value!r}.")
