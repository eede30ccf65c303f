"""How thick objects are: closed forms, shells within shells, and surfaces without a far side."""

import math

import pytest
import torch
from shapes import scatter, sphere, together
from shapes import square as plate

from texsss.errors import Cancelled
from texsss.light.thickness import far_side
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh


def slab(thickness: float, side: float = 200.0) -> Mesh:
    """Two plates that face away from each other [mm]."""
    lower = plate(side, z=-thickness)
    return together(plate(side), Mesh(lower.vertices, lower.faces.flip(1)))


@pytest.mark.parametrize("thickness", [0.5, 8.0])
def test_a_slab_is_as_thick_as_it_is(thickness: float):
    mesh = slab(thickness)
    points = scatter(mesh, 200)
    found = far_side(points, mesh, Occluder(mesh))
    assert bool(found.found.all())
    torch.testing.assert_close(found.thickness, torch.full((200,), thickness), rtol=0.02, atol=0)
    torch.testing.assert_close(found.opposite, torch.ones(200))
    step = (found.points.position(mesh) - points.position(mesh))[:, :2]
    assert float(step.abs().max()) < 1e-3


def test_a_sphere_is_as_thick_as_its_diameter():
    mesh = sphere(radius=50.0, subdivisions=4)
    found = far_side(scatter(mesh, 300), mesh, Occluder(mesh))
    # measured 99.4 to 100.0: flat faces lie within the sphere
    assert bool((found.thickness > 99).all()) and bool((found.thickness < 100.2).all())
    assert bool((found.opposite > 0.999).all())


def test_shells_within_shells_are_one_body():
    mesh = together(sphere(radius=50.0, subdivisions=4), sphere(radius=20.0, subdivisions=3))
    outer = scatter(mesh, 300, faces=slice(0, 5120))
    found = far_side(outer, mesh, Occluder(mesh))
    assert bool((found.thickness > 99).all()) and bool((found.thickness < 100.2).all())


def test_a_wedge_is_measured_across_its_middle():
    """Planes at an angle 2 a, r from where they meet: 2 r sin a, to a place as far from there."""
    half = 0.3
    upper = plate(200.0).vertices + torch.tensor([110.0, 0, 0])
    tilt = torch.tensor(
        [[math.cos(half), 0, math.sin(half)], [0, 1, 0], [-math.sin(half), 0, math.cos(half)]]
    )
    turned, faces = upper @ tilt, plate().faces
    mesh = together(Mesh(turned, faces), Mesh(turned * torch.tensor([1.0, 1, -1]), faces.flip(1)))
    points = scatter(mesh, 200, faces=slice(0, 2))
    place = points.position(mesh)
    inner = place.norm(dim=1) < 150
    found = far_side(points, mesh, Occluder(mesh))
    away = place[:, [0, 2]].norm(dim=1)
    expected = 2 * away * math.sin(half)
    torch.testing.assert_close(found.thickness[inner], expected[inner], rtol=2e-3, atol=0)
    mirrored = place * torch.tensor([1.0, 1, -1])
    assert float((found.points.position(mesh) - mirrored)[inner].abs().max()) < 0.05
    torch.testing.assert_close(found.opposite[inner], torch.full_like(away, math.cos(half))[inner])


def test_an_open_sheet_has_no_far_side():
    mesh = plate()
    found = far_side(scatter(mesh, 50), mesh, Occluder(mesh))
    assert not bool(found.found.any()) and bool((found.opposite == 0).all())


def test_it_can_be_stopped():
    mesh = slab(1.0)
    with pytest.raises(Cancelled):
        far_side(scatter(mesh, 50), mesh, Occluder(mesh), cancel=lambda: True)
