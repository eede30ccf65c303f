"""Textures beneath textures: clear, opaque, deep, and seen from another side."""

import math

import pytest
import torch

from texsss.baker import Baker
from texsss.errors import DomainError
from texsss.io.images import read_image, write_png
from texsss.scene import Scene
from texsss.transport.parallax import InnerLayer, opacity_from_photograph, shade_layers

SIZE = 64


@pytest.fixture(scope="module")
def square(tmp_path_factory) -> dict:
    """A flat square of 60 mm, grey above, red and green stripes of 10 mm beneath."""
    folder = tmp_path_factory.mktemp("square")
    corners = "v -30 -30 0\nv 30 -30 0\nv 30 30 0\nv -30 30 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    (folder / "square.obj").write_text(corners + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    stripes = torch.zeros(60, 60, 3)
    stripes[:, torch.arange(60) // 10 % 2 == 0, 0] = 1.0
    stripes[:, torch.arange(60) // 10 % 2 == 1, 1] = 1.0
    write_png(folder / "below.png", stripes)
    write_png(folder / "above.png", torch.full((8, 8, 3), 0.5))
    freckled = torch.full((64, 64, 3), 0.7)
    freckled[20:24, 20:24] = 0.1
    write_png(folder / "freckled.png", freckled)
    return {
        "mesh": {"source": str(folder / "square.obj"), "unit_mm": 1.0},
        "maps": {
            name: {"source": str(folder / f"{name}.png"), "space": "linear"}
            for name in ("above", "below", "freckled")
        },
        "material": {"layers": [{"medium": "skin1"}], "surface": {"albedo": "above", "specular": 0.0}},
        "lights": [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}],
        "atlas": {"size": SIZE},
        "camera": {"resolution": [60, 60], "samples": 1},
        "output": {"tonemap": "linear"},
    }


def scene(square: dict, depth_mm: float = 1.0, opacity: float | None = 0.0, **more) -> Scene:
    layer = {"base": "below", "depth_mm": depth_mm, "spread": 0.0}
    parallax = {"opacity": opacity, "layers": [layer]}
    return Scene.parse(square | {"methods": {"diffusion": "parallax", "parallax": parallax}} | more)


def test_textures_show_what_lies_beneath_from_above(square):
    baker = Baker()
    baked = baker.bake(scene(square))
    entered, left = baked.irradiance[32, :, :], baked.exitance[32, :, :]
    red = torch.arange(SIZE) * 60 // SIZE // 10 % 2 == 0
    inside = (torch.arange(SIZE) * 60 / SIZE % 10 - 5).abs() < 3.5  # off the borders of the stripes
    torch.testing.assert_close(left[red & inside, 0], entered[red & inside, 0], rtol=0.02, atol=0)
    assert float(left[red & inside, 1].max()) < 0.02
    opaque = baker.bake(scene(square, opacity=1.0)).exitance
    torch.testing.assert_close(opaque, 0.5 * baked.irradiance, rtol=0.02, atol=1e-4)


@pytest.mark.parametrize("depth_mm", [0.001, 5.0])
def test_stripes_shift_with_the_view_by_depth_times_tangent(square, depth_mm):
    """From 45° to the right what lies 5 mm deep appears 5 mm further to the right."""
    far, side, pixels = 3000.0, math.radians(45), 120
    height_mm = 64.0  # that the picture spans at the square
    camera = {
        "position_mm": [far * math.sin(side), 0.0, far * math.cos(side)],
        "target_mm": [0.0, 0.0, 0.0],
        "fov_y_deg": math.degrees(2 * math.atan(height_mm / 2 / far)),
        "resolution": [pixels, pixels],
        "samples": 1,
    }
    row = Baker().render(scene(square, depth_mm, camera=camera))[pixels // 2]
    across = ((torch.arange(pixels) + 0.5) / pixels - 0.5) * height_mm
    place = across / math.cos(side)  # of the surface that a pixel sees, seen foreshortened
    below = place - depth_mm * math.tan(side)
    inside = (((below + 30) % 10 - 5).abs() < 3.5) & (place.abs() < 28)
    red = (below + 30).div(10, rounding_mode="floor") % 2 == 0
    assert int(inside.sum()) > 40
    assert bool(((row[:, 0] > row[:, 1]) == red)[inside].all())


def test_opacity_is_taken_from_the_photograph_where_none_is_stated(square):
    """As by `opacity_from_photograph`: a freckle hides what even skin lets through."""
    surface = square["material"]["surface"] | {"albedo": "freckled"}
    freckled = square | {"material": square["material"] | {"surface": surface}}
    baked = Baker().bake(scene(freckled, opacity=None))
    photograph = read_image(freckled["maps"]["freckled"]["source"], space="linear")[..., :3]
    opacity = opacity_from_photograph(photograph)
    even = torch.full((1, 1, 3), 0.7)
    clear, below = float(opacity[50, 5]), float(baked.irradiance[50, 5, 0])
    expected = clear * float(even[0, 0, 0]) + (1 - clear)  # red is 1 below, there
    assert float(baked.exitance[50, 5, 0]) / below == pytest.approx(expected, rel=0.03)
    assert float(opacity[22, 22]) > clear + 0.2


@pytest.mark.parametrize("size", [64, 256])
def test_wide_blurs_are_as_wide_on_large_maps(size):
    """A cosine fades by exp(-k² σ²/2) whatever its texels, also where σ is a large part of the tile."""
    u = (torch.arange(size) + 0.5) / size
    wave = (0.5 + 0.5 * torch.cos(2 * math.pi * u))[None, :, None].expand(size, size, 3)
    layer = InnerLayer(wave.contiguous(), 1.0, spread=1.0)
    place, above = (
        torch.stack([u, torch.full_like(u, 0.5)], -1),
        torch.tensor([[0.0, 0.0, 1.0]]).expand(size, 3),
    )
    ones, per_mm = torch.ones(size, 3), torch.eye(2).expand(size, 2, 2) * 0.2  # σ is a fifth of the tile
    seen = shade_layers(place, per_mm, above, above, ones, torch.zeros(size, 1), ones, [layer], [ones])
    amplitude = float(seen[:, 0].max() - seen[:, 0].min())
    assert amplitude == pytest.approx(math.exp(-((2 * math.pi * 0.2) ** 2) / 2), abs=0.06)


def test_nothing_beneath_is_told(square):
    with pytest.raises(DomainError, match=r"methods\.parallax\.layers"):
        Baker().bake(Scene.parse(square | {"methods": {"diffusion": "parallax"}}))
    bare = square | {"material": {"layers": [{"medium": "skin1"}]}}
    with pytest.raises(DomainError, match=r"methods\.parallax\.opacity"):
        Baker().bake(scene(bare, opacity=None))
    with pytest.raises(DomainError, match=r"methods\.parallax\.layers\.0\.base"):
        Scene.parse(square | {"methods": {"parallax": {"layers": [{"base": "nowhere"}]}}})
