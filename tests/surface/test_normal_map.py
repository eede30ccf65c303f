"""Normal maps: which way is up, and mirrored charts."""

import pytest
import torch
from shapes import square

from texsss.errors import ShapeError
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
    with pytest.raises(ShapeError, match=r"red, green and blue, got 1 channel"):
        mapped_normals(points, mesh, colour(1, 1, 0.6)[..., :1])
    with pytest.raises(ShapeError, match="unwrap"):
        mapped_normals(points, square(), colour(0.5, 0.5, 1))
