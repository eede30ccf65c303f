"""Meshes with known answers."""

import torch
import trimesh

from texsss.surface.mesh import Mesh
from texsss.surface.points import Points


def sphere(
    radius: float = 100.0, subdivisions: int = 3, centre: tuple[float, float, float] = (0, 0, 0)
) -> Mesh:
    """An inscribed icosphere [mm]; 20 · 4^subdivisions faces."""
    ico = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    vertices = torch.tensor(ico.vertices, dtype=torch.float64) * radius + torch.tensor(centre).double()
    return Mesh(vertices.float(), torch.tensor(ico.faces))


def square(side: float = 200.0, z: float = 0.0) -> Mesh:
    """A square across +z [mm]."""
    h = side / 2
    vertices = torch.tensor([[-h, -h, z], [h, -h, z], [h, h, z], [-h, h, z]])
    return Mesh(vertices, torch.tensor([[0, 1, 2], [0, 2, 3]]))


def together(*meshes: Mesh) -> Mesh:
    """One mesh of several."""
    start = 0
    faces = []
    for mesh in meshes:
        faces.append(mesh.faces + start)
        start += mesh.vertices.shape[0]
    return Mesh(torch.cat([m.vertices for m in meshes]), torch.cat(faces))


def scatter(mesh: Mesh, count: int, seed: int = 0, faces: slice | None = None) -> Points:
    """Random points on faces of the mesh."""
    generator = torch.Generator().manual_seed(seed)
    bary = torch.rand(count, 3, generator=generator) + 1e-3
    choices = torch.arange(mesh.faces.shape[0])[faces or slice(None)]
    face = choices[torch.randint(len(choices), (count,), generator=generator)]
    return Points(face, bary / bary.sum(-1, keepdim=True))
