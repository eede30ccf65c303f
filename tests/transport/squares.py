"""Flat squares whose every texel centre is known, and a sphere in six charts, for tests of diffusion."""

import torch
from shapes import sphere

from texsss.surface.mesh import Mesh
from texsss.surface.points import Points, TexelMaps
from texsss.surface.raster import rasterise
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


def lit(texels: TexelMaps) -> Float[Tensor, "P 3"]:
    """Light from one side, with hard edges in two channels."""
    position, normal = texels.points.position(texels.mesh), texels.points.normal(texels.mesh)
    light = (normal @ normal.new_tensor([0.3, 0.4, 0.86])).clamp_min(0)
    stripes = (torch.sin(position / 15).prod(-1) > 0).to(position.dtype)
    return torch.stack([light, light * stripes, stripes], 1)


def ball(size: int) -> TexelMaps:
    """A sphere of 100 mm in six square charts, distorted by up to a factor of three."""
    mesh = sphere(subdivisions=4)
    centre = mesh.corners.mean(1)
    axis = centre.abs().argmax(1)
    side = torch.gather(centre, 1, axis[:, None])[:, 0] > 0
    chart = axis * 2 + side
    rows = torch.arange(len(axis))
    others = torch.stack([(axis + 1) % 3, (axis + 2) % 3], 1)
    depth = torch.gather(mesh.corners, 2, axis[:, None, None].expand(-1, 3, 1)).abs()
    place = (
        torch.stack([mesh.corners[rows, :, others[:, 0]], mesh.corners[rows, :, others[:, 1]]], -1) / depth
    )
    place = torch.where(side[:, None, None], place, place.flip(-1)) * 0.12 + 0.16
    origin = torch.stack([chart % 3, chart // 3], 1) / 3
    return rasterise(mesh, (place + origin[:, None]).float(), (size, size))
