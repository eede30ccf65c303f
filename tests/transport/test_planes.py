"""Fitted planes: exact on planes, tangent in the limit, unmoved by what lies behind."""

import math

import pytest
import torch

from texsss.errors import DomainError
from texsss.numerics import native
from texsss.surface.mesh import Mesh
from texsss.transport.march import planes as module
from texsss.transport.march.planes import fit_planes, plane_radius, rounded_radius, tangent_planes
from texsss.types import unit


def sphere(radius: float = 10.0, rings: int = 24) -> Mesh:
    """A ball without its poles' faces merged: rings × 2·rings quads, split."""
    theta = torch.linspace(0.05, math.pi - 0.05, rings, dtype=torch.float64)
    phi = torch.arange(2 * rings, dtype=torch.float64) * math.pi / rings
    t, p = torch.meshgrid(theta, phi, indexing="ij")
    vertices = radius * torch.stack([t.sin() * p.sin(), t.cos(), t.sin() * p.cos()], -1).reshape(-1, 3)
    i = torch.arange(rings * 2 * rings).reshape(rings, 2 * rings)
    a, b = i[:-1], i[:-1].roll(-1, 1)
    d, c = i[1:], i[1:].roll(-1, 1)
    faces = torch.cat([torch.stack([a, d, c], -1).reshape(-1, 3), torch.stack([a, c, b], -1).reshape(-1, 3)])
    return Mesh(vertices, faces)


def slanted_sheet(count: int = 20) -> Mesh:
    s = torch.linspace(-5, 5, count, dtype=torch.float64)
    v, u = torch.meshgrid(s, s, indexing="ij")
    vertices = torch.stack([u, 0.3 * u - 0.5 * v, v], -1).reshape(-1, 3)
    i = torch.arange(count * count).reshape(count, count)
    a, b, c, d = (x.reshape(-1) for x in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    return Mesh(vertices, torch.cat([torch.stack([a, d, c], 1), torch.stack([a, c, b], 1)]))


def test_a_flat_sheet_is_its_own_plane():
    fitted = fit_planes(slanted_sheet(), 2.0)
    normal = unit(torch.tensor([-0.3, 1.0, 0.5], dtype=torch.float64))
    torch.testing.assert_close(fitted.normal, normal.expand_as(fitted.normal), rtol=0, atol=1e-9)
    assert float(fitted.offset.abs().max()) < 1e-9


def test_planes_of_a_ball_lie_below_its_vertices():
    """A cap of chord r around a vertex has its centroid r²/4R below it (disk of even density)."""
    mesh = sphere(rings=60)
    fitted = fit_planes(mesh, 3.0)
    outward = unit(mesh.vertices)
    middle = mesh.vertices[:, 1].abs() < 3
    assert float((fitted.normal * outward).sum(1)[middle].min()) > 0.999
    # measured -.224 to -.228: -9/40
    torch.testing.assert_close(
        fitted.offset[middle], torch.full_like(fitted.offset[middle], -9 / 40), rtol=0.06, atol=0
    )


def test_small_radii_give_tangent_planes():
    mesh = sphere()
    fitted, tangent = fit_planes(mesh, 1e-3), tangent_planes(mesh)
    torch.testing.assert_close(fitted.normal, tangent.normal)
    assert float(fitted.offset.abs().max()) == 0


def test_the_far_side_of_a_thin_sheet_does_not_count():
    sheet = slanted_sheet()
    back = sheet.vertices - torch.tensor([0.0, 0.1, 0.0], dtype=torch.float64)
    both = Mesh(torch.cat([sheet.vertices, back]), torch.cat([sheet.faces, sheet.faces.flip(1) + len(back)]))
    fitted = fit_planes(both, 2.0)
    assert float(fitted.offset.abs().max()) < 1e-9
    assert float((fitted.normal[: len(back)] * fitted.normal[len(back) :]).sum(1).max()) < -0.999


def test_clusters_stand_in_for_crowds(monkeypatch):
    """Normals within 3°, offsets within a tenth of the radius."""
    mesh = sphere(rings=60)
    one_by_one = fit_planes(mesh, 3.0)
    monkeypatch.setattr(module, "MOST_PAIRS", 10)
    clustered = fit_planes(mesh, 3.0)
    middle = mesh.vertices[:, 1].abs() < 8
    assert float((clustered.normal * one_by_one.normal).sum(1)[middle].min()) > math.cos(math.radians(6))
    assert float((clustered.offset - one_by_one.offset).abs()[middle].max()) < 0.3


def test_planes_follow_deformation():
    """Planes of the stretched and turned ball are the turned planes."""
    mesh = sphere()
    turn = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]], dtype=torch.float64)
    moved = mesh.moved(2 * mesh.vertices @ turn.T)
    still, turned = fit_planes(mesh, 2.5), fit_planes(moved, 5.0)
    torch.testing.assert_close(turned.normal, still.normal @ turn.T)
    torch.testing.assert_close(turned.offset, 2 * still.offset)


