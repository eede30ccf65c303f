"""How a mesh curves: the change of its shading normals along it."""

import torch

from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Float, Tensor

LEAST = 1e-12  # of squared areas and edges [mm⁴]: faces without extent do not curve


def shape_operators(mesh: Mesh) -> Float[Tensor, "V 3 3"]:
    """The shape operator at the vertices [1/mm]: t·S t is the curvature along t, positive where convex.

    Symmetric, and nothing across the surface. That of each face turns its edges into what the normals change
    along them; a vertex has the mean of its faces by area. Creases, where corners have normals of their own,
    do not count. Without gradients. Source: Rusinkiewicz 2004.
    """
    corners, normals = mesh.corners.detach(), mesh.corner_normals.detach()
    edges, turns = corners[:, 1:] - corners[:, :1], normals[:, 1:] - normals[:, :1]
    gram = edges @ edges.mT
    first, mixed, second = gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]
    det = first * second - mixed**2  # 4 area²
    sound = det > LEAST
    adjugate = torch.stack([second, -mixed, -mixed, first], -1).reshape(-1, 2, 2)
    inverse = adjugate * (sound / torch.where(sound, det, 1))[:, None, None]
    operator = turns.mT @ inverse @ edges
    flat = (
        torch.eye(3).to(operator)
        - mesh.face_normals.detach()[:, :, None] * mesh.face_normals.detach()[:, None]
    )
    operator = flat @ (operator + operator.mT) @ flat / 2
    area = det.clamp_min(0).sqrt()
    faces = mesh.faces.long().flatten()
    weight = corners.new_zeros(len(mesh.vertices)).index_add_(0, faces, area.repeat_interleave(3))
    total = corners.new_zeros(len(mesh.vertices), 3, 3)
    total.index_add_(0, faces, (operator * area[:, None, None]).repeat_interleave(3, 0))
    return total / torch.where(weight > 0, weight, 1)[:, None, None]


def curvature_at(points: Points, mesh: Mesh, operators: Float[Tensor, "V 3 3"]) -> Float[Tensor, "P 3 3"]:
    """The shape operator at points, between those of the vertices; gutter points have those of their rim."""
    inside = points.bary.clamp_min(0).to(operators)
    inside = inside / inside.sum(-1, keepdim=True)
    corner = operators.flatten(1)[mesh.faces.long()[points.face.long()]]
    return (inside[:, :, None] * corner).sum(1).reshape(-1, 3, 3)
