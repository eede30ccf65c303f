"""Images: every encoding reads to the same values, and damage gets one sentence."""

import io
import struct
import time
import tracemalloc
import zlib

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from texsss.errors import AssetError, DomainError, ShapeError
from texsss.io.images import encode_png, read_image, write_png

RAMP = (np.indices((16, 24)).sum(0) * 6).astype(np.uint8)
COLOURS = np.dstack([RAMP, RAMP[::-1], RAMP[:, ::-1]])


def saved(picture: Image.Image, kind: str, **options) -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, kind, **options)
    return buffer.getvalue()


@given(
    arrays(
        np.float32,
        st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3, 4])),
        elements=st.floats(0, 1, width=32),
    ),
    st.sampled_from([8, 16]),
)
@settings(max_examples=40, deadline=None)
def test_png_round_trip(values, bits):
    """Half a level of rounding, no more; pillow agrees with our reading."""
    image = torch.from_numpy(values)
    data = encode_png(image, bits)
    channel = {1: "r", 3: "rgb", 4: "rgba"}[image.shape[2]]
    back = read_image(data, "linear", channel)
    assert float((back - image).abs().max()) <= 0.5 / (2**bits - 1) + 1e-6
    assert np.asarray(Image.open(io.BytesIO(data))).shape[:2] == image.shape[:2]


def test_write_png_is_whole_or_nothing(tmp_path):
    path = tmp_path / "a.png"
    write_png(path, torch.rand(4, 5, 3), bits=16)
    assert read_image(path).shape == (4, 5, 3)
    with pytest.raises(AssetError, match="folder"):
        write_png(tmp_path / "no" / "a.png", torch.rand(4, 5, 3))
    with pytest.raises(ShapeError, match="channels"):
        write_png(path, torch.rand(4, 5, 2))
    with pytest.raises(DomainError, match="bits"):
        write_png(path, torch.rand(4, 5, 3), bits=12)
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_srgb_is_decoded_exactly_and_data_is_not():
    data = saved(Image.fromarray(np.array([[[0, 10, 188]]], np.uint8)), "PNG")
    light = read_image(data)[0, 0].tolist()
    assert light == pytest.approx([0, 10 / 255 / 12.92, ((188 / 255 + 0.055) / 1.055) ** 2.4], rel=1e-6)
    assert read_image(data, "linear")[0, 0].tolist() == pytest.approx([0, 10 / 255, 188 / 255])


@pytest.mark.parametrize(
    "kind,options",
    [("PNG", {}), ("WEBP", {"lossless": True}), ("TIFF", {}), ("TIFF", {"compression": "tiff_lzw"})],
)
def test_lossless_formats_agree(kind, options):
    expected = torch.from_numpy(COLOURS.astype(np.float32) / 255)
    torch.testing.assert_close(
        read_image(saved(Image.fromarray(COLOURS), kind, **options), "linear"), expected
    )


def test_jpeg_and_cmyk_are_near():
    expected = torch.from_numpy(COLOURS.astype(np.float32) / 255)
    for picture in (Image.fromarray(COLOURS), Image.fromarray(COLOURS).convert("CMYK")):
        read = read_image(saved(picture, "JPEG", quality=95, subsampling=0), "linear")
        assert float((read - expected).abs().max()) < 0.04  # measured .02


def test_rotation_by_exif():
    exif = Image.Exif()
    exif[0x0112] = 6  # turn by 90° to the right
    data = saved(Image.fromarray(COLOURS), "JPEG", exif=exif, quality=95, subsampling=0)
    expected = torch.from_numpy(np.rot90(COLOURS, -1).astype(np.float32) / 255)
    assert float((read_image(data, "linear") - expected).abs().max()) < 0.04


