"""Entered irradiance against closed forms."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import scatter, sphere, square, together

from texsss.errors import Cancelled, DomainError, ShapeError
from texsss.light.areas import RectangleLight
from texsss.light.emitters import ConstantEnvironment, DirectionalLight, PointLight
from texsss.light.environment import ImageEnvironment
from texsss.light.irradiance import irradiance, irradiance_apart, irradiance_at
from texsss.light.sites import sites_at
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.surface.points import Points
from texsss.types import unit


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_furnace(eta):
    """A convex body in a constant environment takes in π L F_dt everywhere."""
    mesh = sphere(subdivisions=2)
    points = scatter(mesh, 2000)
    lights = [ConstantEnvironment((1.0, 0.5, 2.0))]
    entered = irradiance(points, mesh, lights, eta=eta, occluder=Occluder(mesh), environment_samples=16)
    expected = math.pi * fresnel.F_dt(eta) * torch.tensor([1.0, 0.5, 2.0])
    torch.testing.assert_close(entered, expected.expand_as(entered), rtol=1e-5, atol=0)  # measured 4e-7


def test_lights_apart_add_up_to_the_bit():
    """Lamps together, each panel and each part of the surroundings alone: in turn they are all light."""
    mesh = sphere(subdivisions=2)
    sites, look = sites_at(scatter(mesh, 500), mesh), {"occluder": Occluder(mesh), "eta": 1.3, "seed": 5}
    panel = RectangleLight((0.0, 0.0, 300.0), (0.0, 90.0, 0.0), (90.0, 0.0, 0.0), (5.0, 4.0, 3.0))
    image = torch.full((32, 64, 3), 0.1)
    image[8, 20] = 100.0
    lamps = [DirectionalLight(v, (1.0, 2.0, 3.0)) for v in ((1.0, 0.0, 1.0), (0.0, 1.0, 0.5))]
    lights = [panel, lamps[0], ImageEnvironment(image), lamps[1]]
    each = irradiance_apart(sites, lights, **look)
    assert len(each) == 4 and all(bool((one > 0).any()) for one in each)
    total = each[0]
    for one in each[1:]:
        total = total + one
    assert torch.equal(total, irradiance_at(sites, lights, **look))
    for one, alone in zip(each, (lamps, [panel], None, None), strict=True):
        assert alone is None or torch.equal(one, irradiance_at(sites, alone, **look))
    assert torch.equal(each[2] + each[3], irradiance_at(sites, [lights[2]], **look))


def test_half_the_sky():
    """At the foot of a tall wall: half of it, by the closed form of a long strip."""
    floor = square(10.0)
    wall = square(1e4).moved(square(1e4).vertices[:, [2, 1, 0]] - torch.tensor([20.0, 0, -5e3]))
    mesh = together(floor, wall)
    points = scatter(mesh, 400, faces=slice(0, 2))
    entered = irradiance(
        points, mesh, [ConstantEnvironment((1.0, 1, 1))], occluder=Occluder(mesh), environment_samples=256
    )
    # 20 mm from a wall of 10 m: sky share ½ (1 + sin atan(x/h)), x/h = .002
    # measured mean .5 %; single points 2 % of noise
    assert float(entered.mean()) == pytest.approx(math.pi / 2, rel=0.01)
    assert float(entered.std()) < 0.05


@given(st.floats(1.0, 1e4), st.floats(0.1, 100.0))
@settings(max_examples=20, deadline=None)
def test_inverse_square(distance, intensity):
    mesh = square(1e-3)
    light = PointLight((0.0, 0.0, distance), (intensity, 0.0, 1.0))
    entered = irradiance(Points(torch.tensor([0]), torch.tensor([[0.5, 0.0, 0.5]])), mesh, [light])
    assert float(entered[0, 0]) == pytest.approx(intensity / (distance * 1e-3) ** 2, rel=1e-5)
    assert float(entered[0, 1]) == 0


@pytest.mark.parametrize("subdivisions,worst", [(2, 0.012), (3, 0.006), (4, 0.003)])
def test_no_steps_along_the_terminator(subdivisions, worst):
    """A coarse sphere takes parallel light as the smooth one does.

    Largest error measured .0098, .0050, .0025; without the lift of ray origins .116, .055, .024.
    """
    mesh = sphere(subdivisions=subdivisions)
    points = scatter(mesh, 20_000)
    light = DirectionalLight((1.0, 2.0, 3.0), (1.0, 1.0, 1.0))
    entered = irradiance(points, mesh, [light], occluder=Occluder(mesh))[:, 0]
    smooth = (unit(points.position(mesh)) @ unit(torch.tensor([1.0, 2.0, 3.0]))).clamp_min(0)
    assert float((entered - smooth).abs().max()) < worst


def test_fresnel_at_entry_is_applied_once():
    mesh = square()
    points = scatter(mesh, 3)
    light = DirectionalLight((1.0, 0.0, 1.0), (2.0, 2.0, 2.0))
    entered = irradiance(points, mesh, [light], eta=1.4)
    cosine = math.sqrt(0.5)
    expected = 2 * cosine * fresnel.transmittance(cosine, 1.4)
    torch.testing.assert_close(entered, torch.full_like(entered, expected))


def test_lights_add_and_none_is_dark():
    mesh = sphere()
    points = scatter(mesh, 100)
    lights = [PointLight((0, 300, 0), (1, 1, 1)), DirectionalLight((0, 0, 1), (1, 2, 3))]
    apart = sum(irradiance(points, mesh, [light]) for light in lights)
    torch.testing.assert_close(irradiance(points, mesh, lights), apart)
    assert not irradiance(points, mesh, []).any()


def test_gutter_points_see_what_their_edge_sees():
    """Off the face, under the neighbour's plane or over it, a gutter point is lit like the edge."""
    mesh = sphere(subdivisions=2)
    edge = Points(torch.arange(320), torch.tensor([[0.0, 0.5, 0.5]]).expand(320, 3).contiguous())
    outside = Points(torch.arange(320), torch.tensor([[-0.1, 0.55, 0.55]]).expand(320, 3).contiguous())
    light, occluder = DirectionalLight((0, 0, 1), (1, 1, 1)), Occluder(mesh)
    here = irradiance(edge, mesh, [light], occluder=occluder)
    there = irradiance(outside, mesh, [light], occluder=occluder)
    assert float((here - there).abs().max()) < 0.04  # the normal turns by up to 2°


