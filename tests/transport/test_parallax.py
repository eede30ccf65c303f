"""Depth parallax: the geometry of the shift, the limits of the blend, textures from a photograph."""

import math

import pytest
import torch

from texsss.errors import DomainError, ShapeError
from texsss.transport.parallax import (
    InnerLayer,
    _blurred,
    normals_from_photograph,
    opacity_from_photograph,
    shade_layers,
    transmission,
)
from texsss.types import unit

UP = torch.tensor([[0.0, 0.0, 1.0]])
ONE = torch.ones(1, 3)


def ramp(size: int = 64) -> torch.Tensor:
    """Red rises along u over half a tile and falls again, green along v."""
    s = 1 - (2 * (torch.arange(size) + 0.5) / size - 1).abs()
    v, u = torch.meshgrid(s, s, indexing="ij")
    return torch.stack([u, v, torch.full_like(u, 0.5)], -1)


def seen(view, inner, opacity=0.0, lights=None, normal=UP, **rest):
    uv = torch.tensor([[0.25, 0.25]])
    per_mm = torch.eye(2)[None] * 0.05
    lights = [ONE] * len(inner) if lights is None else lights
    return shade_layers(
        uv, per_mm, view, normal, 0.3 * ONE, torch.full((1, 1), opacity), ONE, inner, lights, **rest
    )


def test_light_goes_straight_on_through_a_flat_surface():
    view = unit(torch.tensor([[0.5, 0.2, 0.8]]))
    torch.testing.assert_close(transmission(view, UP), -view)


def test_shift_is_depth_times_tangent():
    """45° and 2 mm: 2 mm aside, .1 in uv, away from the eye; red falls by .2."""
    view = unit(torch.tensor([[1.0, 0.0, 1.0]]))
    layer = InnerLayer(ramp(), depth_mm=2.0, spread=0.0)
    colour = seen(view, [layer])
    facing = math.sqrt(0.5)
    torch.testing.assert_close(
        colour[0, 0], torch.tensor((1 - facing) * 0.3 + facing * (0.5 - 0.2)), rtol=1e-5, atol=1e-6
    )
    torch.testing.assert_close(
        colour[0, 1], torch.tensor((1 - facing) * 0.3 + facing * 0.5), rtol=1e-5, atol=1e-6
    )


def test_opaque_or_grazing_shows_the_outer_layer_and_clear_the_inner():
    layer = InnerLayer(ramp(), depth_mm=1.0, spread=0.0)
    torch.testing.assert_close(seen(UP, [layer], opacity=1.0), 0.3 * ONE)
    grazing = unit(torch.tensor([[1.0, 0.0, 1e-6]]))
    torch.testing.assert_close(seen(grazing, [layer]), 0.3 * ONE, rtol=0, atol=1e-5)
    torch.testing.assert_close(seen(UP, [layer]), torch.tensor([[0.5, 0.5, 0.5]]))
    below = unit(torch.tensor([[1.0, 0.0, -0.5]]))
    assert bool(torch.isfinite(seen(below, [layer])).all())


def test_white_layers_under_white_light_are_white():
    """The blend keeps what it is given, however many layers there are."""
    white = torch.ones(16, 16, 3)
    half = torch.full((16, 16, 1), 0.5)
    layers = [InnerLayer(white, 1.0, half), InnerLayer(white, 1.0, half), InnerLayer(white, 3.0)]
    view = unit(torch.tensor([[0.5, 0.2, 0.8]]))
    uv, per_mm = torch.rand(1, 2), torch.eye(2)[None] * 0.05
    colour = shade_layers(uv, per_mm, view, UP, ONE, torch.full((1, 1), 0.3), ONE, layers, [ONE] * 3)
    torch.testing.assert_close(colour, ONE)
    torch.testing.assert_close(
        shade_layers(
            uv, per_mm, view, UP, ONE, torch.full((1, 1), 0.3), ONE, layers, [ONE] * 3, specular=ONE
        ),
        2 * ONE,
    )


def test_deeper_is_blurrier():
    checks = (
        ((torch.arange(64)[:, None] // 4 + torch.arange(64) // 4) % 2).float()[..., None].expand(64, 64, 3)
    )
    uv = torch.rand(500, 2, generator=torch.Generator().manual_seed(0))
    view, many = UP.expand(500, 3), torch.ones(500, 3)
    contrast = []
    for depth in (0.0, 1.0, 4.0, 16.0):
        colour = shade_layers(
            uv, torch.eye(2).expand(500, 2, 2) * 0.05, view, view, many, torch.zeros(500, 1), many,
            [InnerLayer(checks, depth)], [many],
        )  # fmt: skip
        contrast.append(float(colour.std()))
    assert contrast == sorted(contrast, reverse=True) and contrast[-1] < 0.05 * contrast[0]


def test_normals_of_an_even_photograph_point_up_and_waves_tilt_them():
    even = torch.full((32, 32, 3), 0.4)
    torch.testing.assert_close(normals_from_photograph(even), UP.expand(32, 32, 3))
    wave = 0.4 + 0.1 * torch.sin(2 * math.pi * torch.arange(64) / 16)[None, :, None].expand(64, 64, 3)
    normals = normals_from_photograph(wave)
    # height rises at column 0: the normal leans back along -u, by about .2 √2
    assert float(normals[0, 0, 0] / normals[0, 0, 2]) == pytest.approx(-0.2 * math.sqrt(2), rel=0.02)
    assert float(normals[..., 1].abs().max()) < 1e-6


def test_opacity_rises_with_detail_and_darkness():
    skin = torch.full((64, 64, 3), 0.6)
    skin[30:34, 30:34] = 0.2
    opacity = opacity_from_photograph(skin)
    assert float(opacity.min()) >= 0.2 and float(opacity.max()) <= 0.9
    assert float(opacity[32, 32, 0]) > 0.7 > 0.3 > float(opacity[5, 5, 0])


def test_bad_input():
    with pytest.raises(DomainError, match="InnerLayer"):
        InnerLayer(ramp(), depth_mm=-1.0)
    with pytest.raises(ShapeError, match="lightmap per inner layer"):
        seen(UP, [InnerLayer(ramp(), 1.0)], lights=[])
    with pytest.raises(DomainError, match="opacity"):
        opacity_from_photograph(ramp(), least=0.9, most=0.1)
    with pytest.raises(DomainError, match="strength"):
        normals_from_photograph(ramp(), strength=-1.0)


@pytest.mark.parametrize("size", [(64, 256), (256, 64), (128, 128)])
def test_maps_blur_as_wide_along_both_sides(size):
    """A dot in the middle, looked at through a blur of .04 of the tile: .045, between two copies."""
    height, width = size
    dot = torch.zeros(height, width, 3)
    dot[height // 2, width // 2] = 1.0
    layer = InnerLayer(dot, 1.0, None, 0.04)
    v, u = torch.meshgrid((torch.arange(64) + 0.5) / 64, (torch.arange(64) + 0.5) / 64, indexing="ij")
    uv = torch.stack([u, v], -1).reshape(-1, 2)
    seen = _blurred(layer, uv, torch.full((len(uv),), 0.04))[:, 0]
    middle = (seen[:, None] * uv).sum(0) / seen.sum()
    deviation = ((seen[:, None] * (uv - middle) ** 2).sum(0) / seen.sum()).sqrt()
    torch.testing.assert_close(deviation, torch.full((2,), 0.04), rtol=0.2, atol=0)
    torch.testing.assert_close(deviation[0], deviation[1], rtol=0.05, atol=0)
