"""Normal maps: which way is up, and mirrored charts."""

import pytest
import torch
from shapes import square

from texsss.errors import DomainError, ShapeError
from texsss.surface.mesh import Mesh
from texsss.surface.normal_map import mapped_normals
from texsss.surface.points import Points


def sheet(mirrored: bool = False) -> tuple[Mesh, Points]:
    plain = square(100.0)
    uv = torch.tensor([[0.0, 1], [1, 1], [1, 0], [0, 0]])
    if mirrored:
        uv = torch.stack([1 - uv[:, 0], uv[:, 1]], -1)
    mesh = Mesh(plain.vertices, plain.faces, uv[plain.faces])
    return mesh, Points(torch.tensor([0, 1]), torch.full((2, 3), 1 / 3))


def colour(r: float, g: float, b: float) -> torch.Tensor:
    return torch.tensor([r, g, b]).expand(4, 4, 3)


def test_flat_is_straight():
    mesh, points = sheet()
    expected = torch.tensor([[0.0, 0, 1]]).expand(2, 3)
    torch.testing.assert_close(mapped_normals(points, mesh, colour(0.5, 0.5, 1)), expected)


@pytest.mark.parametrize("mirrored", [False, True])
def test_red_leans_along_u_and_green_up(mirrored):
    mesh, points = sheet(mirrored)
    right = mapped_normals(points, mesh, colour(1, 0.5, 1))
    assert bool((right[:, 0] * (-1 if mirrored else 1) > 0.6).all())
    green = colour(0.5, 1, 1)
    assert bool((mapped_normals(points, mesh, green)[:, 1] > 0.6).all())
    assert bool((mapped_normals(points, mesh, green, y_up=False)[:, 1] < -0.6).all())


def test_strength_and_missing_uv():
    mesh, points = sheet()
    flat = mapped_normals(points, mesh, colour(1, 1, 0.6), strength=0.0)
    torch.testing.assert_close(flat[:, 2], torch.ones(2))
    with pytest.raises(ShapeError, match=r"got grey"):
        mapped_normals(points, mesh, colour(1, 1, 0.6)[..., :1])
    with pytest.raises(ShapeError, match="unwrap"):
        mapped_normals(points, square(), colour(0.5, 0.5, 1))


def test_heights_and_directions_of_the_world_are_no_normal_map():
    mesh, points = sheet()
    heights = torch.rand(5, 6, 1, generator=torch.Generator().manual_seed(0)).expand(-1, -1, 3).clone()
    with pytest.raises(ShapeError, match="got grey"):
        mapped_normals(points, mesh, heights)
    heights[2, 3, 2] += 0.1  # one texel that has a colour
    assert mapped_normals(points, mesh, heights).shape == (2, 3)
    with pytest.raises(DomainError, match="tangent space"):
        mapped_normals(points, mesh, colour(0, -0.7, 0.7))