@pytest.mark.skipif(native._compiler() is None, reason="no C++ compiler: there is one way only")
@pytest.mark.parametrize("radius", [0.9, 3.0, 9.0])
def test_the_loop_fits_the_same_planes(radius, monkeypatch):
    """In float32, on a ball with its inner wall close behind, far from the origin."""
    wall = sphere()
    inner = 0.97 * wall.vertices
    both = Mesh(torch.cat([wall.vertices, inner]), torch.cat([wall.faces, wall.faces.flip(1) + len(inner)]))
    mesh = Mesh(both.vertices.float() + 100.0, both.faces)
    assert module.spread_around(mesh.vertices, mesh.vertices, radius) is not None
    loop = fit_planes(mesh, radius)
    monkeypatch.setattr(module, "spread_around", lambda *_: None)
    monkeypatch.setattr(module, "MOST_PAIRS", 10**7)
    plain = fit_planes(mesh, radius)
    # float32 moments: measured 1.8e-7 and 6e-7 mm
    torch.testing.assert_close(loop.normal, plain.normal, rtol=0, atol=2e-6)
    torch.testing.assert_close(loop.offset, plain.offset, rtol=0, atol=5e-6)


def test_rounded_radii_are_few_and_near():
    """2^(k/4), at most 2^(1/8) away."""
    radii = [0.01 * 1.01**k for k in range(800)]
    rounded = [rounded_radius(radius) for radius in radii]
    assert max(max(a / b, b / a) for a, b in zip(radii, rounded, strict=True)) <= 2**0.125 + 1e-9
    assert len(set(rounded)) == 47


def test_radius():
    """exp(-σt r) = ε."""
    assert plane_radius(2.0) == pytest.approx(-math.log(0.01) / 2)
    for bad in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(DomainError, match="sigma_t"):
            plane_radius(bad)
    with pytest.raises(DomainError, match="epsilon"):
        plane_radius(1.0, 1.5)
    with pytest.raises(DomainError, match="radius above 0"):
        fit_planes(sphere(), 0.0)


def test_rows_that_are_far_apart_give_no_plane_across():
    """Within reach of each vertex of this cone lies its own row alone: an arc, whose plane is level."""
    around = torch.arange(48) * (2 * math.pi / 48)
    ring = torch.stack([around.cos(), around.sin(), torch.zeros(48)], 1)
    vertices = torch.cat([(20 + 10 * k) * ring + torch.tensor([0.0, 0.0, 10.0 * k]) for k in range(3)])
    i = torch.arange(48)
    low, high = (torch.stack([i, (i + 1) % 48], 1) + shift for shift in (0, 48))
    band = torch.cat([torch.cat([low, high[:, :1]], 1), torch.stack([low[:, 1], high[:, 1], high[:, 0]], 1)])
    mesh = Mesh(vertices, torch.cat([band, band + 48]))
    planes = fit_planes(mesh, 6.0)
    outward = unit(torch.cat([ring] * 3) - torch.tensor([0.0, 0.0, 1.0]))
    assert float((planes.normal * outward).sum(1).min()) > 0.99
