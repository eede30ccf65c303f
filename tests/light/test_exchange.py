"""Light between parts of an object against closed forms: rooms, facing squares, and what faces nothing."""

import math

import pytest
import torch
from charted_shapes import sphere
from shapes import square, together

from texsss.light.exchange import exchange
from texsss.light.sites import sites_at
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.surface.mesh import Mesh
from texsss.surface.points import TexelMaps
from texsss.surface.raster import rasterise


def seen(mesh: Mesh, uv: torch.Tensor, size: int, **how) -> tuple[TexelMaps, object]:
    texels = rasterise(mesh, uv, (size, size))
    return texels, exchange(texels, sites_at(texels.points, mesh), Occluder(mesh), **how)


def room() -> Mesh:
    """A hollow sphere seen from within."""
    ball = sphere(24, 48)
    return Mesh(ball.vertices, ball.faces.flip(1), ball.source_uv.flip(1))


def facing(gap: float, side: float = 10.0) -> tuple[Mesh, torch.Tensor]:
    """Two squares that face each other, and their places in the atlas."""
    lower, upper = square(side), square(side, gap)
    mesh = together(lower, Mesh(upper.vertices, upper.faces.flip(1)))
    flat = mesh.vertices[mesh.faces][..., :2] / side + 0.5
    shift = torch.tensor([0.02, 0.52]).repeat_interleave(2)[:, None]
    return mesh, torch.stack([shift + 0.46 * flat[..., 0], 0.02 + 0.96 * flat[..., 1]], -1)


def test_in_a_hollow_sphere_all_is_lit_by_the_mean():
    """As much arrives everywhere as leaves on average, wherever it leaves."""
    mesh = room()
    texels, who = seen(mesh, mesh.source_uv, 64)
    across = texels.points.position(mesh)[:, :1] / 10
    exitance = torch.cat([torch.ones_like(across), 1 + across, across.clamp_min(0)], 1)
    area = texels.area[:, None]
    mean = (exitance * area).sum(0) / area.sum()
    found = (who.gathered(exitance) * area).sum(0) / area.sum()
    # measured 1.000, 1.003, .999
    torch.testing.assert_close(found, mean, rtol=0.01, atol=0)
    one, half = (who.gathered(exitance)[texels.covered] / mean)[:, ::2].unbind(1)
    assert float((one - 1).abs().max()) < 1e-5  # every look ends on the wall
    assert float((half - 1).square().mean().sqrt()) < 0.16  # noise of 128 looks; measured .11


def test_refraction_dims_what_is_exchanged():
    """In a sphere light arrives as steeply as it left: F_t² / F_dt, on average over the cosine."""
    mesh, eta = room(), 1.4
    texels, who = seen(mesh, mesh.source_uv, 48, eta=eta)
    cosine = (torch.arange(4000).double() + 0.5) / 4000
    passes = float((fresnel.transmittance(cosine, eta) ** 2 * 2 * cosine).mean() / fresnel.F_dt(eta))
    found = who.gathered(torch.ones(len(texels), 1))[texels.covered].mean()
    assert float(found) == pytest.approx(passes, rel=0.01)  # measured 1.002


@pytest.mark.parametrize("gap", [2.0, 10.0])
def test_facing_squares_have_their_view_factor(gap):
    """Of light that leaves one square the other gets its view factor. Source: Howell, configuration C-11."""
    mesh, uv = facing(gap)
    texels, who = seen(mesh, uv, 64)
    upper = (texels.points.face >= 2)[:, None].float()
    x = 10.0 / gap
    s = math.sqrt(1 + x * x)
    factor = 2 / (math.pi * x * x) * (math.log((1 + x * x) / math.sqrt(1 + 2 * x * x)))
    factor += 2 / (math.pi * x * x) * 2 * x * (s * math.atan(x / s) - math.atan(x))
    lit = who.gathered(upper)[:, 0][texels.covered & (upper[:, 0] == 0)].mean()
    assert float(lit) == pytest.approx(factor, rel=0.03)
    own = who.gathered(upper)[:, 0][texels.covered & (upper[:, 0] == 1)].mean()
    assert float(own) < 1e-6  # flat things do not light themselves


def test_what_bulges_outwards_lights_nothing_of_its_own():
    mesh = sphere(24, 48)
    texels, who = seen(mesh, mesh.source_uv, 48)
    assert float(who.gathered(torch.ones(len(texels), 3)).max()) == 0
