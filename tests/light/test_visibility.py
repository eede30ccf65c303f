"""Rays against closed forms, at every scale."""

import pytest
import torch
from shapes import scatter, sphere, square, together

from texsss.light.visibility import Occluder
from texsss.types import unit


@pytest.mark.parametrize("radius", [1e-6, 1.0, 100.0, 1e6])
def test_nothing_convex_shadows_itself(radius):
    """Rays above the face leave a convex body, whatever its size."""
    mesh = sphere(radius)
    points = scatter(mesh, 2000)
    normals = points.face_normal(mesh)
    directions = unit(torch.randn(2000, 3, generator=torch.Generator().manual_seed(1)))
    up = (normals * directions).sum(-1)
    hidden = Occluder(mesh).occluded(points.position(mesh), directions, normals=normals)
    assert not hidden[up > 1e-3].any()
    assert hidden[up < -1e-3].all()


def test_shadow_of_a_square_is_its_projection():
    mesh = together(square(20.0, z=10.0), square(200.0, z=0.0))
    floor = scatter(mesh, 5000, faces=slice(2, 4))
    position = floor.position(mesh)
    lamp = torch.tensor([0.0, 0.0, 30.0])
    directions, distance = unit(lamp - position), torch.linalg.vector_norm(lamp - position, dim=-1)
    hidden = Occluder(mesh).occluded(position, directions, distance, floor.face_normal(mesh))
    edge = position[:, :2].abs().amax(-1)  # the lamp doubles and a half the blocker: 15 mm
    assert hidden[edge < 14.9].all() and not hidden[edge > 15.1].any()


def test_only_what_stands_before_the_light_hides_it():
    mesh = square(20.0, z=10.0)
    origin, up = torch.zeros(2, 3), torch.tensor([[0.0, 0.0, 1.0]]).expand(2, 3)
    hidden = Occluder(mesh).occluded(origin, up, torch.tensor([9.0, 11.0]))
    assert hidden.tolist() == [False, True]


def test_closest_hit_says_where():
    mesh = sphere(50.0, centre=(10, 0, 0))
    directions = unit(torch.randn(500, 3, generator=torch.Generator().manual_seed(2)))
    origin = torch.tensor([10.0, 0, 0]).expand(500, 3)
    face, bary, distance = Occluder(mesh).closest(origin, directions)
    assert (face >= 0).all()
    hit = (bary[..., None] * mesh.corners[face]).sum(1)
    # measured 2e-5 mm on 50
    torch.testing.assert_close(hit, origin + distance[:, None] * directions, atol=1e-4, rtol=0)
    face, _, distance = Occluder(mesh).closest(origin + 200, directions.abs())
    assert (face == -1).all() and torch.isinf(distance).all()


def test_no_rays_no_answers():
    empty = torch.zeros(0, 3)
    assert Occluder(sphere()).occluded(empty, empty).shape == (0,)
