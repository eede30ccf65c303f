"""Meshes, media and depth maps that the tests of the march share."""

import math

import torch

from texsss.media.medium import Medium
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points

SUN = (-0.3, 0.8, 0.6)
UNIT = (1.0, 1.0, 1.0)


def fish(eta: float = 1.0) -> list[Medium]:
    return [
        Medium([0.6, 0.6, 0.6], [2.0, 1.0, 1.0], 0.25, eta),
        Medium([0.6, 0.6, 0.6], [6.0, 3.0, 2.0], 0.40, eta),
        Medium([0.5, 0.5, 0.5], [1.0, 1.0, 2.0], 0.80, eta),
    ]


def square(dtype=torch.float32, edge: float = 100.0) -> Mesh:
    """A horizontal square, seen from above."""
    corners = torch.tensor([[-0.5, 0, 0.5], [0.5, 0, 0.5], [0.5, 0, -0.5], [-0.5, 0, -0.5]], dtype=dtype)
    uv = torch.tensor([[0.0, 1], [1, 1], [1, 0], [0, 0]], dtype=dtype)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    return Mesh(corners * edge, faces, uv[faces])


def hills(dtype=torch.float64, count: int = 24, edge: float = 12.0, height: float = 0.4) -> Mesh:
    """A wavy sheet, edge × edge mm."""
    s = torch.linspace(0, 1, count, dtype=dtype)
    v, u = torch.meshgrid(s, s, indexing="ij")
    y = height * torch.sin(9 * u) * torch.cos(7 * v)
    vertices = torch.stack([(u - 0.5) * edge, y, (v - 0.5) * edge], -1).reshape(-1, 3)
    i = torch.arange(count * count).reshape(count, count)
    a, b, c, d = (x.reshape(-1) for x in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    faces = torch.cat([torch.stack([a, d, c], 1), torch.stack([a, c, b], 1)])
    return Mesh(vertices, faces, torch.stack([u, v], -1).reshape(-1, 2)[faces])


def veins(size: int = 64, dtype=torch.float64) -> torch.Tensor:
    """Three boundaries, periodic [mm]."""
    s = 2 * math.pi * (torch.arange(size, dtype=dtype) + 0.5) / size
    v, u = torch.meshgrid(s, s, indexing="ij")
    ridge = torch.exp(-8 * (torch.sin(2 * u + torch.sin(v)) ** 2))
    return torch.stack([0.2 + 0 * u, 0.3 + 0.5 * ridge, 1.8 - 0.3 * torch.cos(3 * v)], -1)


def steps(size: int = 64, dtype=torch.float64) -> torch.Tensor:
    """Three boundaries with sudden steps [mm]."""
    checks = (torch.arange(size)[:, None] // 8 + torch.arange(size)[None] // 8).remainder(2).to(dtype)
    return torch.stack([0.2 + 0.1 * checks, 0.5 + 0.6 * checks, 1.8 + 0 * checks], -1)


def scattered_points(mesh: Mesh, count: int, seed: int) -> Points:
    generator = torch.Generator().manual_seed(seed)
    face = torch.randint(mesh.faces.shape[0], (count,), generator=generator)
    corner = torch.rand(count, 2, generator=generator, dtype=torch.float64)
    root = corner[:, 0].sqrt()
    bary = torch.stack([1 - root, root * (1 - corner[:, 1]), root * corner[:, 1]], -1)
    return Points(face, bary)


def centre(count: int, dtype=torch.float32) -> Points:
    return Points(torch.zeros(count, dtype=torch.long), torch.full((count, 3), 1 / 3, dtype=dtype))
