"""Meshes and atlases that tests build on."""

import math

import torch

from texsss.surface.mesh import Mesh


def sheet(n: int = 4, width: float = 10.0, height: float = 10.0) -> Mesh:
    """A flat n by n grid facing +z [mm], its uv the whole square, v down."""
    j, i = torch.meshgrid(torch.arange(n + 1.0), torch.arange(n + 1.0), indexing="xy")
    uv = torch.stack([j, i], -1).reshape(-1, 2) / n
    vertices = torch.stack([uv[:, 0] * width, (1 - uv[:, 1]) * height, torch.zeros(len(uv))], -1)
    row = torch.arange(n)[:, None] * (n + 1) + torch.arange(n)
    a, b, c, d = row.reshape(-1), row.reshape(-1) + 1, row.reshape(-1) + n + 1, row.reshape(-1) + n + 2
    faces = torch.stack([torch.stack([a, c, d], -1), torch.stack([a, d, b], -1)], 1).reshape(-1, 3)
    return Mesh(vertices, faces, uv[faces])


def sphere(n: int = 16, m: int = 32, radius: float = 10.0) -> Mesh:
    """A closed sphere [mm] with the equirectangular uv of its rings, v down; poles are flat in uv."""
    rings = torch.linspace(0, math.pi, n + 1)
    turns = torch.arange(m + 1) / m
    theta, phi = rings[:, None], turns * 2 * math.pi
    around = torch.cos(phi * (torch.arange(m + 1) < m)), torch.sin(phi * (torch.arange(m + 1) < m))
    x, z = torch.sin(theta) * around[0], torch.sin(theta) * around[1]
    points = torch.stack([x, torch.cos(theta).expand_as(x), -z], -1).reshape(-1, 3) * radius
    uv = torch.stack(torch.broadcast_tensors(turns, torch.arange(n + 1)[:, None] / n), -1).reshape(-1, 2)
    a = (torch.arange(n)[:, None] * (m + 1) + torch.arange(m)).reshape(-1)
    b = a + m + 1
    first, second = torch.stack([a, b, b + 1], -1), torch.stack([a, b + 1, a + 1], -1)
    faces = torch.stack([first, second], 1).reshape(n, 2 * m, 3)
    keep = torch.ones(n, 2 * m, dtype=torch.bool)
    keep[0, 1::2] = keep[-1, ::2] = False
    faces = faces[keep]
    _, one = torch.unique((points * 1e4).round(), dim=0, return_inverse=True)
    place = torch.zeros(int(one.max()) + 1, 3).index_copy(0, one, points)
    return Mesh(place, one[faces], uv[faces])


def soup(seed: int, count: int, low: float = 0.0, high: float = 1.0, size: float = 1.0) -> Mesh:
    """Random triangles in space with random uv in low..high, each spanning about `size` of it."""
    generator = torch.Generator().manual_seed(seed)
    vertices = torch.rand(3 * count, 3, generator=generator) * 10
    middle = torch.rand(count, 1, 2, generator=generator)
    uv = middle + (torch.rand(count, 3, 2, generator=generator) - 0.5) * size
    uv = low + uv.clamp(0, 1) * (high - low)
    return Mesh(vertices, torch.arange(3 * count).reshape(-1, 3), uv)