@pytest.mark.parametrize("orientation", range(1, 9))
def test_deep_images_turn_like_shallow_ones(orientation):
    """Sixteen bits go another way than eight, and must come out the same."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    shallow = saved(Image.fromarray(COLOURS), "PNG", exif=exif)
    deep = encode_png(torch.from_numpy(COLOURS.astype(np.float32) / 255), 16)
    block = b"eXIf" + exif.tobytes().removeprefix(b"Exif\0\0")
    head = deep.index(b"IDAT") - 4
    chunk = struct.pack(">I", len(block) - 4) + block + struct.pack(">I", zlib.crc32(block))
    turned = read_image(deep[:head] + chunk + deep[head:], "linear")
    torch.testing.assert_close(turned, read_image(shallow, "linear"))


def tiff(values: np.ndarray, kind: int, meaning: int = 2, packing: int = 1, body: bytes = b"") -> bytes:
    """A TIFF of one strip; `kind`: 1 for whole numbers, 3 for floats. With `body` it is predicted, kind 3."""
    height, width, samples = values.shape
    bits, body, predictor = values.itemsize * 8, body or values.tobytes(), 3 if body else 1
    order = ">" if values.dtype.byteorder == ">" else "<"
    tags = [
        *((256, width), (257, height), (258, *[bits] * samples), (259, packing), (262, meaning), (273, 8)),
        *((277, samples), (278, height), (279, len(body)), (317, predictor), (339, *[kind] * samples)),
    ]
    start = 8 + len(body) + 6 + 12 * len(tags)
    rows = beyond = b""
    for tag, *numbers in tags:
        packed = struct.pack(f"{order}{len(numbers)}I", *numbers)
        rows += struct.pack(order + "HHI", tag, 4, len(numbers))
        rows += packed if len(numbers) == 1 else struct.pack(order + "I", start + len(beyond))
        beyond += packed if len(numbers) > 1 else b""
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8 + len(body))
    return head + body + struct.pack(order + "H", len(tags)) + rows + bytes(4) + beyond


@pytest.mark.parametrize("dtype,kind", [("<u2", 1), (">u2", 1), ("<f4", 3), (">f2", 3)])
def test_deep_colours_in_tiff(dtype, kind):
    """All bits of every sample, floats as light as it is."""
    values = COLOURS * np.float32(257) if kind == 1 else COLOURS / np.float32(64)
    data = tiff(values.astype(dtype), kind)
    expected = torch.from_numpy(values / (65535 if kind == 1 else 1))
    torch.testing.assert_close(read_image(data, "linear"), expected)
    assert torch.equal(read_image(data, "linear", "a"), torch.ones(16, 24, 1))
    with pytest.raises(AssetError, match=r"^map\.tiff: expected .*damage"):
        read_image(data[:40] + data[-250:], name="map.tiff")
    with pytest.raises(AssetError, match=r"at most 99 pixels"):
        read_image(data, max_pixels=99)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("packing", [1, 8])
def test_tiles_of_a_large_tiff(order, packing):
    """Of BigTIFF, in tiles of 16 × 16 that reach beyond the picture."""
    values = np.random.default_rng(0).integers(0, 65536, (20, 39, 3)).astype(order + "u2")
    padded = np.pad(values, ((0, 12), (0, 9), (0, 0)), mode="edge")
    tiles = padded.reshape(2, 16, 3, 16, 3).swapaxes(1, 2).reshape(6, -1)
    bodies = [t.tobytes() if packing == 1 else zlib.compress(t.tobytes()) for t in tiles]
    starts = 16 + np.cumsum([0, *map(len, bodies)])
    tags = {256: 39, 257: 20, 258: 16, 259: packing, 262: 2, 277: 3, 322: 16, 323: 16, 324: starts[:-1]}
    tags[325] = [len(body) for body in bodies]
    rows, beyond, after = b"", b"", int(starts[-1]) + 8 + 20 * len(tags) + 8
    for tag, value in tags.items():
        numbers = np.atleast_1d(value).astype(order + "u8")
        rows += struct.pack(order + "HHQ", tag, 16, len(numbers))
        rows += numbers.tobytes() if len(numbers) == 1 else struct.pack(order + "Q", after + len(beyond))
        beyond += numbers.tobytes() if len(numbers) > 1 else b""
    head = (b"II+\0" if order == "<" else b"MM\0+") + struct.pack(order + "HHQ", 8, 0, starts[-1])
    data = head + b"".join(bodies) + struct.pack(order + "Q", len(tags)) + rows + bytes(8) + beyond
    assert np.array_equal(read_image(data, "linear").numpy(), (values / 65535).astype(np.float32))
    with pytest.raises(AssetError, match=r"^big\.tiff: expected .*(a TIFF of grey|damaged)"):
        read_image(data[: starts[-1] + 9], name="big.tiff")


def test_a_large_deep_tiff_is_no_bomb(monkeypatch):
    """Its bytes are not to be counted for pixels, of which there may be fewer."""
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 200)
    monkeypatch.setattr("texsss.io._tiff.BAND", 300)
    values = (COLOURS * np.float32(257)).astype("<u2")  # 384 pixels, 2304 bytes
    assert torch.equal(read_image(tiff(values, 1), "linear"), torch.from_numpy(values / np.float32(65535)))


def test_packed_deep_tiff():
    """LZW of differences by pillow; differences of bytes, significant ones first, deflated."""
    grey = RAMP.astype(np.uint16) * 257
    packed = saved(Image.fromarray(grey), "TIFF", compression="tiff_lzw", tiffinfo={317: 2})
    assert np.array_equal(read_image(packed, "linear", "r")[..., 0].numpy(), grey / np.float32(65535))
    light = np.random.default_rng(0).random((5, 7, 3)).astype("<f4")
    planes = light.astype(">f4").view("u1").reshape(5, 21, 4).swapaxes(1, 2).reshape(5, 28, 3)
    body = zlib.compress(np.diff(planes, axis=1, prepend=0).astype("u1").tobytes())
    assert np.array_equal(read_image(tiff(light, 3, packing=8, body=body)).numpy(), light)


def test_white_as_zero_and_kinds_of_tiff_that_are_refused():
    deep = RAMP[..., None].astype("<u2") * 257
    whiteless = tiff(65535 - deep, 1, meaning=0)
    assert torch.equal(read_image(whiteless, "linear"), read_image(tiff(deep, 1, meaning=1), "linear"))
    with pytest.raises(AssetError, match=r"a TIFF of grey or RGB.*16-bit PNG or as OpenEXR"):
        read_image(tiff(COLOURS.astype("<u2"), 1, meaning=8), name="lab.tiff")  # CIE L*a*b*


def test_grey_palette_bilevel_and_alpha():
    grey = torch.from_numpy(RAMP.astype(np.float32) / 255)[..., None]
    torch.testing.assert_close(
        read_image(saved(Image.fromarray(RAMP), "PNG"), "linear"), grey.expand(-1, -1, 3)
    )
    deep = saved(Image.fromarray(RAMP.astype(np.uint16) * 257), "PNG")
    torch.testing.assert_close(read_image(deep, "linear", "r"), grey)
    assert read_image(saved(Image.fromarray(RAMP > 40), "PNG")).unique().tolist() == [0.0, 1.0]
    palette = saved(Image.fromarray(COLOURS).quantize(8), "PNG", transparency=0)
    assert read_image(palette, "srgb", "rgba").shape == (16, 24, 4)
    assert read_image(palette, "srgb", "a").unique().tolist() == [0.0, 1.0]
    both = np.dstack([RAMP, 255 - RAMP])
    torch.testing.assert_close(read_image(saved(Image.fromarray(both), "PNG"), "srgb", "a"), 1 - grey)


def test_colour_under_zero_alpha_is_kept():
    """Depth maps hold four layers: nothing may be premultiplied."""
    four = np.dstack([COLOURS, np.zeros_like(RAMP)])
    read = read_image(saved(Image.fromarray(four), "PNG"), "linear", "rgba")
    torch.testing.assert_close(read, torch.from_numpy(four.astype(np.float32) / 255))


def test_channels():
    data = saved(Image.fromarray(COLOURS), "PNG")
    whole = read_image(data, "linear")
    for k, name in enumerate("rgb"):
        assert torch.equal(read_image(data, "linear", name), whole[..., k, None])
    assert bool((read_image(data, "linear", "a") == 1).all())
    luminance = whole @ torch.tensor([[0.2126], [0.7152], [0.0722]])
    torch.testing.assert_close(read_image(data, "linear", "luminance"), luminance)


def test_sixteen_bits_of_rgb_survive():
    levels = torch.arange(16 * 24 * 3).reshape(16, 24, 3) * 50
    data = encode_png(levels / 65535, 16)
    assert torch.equal((read_image(data, "linear") * 65535).round().long(), levels)


def test_float_tiff_is_light_as_it_is():
    values = np.linspace(0, 7, 12, dtype=np.float32).reshape(3, 4)
    read = read_image(saved(Image.fromarray(values), "TIFF"), "srgb", "r")
    assert torch.equal(read[..., 0], torch.from_numpy(values))


def rgbe(rows: list[bytes], size: bytes = b"-Y 2 +X 9") -> bytes:
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2.0\n\n" + size + b"\n" + b"".join(rows)


def test_radiance_pictures():
    """The same two rows flat, with old runs and with new ones."""
    a, b = bytes([128, 64, 32, 129]), bytes([10, 20, 30, 128])
    flat = rgbe([a * 9, b * 9])
    old = rgbe([a + bytes([1, 1, 1, 8]), b + bytes([1, 1, 1, 8])])
    new = rgbe([b"\2\2\0\x09" + b"".join(bytes([128 + 5, c, 4, c, c, c, c]) for c in p) for p in (a, b)])
    expected = torch.tensor([[128.5, 64.5, 32.5], [5.25, 10.25, 15.25]])[:, None].expand(2, 9, 3) / 128 / 2
    windows = flat.replace(b"\n", b"\r\n", 4).replace(b"FORMAT=", b"FORMAT= ")
    for data in (flat, old, new, windows):
        torch.testing.assert_close(read_image(data), expected)
    turned = read_image(rgbe([a * 9, b * 9], b"+Y 2 +X 9"))
    torch.testing.assert_close(turned, expected.flip(0))
    for data in (
        flat[:-1],
        new[:-3],
        flat.replace(b"-Y 2", b"-Y 3"),
        rgbe([], b"+X 2 +Y 9"),
        b"#?RADIANCE\n",
    ):
        with pytest.raises(AssetError):
            read_image(data)
    with pytest.raises(AssetError, match="at most"):
        read_image(rgbe([], b"-Y 99999 +X 99999"))
    with pytest.raises(AssetError, match=r"got one of 4 × 0 pixels; export"):
        read_image(rgbe([], b"-Y 0 +X 4"))
    with pytest.raises(AssetError, match="a number as EXPOSURE"):
        read_image(flat.replace(b"EXPOSURE=2.0", b"EXPOSURE=1.0.0"))
    for odd in (b"1e-300", b"1e-38", b"0", b"inf", b"nan"):
        image = read_image(flat.replace(b"EXPOSURE=2.0", b"EXPOSURE=" + odd).replace(b, bytes(4)))
        assert bool(torch.isfinite(image).all()) and not image[1].any()


def test_large_radiance_pictures_take_little_memory_and_time():
    """A byte string, four bytes of RGBE, twelve of values a pixel; whole rows at once."""
    pixels = np.random.default_rng(0).integers(2, 140, (512, 1024, 4), np.uint8)
    data = rgbe([pixels.tobytes()], b"-Y 512 +X 1024")
    tracemalloc.start()
    start = time.process_time()
    image = read_image(data)
    assert time.process_time() - start < 1  # measured .06 s; 2.6 s pixel by pixel
    assert tracemalloc.get_traced_memory()[1] < 24 * 512 * 1024
    tracemalloc.stop()
    expected = (pixels[..., :3] + 0.5) * np.exp2(pixels[..., 3:].astype(float) - 136) / 2
    assert np.allclose(image.numpy(), expected, rtol=1e-6)


def test_old_runs_longer_than_a_byte():
    """Of n, then of 256 n: 300 pixels are one and 43 + 256 more; a run cannot leave its row."""
    a, b = bytes([128, 64, 32, 129]), bytes([10, 20, 30, 128])
    rows = [a + bytes([1, 1, 1, 43, 1, 1, 1, 1]), b + bytes([1, 1, 1, 0, 1, 1, 1, 1]) + a * 43]
    image = read_image(rgbe(rows, b"-Y 2 +X 300"))
    assert bool((image[0] == image[0, 0]).all()) and bool((image[1, :257] == image[1, 0]).all())
    assert torch.equal(image[1, 257:], image[0, :43])
    with pytest.raises(AssetError, match="got fewer"):
        read_image(rgbe([rows[0].replace(b"\x2b", b"\x2c"), rows[1]], b"-Y 2 +X 300"))


def test_large_pictures_are_held_once(monkeypatch):
    """In float32 nothing but the result is as large as the picture; grey is not even held three times."""
    colours = torch.rand(600, 500, 4, generator=torch.Generator().manual_seed(0))
    data = encode_png(colours, 16)
    at_once = read_image(data)
    monkeypatch.setattr("texsss.io.images.BAND", 7 * 500)
    tracemalloc.start()
    assert torch.equal(read_image(data), at_once)
    # measured 16 bytes a pixel, half of them levels, half tables; tensors are not seen, floats would add 16
    assert tracemalloc.get_traced_memory()[1] < 20 * 600 * 500
    tracemalloc.stop()
    assert torch.equal(read_image(data, "linear", "rgba")[..., 3:], read_image(data, "srgb", "a"))
    assert read_image(encode_png(colours[..., :1])).untyped_storage().nbytes() == 4 * 600 * 500


def lying_png(width: int, height: int) -> bytes:
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0" * 64))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    "data,words",
    [
        (lying_png(20000, 20000), "at most"),
        (lying_png(9000, 9000), "at most"),
        (lying_png(100, 100), "damaged"),
        (encode_png(torch.rand(9, 9, 3), 16)[:-40], "damaged"),
        (saved(Image.fromarray(COLOURS), "JPEG")[:300], "damaged"),
        (saved(Image.fromarray(COLOURS), "GIF"), "PNG, JPEG"),
        (b"GLORIA", "PNG, JPEG"),
    ],
)
def test_damage_gets_one_sentence(data, words):
    with pytest.raises(AssetError, match=words) as caught:
        read_image(data, name="map.png")
    assert str(caught.value).startswith("map.png: expected") and "\n" not in str(caught.value)


def test_missing_files_and_bad_choices(tmp_path):
    with pytest.raises(AssetError, match="No such file"):
        read_image(tmp_path / "none.png")
    (tmp_path / "empty.png").touch()
    with pytest.raises(AssetError, match="empty"):
        read_image(tmp_path / "empty.png")
    with pytest.raises(AssetError, match="directory"):
        read_image(tmp_path)
    with pytest.raises(DomainError, match="srgb, linear"):
        read_image(b"", "rec709")
    with pytest.raises(DomainError, match="luminance"):
        read_image(b"", "srgb", "red")


REFUSED = {
    "animated.gif",
    "float32_nan_inf_negative.tiff",
    "png_bomb_20000x20000_1bit.png",
    "png_claims_2e9x2e9.png",
    "png_zero_size.png",
    "text_named.png",
    "truncated.jpg",
    "truncated.png",
    "zero_bytes.png",
}


def test_bad_textures(bad_files):
    """Each is read right or refused in a sentence that names it."""
    refused = set()
    files = sorted((bad_files / "tex").iterdir())
    assert len(files) >= 26
    for file in files:
        try:
            image = read_image(file)
            assert bool(torch.isfinite(image).all()) and image.shape[-1] == 3
        except AssetError as error:
            assert file.name in str(error) and "\n" not in str(error) and str(error).endswith(".")
            refused.add(file.name)
    assert refused == REFUSED
