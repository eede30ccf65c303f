"""Normals, frames, metric and areas of meshes and points."""

import math

import pytest
import torch
from charted_shapes import sheet, sphere

from texsss.surface.mesh import Mesh
from texsss.surface.points import Points, face_jacobian

CUBE = torch.tensor([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
CUBE_FACES = torch.tensor(
    [
        0,
        1,
        3,
        0,
        3,
        2,
        4,
        6,
        7,
        4,
        7,
        5,
        0,
        4,
        5,
        0,
        5,
        1,
        2,
        3,
        7,
        2,
        7,
        6,
        0,
        2,
        6,
        0,
        6,
        4,
        1,
        5,
        7,
        1,
        7,
        3,
    ]
).reshape(12, 3)


def random_points(mesh: Mesh, count: int, seed: int = 0) -> Points:
    generator = torch.Generator().manual_seed(seed)
    weights = torch.rand(count, 3, generator=generator) + 0.01
    face = torch.randint(len(mesh.faces), (count,), generator=generator)
    return Points(face, weights / weights.sum(-1, keepdim=True))


def test_sphere_normals_point_away_from_its_centre():
    mesh = sphere(32, 64)
    expected = mesh.corners / torch.linalg.vector_norm(mesh.corners, dim=-1, keepdim=True)
    # angle weights on a 32 by 64 sphere; measured 0.002
    torch.testing.assert_close(mesh.corner_normals, expected, rtol=0, atol=4e-3)


def test_cube_keeps_its_edges():
    """Faces meet at 90°, above the crease: every corner has its own face's normal."""
    mesh = Mesh(CUBE, CUBE_FACES)
    torch.testing.assert_close(mesh.corner_normals, mesh.face_normals[:, None].expand(-1, 3, 3))
    assert bool(((mesh.corners.mean(1) * mesh.face_normals).sum(-1) > 0).all())


@pytest.mark.parametrize("scale", [1e-9, 1e-4, 1.0, 1e8])
def test_normals_and_areas_do_not_depend_on_the_unit(scale):
    """Nothing under- or overflows in float32 from femtometres to hundreds of kilometres."""
    mesh = sphere(64, 128)
    scaled = mesh.moved(mesh.vertices * scale)
    torch.testing.assert_close(scaled.face_normals, mesh.face_normals, rtol=0, atol=1e-4)
    torch.testing.assert_close(scaled.corner_normals, mesh.corner_normals, rtol=0, atol=1e-4)
    torch.testing.assert_close(
        scaled.face_area.double() / scale**2, mesh.face_area.double(), rtol=1e-3, atol=0
    )
    points = random_points(mesh, 100)
    torch.testing.assert_close(
        points.frame(scaled, mesh.source_uv), points.frame(mesh, mesh.source_uv), rtol=0, atol=1e-3
    )


def test_area_of_a_sphere():
    area = float(sphere(64, 128).face_area.sum())
    assert area == pytest.approx(4 * math.pi * 100, rel=2e-3)  # inscribed; measured 1.0e-3 below


def test_vertices_of_very_many_faces_stay_cheap():
    """A cone of 20 000 faces: pairs at its tip would be 4·10⁸."""
    count = 20_000
    turn = torch.arange(count) * (2 * math.pi / count)
    rim = torch.stack([torch.cos(turn), torch.zeros(count), -torch.sin(turn)], -1)
    around = torch.arange(count)
    faces = torch.stack([torch.full((count,), count), around, (around + 1) % count], -1)
    mesh = Mesh(torch.cat([rim, torch.tensor([[0.0, 1, 0]])]), faces)
    tip = mesh.corner_normals[:, 0]
    torch.testing.assert_close(tip, torch.tensor([0.0, 1, 0]).expand_as(tip), rtol=0, atol=1e-3)


def test_corner_normals_are_differentiable():
    mesh = sphere(4, 6).to(torch.float64)
    assert torch.autograd.gradcheck(
        lambda v: mesh.moved(v).corner_normals, (mesh.vertices.clone().requires_grad_(True),), atol=1e-5
    )


def test_area_is_differentiable():
    mesh = sphere(4, 6).to(torch.float64)
    vertices = mesh.vertices.clone().requires_grad_(True)
    assert torch.autograd.gradcheck(lambda v: mesh.moved(v).face_area, (vertices,), atol=1e-5)


def test_metric_of_a_scaled_sheet():
    """A 30 by 10 mm sheet over the square: du is 30 mm, dv 10 mm, at right angles."""
    mesh = sheet(3, width=30, height=10)
    points = random_points(mesh, 20)
    metric = points.metric(mesh, mesh.source_uv)
    torch.testing.assert_close(
        metric, torch.tensor([[900.0, 0], [0, 100]]).expand(20, 2, 2), rtol=1e-5, atol=1e-3
    )


def test_jacobian_carries_uv_steps_to_positions():
    """p(uv + d) = p(uv) + J d inside a face, sheared and mirrored uv included."""
    mesh = sphere(8, 12)
    turn = torch.tensor([[0.6, 0.3], [0.5, -0.9]])
    uv = mesh.source_uv @ turn
    jacobian = face_jacobian(mesh, uv)
    sound = jacobian.abs().sum((1, 2)) > 0
    steps = uv[:, 1:] - uv[:, :1]
    edges = mesh.corners[:, 1:] - mesh.corners[:, :1]
    torch.testing.assert_close((steps @ jacobian.mT)[sound], edges[sound], rtol=0, atol=1e-4)


@pytest.mark.parametrize("mirrored", [False, True])
def test_frames_follow_uv(mirrored):
    """T along +u, B along +v, N outward; with v down a frame is left-handed where uv is not mirrored."""
    mesh = sheet(2)
    uv = mesh.source_uv
    if mirrored:
        uv = uv * torch.tensor([-1.0, 1]) + torch.tensor([1.0, 0])
    frame = random_points(mesh, 10).frame(mesh, uv)
    side = -1.0 if mirrored else 1.0
    expected = torch.tensor([[side, 0, 0], [0, -1, 0], [0, 0, 1]])  # v down: B points to −y
    torch.testing.assert_close(frame, expected.expand_as(frame), rtol=0, atol=1e-6)


def test_frames_are_orthonormal_even_without_uv_area():
    mesh = sphere(8, 12)
    for uv in (mesh.source_uv, mesh.source_uv * 0 + 0.5):
        frame = random_points(mesh, 50).frame(mesh, uv)
        eye = torch.eye(3).expand(50, 3, 3)
        torch.testing.assert_close(frame @ frame.mT, eye, rtol=0, atol=1e-5)


def test_normals_beyond_a_face_stay_those_of_its_rim():
    """A gutter point far outside does not extrapolate normals into nonsense."""
    mesh = sphere(8, 12)
    far = Points(torch.tensor([20]), torch.tensor([[-7.0, 4.0, 4.0]]))
    rim = Points(torch.tensor([20]), torch.tensor([[0.0, 0.5, 0.5]]))
    torch.testing.assert_close(far.normal(mesh), rim.normal(mesh))
