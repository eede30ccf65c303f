"""A pose: where the vertices of a mesh stand once it has been bent."""

from dataclasses import dataclass

import torch

from texsss.errors import DomainError, ShapeError
from texsss.surface.mesh import Mesh
from texsss.types import Float, Tensor


@dataclass(frozen=True, eq=False)
class Pose:
    """New positions of the vertices of a mesh, whose triangles and texture coordinates stay.

    `vertices` (V, 3) [mm], y up: one for every vertex of the mesh as it is baked (`Baker.mesh`), or one for
    every vertex of its file, in the file's order. `operators`: whether what carries light over the surface
    stays that of the rest pose, or is made anew for this one.
    Raises ShapeError or DomainError: when these are no finite positions, or `operators` is neither.
    """

    vertices: Tensor  # its shape is the user's to get right
    operators: str = "rest"

    def __post_init__(self):
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or not self.vertices.is_floating_point():
            raise ShapeError(
                f"Pose: expected real vertices of shape (V, 3) [mm], got {tuple(self.vertices.shape)} of "
                f"{self.vertices.dtype}; pass one position per vertex."
            )
        wrong = int((~torch.isfinite(self.vertices.detach())).any(-1).sum())
        if wrong:
            raise DomainError(
                f"Pose: expected finite vertices, got NaN or infinity in {wrong:,} of "
                f"{len(self.vertices):,}; check what made them."
            )
        if self.operators not in ("rest", "pose"):
            raise DomainError(f"Pose: expected operators of rest or pose, got {self.operators!r}.")

    def of(self, mesh: Mesh, in_file: int) -> Mesh:
        """`mesh` in this pose; its file has `in_file` vertices.

        Where vertices of the file have become one, the first of them says where that is.
        Differentiable in the vertices. Raises ShapeError: when they are of another mesh. DomainError: when
        all lie in one point.
        """
        given, own = len(self.vertices), len(mesh.vertices)
        if given not in (own, in_file):
            other = "" if own == in_file else f", or {in_file:,} as its file has"
            raise ShapeError(
                f"Pose: expected {own:,} vertices, as many as {mesh.name} has{other}, got {given:,}; "
                "pose the vertices of Baker.mesh(scene)."
            )
        # as many of both means that none was merged or dropped
        rows = self.vertices
        if given != own and mesh.source_vertex is not None:
            rows = rows[mesh.source_vertex]
        return mesh.moved(rows.to(mesh.vertices))


def stretch(rest: Mesh, posed: Mesh) -> float:
    """How much distances along the surface changed: the area-weighted RMS of |ln| of principal stretches.

    .02 means that distances differ by 2 %; bending without stretching is 0.
    """
    first, second = (_edges(mesh) for mesh in (rest, posed))
    # first fundamental forms of both in one basis: their ratio's eigenvalues are squared stretches
    mixed = torch.linalg.solve_ex(first.transpose(-1, -2) @ first, second.transpose(-1, -2) @ second)[0]
    half_trace, det = mixed.diagonal(dim1=-2, dim2=-1).sum(-1) / 2, torch.linalg.det(mixed)
    root = (half_trace**2 - det).clamp_min(0).sqrt()
    squared = torch.stack([half_trace + root, half_trace - root], -1)
    sound = (rest.face_area > 0) & torch.isfinite(squared).all(-1)
    logs = squared.clamp_min(1e-12).log() / 2
    mean = (logs.square().mean(-1) * rest.face_area)[sound].sum() / rest.face_area[sound].sum()
    return float(mean.detach().sqrt())


def _edges(mesh: Mesh) -> Float[Tensor, "F 3 2"]:
    a, b, c = mesh.corners.detach().double().unbind(1)
    return torch.stack([b - a, c - a], -1)
