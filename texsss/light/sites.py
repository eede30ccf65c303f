"""Where light arrives: positions, normals and the starts of shadow rays at points of a mesh."""

from dataclasses import dataclass

import torch

from texsss.numerics.threads import in_threads
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Float, Tensor, chunks, unit

CHUNK = 1 << 15  # points at a time: what the cache of a core holds


@dataclass(frozen=True, eq=False)
class Sites:
    """What lights need to know of P points, (P, 3) each.

    `position` [mm]; `smooth`: the mesh's unit shading normals; `normal`: those that light is measured
    against, bumped or the same; `face_normal`: of the flat faces; `origin`: where shadow rays start [mm].
    """

    position: Float[Tensor, "P 3"]
    smooth: Float[Tensor, "P 3"]
    normal: Float[Tensor, "P 3"]
    face_normal: Float[Tensor, "P 3"]
    origin: Float[Tensor, "P 3"]

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows: slice) -> "Sites":
        smooth = self.smooth[rows]
        normal = smooth if self.normal is self.smooth else self.normal[rows]
        return Sites(self.position[rows], smooth, normal, self.face_normal[rows], self.origin[rows])


def sites_at(points: Points, mesh: Mesh, normals: Float[Tensor, "P 3"] | None = None) -> Sites:
    """The sites of `points`; `normals` (P, 3) take the place of the mesh's shading normals (bump).

    Shadow rays start from the points lifted onto the curved surface that the normals imply: a flat face
    lies below it where it is convex, and its neighbours would shadow it in steps along the terminator.
    Each corner's tangent plane lifts the point by its distance below it; the lifts are blended by the
    barycentrics. Concave parts stay. Gutter points start from the nearest point of their face.
    Differentiable in vertices and `normals`, but for the starts.
    Source: Hanika 2021 (Ray Tracing Gems II, ch. 4).
    """
    _ = mesh.corner_normals  # by all threads, before they part
    rows = chunks(max(len(points), 1), CHUNK)
    parts = in_threads(lambda row: _chunk(points[row], mesh), rows, graded=mesh.vertices.requires_grad)
    position, smooth, face_normal, origin = (torch.cat(values) for values in zip(*parts))
    return Sites(position, smooth, smooth if normals is None else normals, face_normal, origin)


def _chunk(points: Points, mesh: Mesh) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Position, smooth normal, face normal and start of the rays."""
    face, bary = points.face.long(), points.bary.to(mesh.vertices.dtype)
    corners, corner_normals = mesh.corners[face], mesh.corner_normals[face]
    smooth = unit(_blend(bary, corner_normals))
    origin = _lifted(bary.detach(), corners.detach(), corner_normals.detach())
    return _blend(bary, corners), smooth, mesh.face_normals[face].detach(), origin


def smooth_origin(points: Points, mesh: Mesh) -> Float[Tensor, "P 3"]:
    """Where shadow rays start [mm], see `sites_at`. Without gradients."""
    face, bary = points.face.long(), points.bary.detach().to(mesh.vertices.dtype)
    return _lifted(bary, mesh.corners.detach()[face], mesh.corner_normals.detach()[face])


def _lifted(
    bary: Float[Tensor, "P 3"], corners: Float[Tensor, "P 3 3"], normals: Float[Tensor, "P 3 3"]
) -> Float[Tensor, "P 3"]:
    """Where shadow rays start, see `sites_at`."""
    inside = bary.clamp_min(0)
    inside = inside / inside.sum(-1, keepdim=True)
    position = _blend(inside, corners)
    origin = position
    for k in range(3):
        below = dot(position - corners[:, k], normals[:, k]).clamp_max(0)
        origin = origin - (inside[:, k] * below)[:, None] * normals[:, k]
    return origin


def _blend(bary: Float[Tensor, "P 3"], corners: Float[Tensor, "P 3 3"]) -> Float[Tensor, "P 3"]:
    """Σ bary × corner, written out: four times as fast as einsum on matrices this small."""
    return bary[:, :1] * corners[:, 0] + bary[:, 1:2] * corners[:, 1] + bary[:, 2:] * corners[:, 2]


def dot(a: Float[Tensor, "P 3"], b: Float[Tensor, "P 3"]) -> Float[Tensor, " P"]:
    """Scalar products, written out for the same reason."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
