"""Flat squares whose every texel centre is known, for tests of diffusion."""

import torch

from texsss.surface.mesh import Mesh
from texsss.surface.points import Points, TexelMaps
from texsss.types import Float, Tensor


def square(
    n: int, side: float, *, uv: Float[Tensor, "4 2"] | None = None, dtype: torch.dtype = torch.float32
) -> TexelMaps:
    """n² texels of a square of `side` mm in the plane z = 0, whose corners lie at `uv` (a parallelogram)."""
    place = torch.tensor([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=dtype)
    corners = place if uv is None else uv.to(dtype)
    vertices = torch.cat([place * side, torch.zeros(4, 1, dtype=dtype)], 1)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    i, j = torch.meshgrid(torch.arange(n), torch.arange(n), indexing="ij")
    centre = (torch.stack([j, i], -1).reshape(-1, 2).to(dtype) + 0.5) / n
    edges = torch.stack([corners[1] - corners[0], corners[3] - corners[0]], -1)
    a, b = torch.linalg.solve(edges, (centre - corners[0]).T)  # position in the square, 0..1
    inside = torch.nonzero((a >= 0) & (a < 1) & (b >= 0) & (b < 1))[:, 0]
    a, b = a[inside], b[inside]
    first = a >= b
    bary = torch.where(first[:, None], torch.stack([1 - a, a - b, b], -1), torch.stack([1 - b, a, b - a], -1))
    points = Points((~first).int(), bary, inside.int())
    covered = torch.ones(len(inside), dtype=torch.bool)
    return TexelMaps(Mesh(vertices, faces), corners[faces], points, covered, (n, n))


def gaussian(variance: float, squared: Tensor) -> Tensor:
    """The unit Gaussian of `variance` [mm²] at squared distances [1/mm²]."""
    return torch.exp(-squared / (2 * variance)) / (2 * torch.pi * variance)
