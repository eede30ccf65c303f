"""Curvature of shapes that have a known one."""

import pytest
import torch
import trimesh

from texsss.surface.curvature import curvature_at, shape_operators
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points

RADIUS = 3.0


def as_mesh(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(torch.tensor(shape.vertices).float(), torch.tensor(shape.faces).int())


def middles(mesh: Mesh) -> Points:
    count = len(mesh.faces)
    return Points(torch.arange(count, dtype=torch.int32), torch.full((count, 3), 1 / 3))


@pytest.mark.parametrize("inward", [False, True])
def test_a_sphere_curves_alike_everywhere(inward):
    shape = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    if inward:
        shape.invert()
    mesh = as_mesh(shape)
    points = middles(mesh)
    normal = points.normal(mesh)
    found = curvature_at(points, mesh, shape_operators(mesh)) * (-RADIUS if inward else RADIUS)
    expected = torch.eye(3) - normal[:, :, None] * normal[:, None]
    torch.testing.assert_close(found, expected, rtol=0, atol=0.03)  # measured .021, where five edges meet


def test_a_torus_curves_as_its_ring_and_its_tube_do():
    ring, tube = 6.0, 2.0
    mesh = as_mesh(trimesh.creation.torus(ring, tube, major_sections=192, minor_sections=96))
    points = middles(mesh)
    found = curvature_at(points, mesh, shape_operators(mesh))
    place = points.position(mesh)
    out = torch.nn.functional.normalize(place * torch.tensor([1.0, 1.0, 0.0]), dim=1)
    normal = torch.nn.functional.normalize(place - ring * out, dim=1)
    along = torch.linalg.cross(torch.tensor([0.0, 0.0, 1.0]).expand_as(out), out)
    around = torch.linalg.cross(normal, along)
    tilt = (normal * out).sum(1)
    sizes = 1 / tube, (tilt / (ring + tube * tilt))[:, None, None]
    expected = sum(k * t[:, :, None] * t[:, None] for k, t in zip(sizes, (around, along), strict=True))
    torch.testing.assert_close(found, expected, rtol=0, atol=0.01)


def test_faces_without_extent_do_not_curve():
    corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]])
    mesh = Mesh(corners, torch.tensor([[0, 1, 2], [1, 3, 1]]).int())
    assert bool(torch.isfinite(shape_operators(mesh)).all())
