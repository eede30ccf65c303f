"""OpenEXR round trips and refusals."""

import numpy as np
import OpenEXR
import pytest
import torch

from texsss.errors import AssetError, ShapeError
from texsss.io.exr import read_exr, write_exr
from texsss.io.images import read_image


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_float_round_trip_is_exact(tmp_path, channels):
    image = torch.randn(7, 5, channels, generator=torch.Generator().manual_seed(0)) * 1e3
    write_exr(tmp_path / "a.exr", image)
    assert torch.equal(read_exr(tmp_path / "a.exr"), image)
    assert torch.equal(read_exr((tmp_path / "a.exr").read_bytes()), image)


def test_half_is_within_half_a_step_and_never_overflows(tmp_path):
    image = torch.tensor([[[0.1, 1000.0, 1e9]]])
    write_exr(tmp_path / "a.exr", image, half=True)
    torch.testing.assert_close(
        read_exr(tmp_path / "a.exr")[0, 0], torch.tensor([0.1, 1000.0, 65504.0]), rtol=5e-4, atol=0
    )


def test_light_is_linear_whatever_is_said(tmp_path):
    image = torch.rand(3, 4, 3)
    write_exr(tmp_path / "a.exr", image)
    assert torch.equal(read_image(tmp_path / "a.exr", "srgb"), image)
    assert torch.equal(read_image(tmp_path / "a.exr", "linear", "g"), image[..., 1:2])


def made(path, channels: dict) -> str:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))
    return str(path)


def test_layers_and_lone_channels(tmp_path):
    plane = np.random.default_rng(0).random((3, 4)).astype(np.float32)
    path = made(
        tmp_path / "a.exr", {"diffuse.R": plane, "diffuse.G": plane * 2, "diffuse.B": plane * 3, "Z": plane}
    )
    torch.testing.assert_close(read_exr(path), torch.from_numpy(np.dstack([plane, plane * 2, plane * 3])))
    assert read_exr(made(tmp_path / "b.exr", {"depth": plane})).shape == (3, 4, 1)
    with pytest.raises(AssetError, match="got u, v"):
        read_exr(made(tmp_path / "c.exr", {"u": plane, "v": plane}))


def test_which_channels_are_the_picture(tmp_path):
    a, b, c = np.random.default_rng(0).random((3, 3, 4)).astype(np.float32)
    colours = torch.from_numpy(np.dstack([a, b, c]))
    for red, green, blue in (
        ("r", "g", "b"),
        ("Beauty.red", "Beauty.green", "Beauty.blue"),
        ("N.X", "N.Y", "N.Z"),
    ):
        path = made(tmp_path / "a.exr", {red: a, green: b, blue: c, "depth.Z": a})
        assert torch.equal(read_exr(path), colours)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [
        OpenEXR.Part({**header, "name": "depth"}, {"Z": a}, "depth"),
        OpenEXR.Part({**header, "name": "colours"}, {"R": a, "G": b, "B": c}, "colours"),
    ]
    OpenEXR.File(parts).write(str(tmp_path / "b.exr"))
    assert torch.equal(read_exr(tmp_path / "b.exr"), colours)
    with pytest.raises(AssetError, match=r"at most 192 bytes.*got 240; save colours"):
        made(tmp_path / "c.exr", {f"l{k}.Y": a for k in range(5)})
        read_exr(tmp_path / "c.exr", max_pixels=12)


def test_refusals(tmp_path, capfd):
    path = tmp_path / "a.exr"
    image = torch.ones(4, 4, 3)
    write_exr(path, image)
    with pytest.raises(AssetError, match="at most 8 pixels"):
        read_exr(path, max_pixels=8)
    with pytest.raises(AssetError, match="got something else"):
        read_exr(b"not an image")
    for cut in (20, 200, path.stat().st_size - 9):
        with pytest.raises(AssetError, match=r"damaged|NaN"):
            read_exr(path.read_bytes()[:cut])
    image[0, 0, 0] = float("nan")
    write_exr(path, image)
    with pytest.raises(AssetError, match="NaN"):
        read_exr(path)
    with pytest.raises(ShapeError, match="channels"):
        write_exr(path, torch.ones(4, 4, 2))
    with pytest.raises(AssetError, match="folder"):
        write_exr(tmp_path / "no" / "a.exr", image)
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