def test_bumped_normals_let_no_light_in_from_below():
    mesh = square()
    points = scatter(mesh, 8)
    bumped = unit(torch.tensor([[1.0, 0.0, 0.5]])).expand(8, 3)
    below = DirectionalLight((1.0, 0.0, -0.1), (1, 1, 1))
    above = DirectionalLight((1.0, 0.0, 0.1), (1, 1, 1))
    occluder = Occluder(mesh)
    assert not irradiance(points, mesh, [below], occluder=occluder, normals=bumped).any()
    assert irradiance(points, mesh, [above], occluder=occluder, normals=bumped).all()


def test_same_seed_same_numbers():
    mesh = together(sphere(), sphere(centre=(0, 0, 220)))
    points = scatter(mesh, 300)
    lights, occluder = [ConstantEnvironment((1, 1, 1))], Occluder(mesh)
    one, two, other = (irradiance(points, mesh, lights, occluder=occluder, seed=s) for s in (1, 1, 2))
    assert torch.equal(one, two) and not torch.equal(one, other)
    # not even in one place do two points look in the same directions
    twins = Points(points.face[:1].expand(99), points.bary[:1].expand(99, 3))
    apart = irradiance(twins, mesh, lights, eta=1.4, occluder=occluder, sharing=1)
    assert len(torch.unique(apart[:, 0])) > 10


def test_gradient_in_the_lights():
    """E is linear in intensity and smooth in position."""
    mesh = sphere().to(torch.float64)
    points = scatter(mesh, 20)

    def entered(position, intensity):
        return irradiance(points, mesh, [PointLight(position, intensity)], eta=1.4)

    position = torch.tensor([50.0, 60.0, 400.0], dtype=torch.float64, requires_grad=True)
    intensity = torch.ones(3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(entered, (position, intensity), atol=1e-6)


def test_progress_and_cancelling():
    mesh, said = sphere(), []
    points = scatter(mesh, 10)
    irradiance(points, mesh, [], progress=lambda stage, share: said.append((stage, share)))
    assert said == [("light", 1.0)]
    with pytest.raises(Cancelled):
        irradiance(points, mesh, [PointLight((0, 0, 300), (1, 1, 1))], cancel=lambda: True)


def test_bad_lights_are_refused():
    with pytest.raises(DomainError, match="intensity"):
        PointLight((0, 0, 0), (1, -1, 1))
    with pytest.raises(DomainError, match="direction"):
        DirectionalLight((0, 0, 0), (1, 1, 1))
    with pytest.raises(ShapeError, match="three numbers"):
        ConstantEnvironment((1, 1))
    with pytest.raises(DomainError, match="finite"):
        PointLight((0, math.nan, 0), (1, 1, 1))
    with pytest.raises(DomainError, match="at least 1"):
        irradiance(scatter(sphere(), 1), sphere(), [], environment_samples=0)
