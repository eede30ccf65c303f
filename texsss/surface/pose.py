"""A pose: where the vertices of a mesh stand once it has been bent."""

import math
from dataclasses import dataclass

import torch

from texsss.errors import DomainError, ShapeError
from texsss.surface.mesh import Mesh
from texsss.types import Float, Tensor

STRETCHED, KNOWN = 0.1, 0.3  # with operators of rest exitance is off by a tenth of the stretch, as measured
TORN = 1.0  # stretch from which vertices are more likely in a wrong order


@dataclass(frozen=True, eq=False)
class Pose:
    """New positions of the vertices of a mesh, whose triangles and texture coordinates stay.

    `vertices` (V, 3) [mm], y up: one for every vertex of the mesh as it is baked (`Baker.mesh`), or one for
    every vertex of its file, in the file's order, but always where the baked mesh is (one that lies far from
    the origin has been moved there). `operators`: whether what carries light over the surface stays that of
    the rest pose, or is made anew for this one.
    Raises ShapeError or DomainError: when these are no positions, or `operators` is neither.
    """

    vertices: Tensor  # its shape is the user's to get right
    operators: str = "rest"

    def __post_init__(self):
        if not isinstance(self.vertices, Tensor):
            raise ShapeError(
                f"Pose: expected vertices as a tensor (V, 3) [mm], got a {type(self.vertices).__name__}; "
                "convert it by torch.as_tensor."
            )
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or not self.vertices.is_floating_point():
            raise ShapeError(
                f"Pose: expected real vertices of shape (V, 3) [mm], got {tuple(self.vertices.shape)} of "
                f"{self.vertices.dtype}; pass one position per vertex."
            )
        if self.operators not in ("rest", "pose"):
            raise DomainError(f"Pose: expected operators of rest or pose, got {self.operators!r}.")

    def of(self, mesh: Mesh, in_file: int) -> Mesh:
        """`mesh` in this pose; its file has `in_file` vertices.

        Where vertices of the file have become one, the first of them says where that is.
        Differentiable in the vertices. Raises ShapeError: when they are of another mesh. DomainError: when
        some that the mesh uses are not finite, or all lie in one point.
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
        wrong = int((~torch.isfinite(rows.detach())).any(-1).sum())
        if wrong:
            raise DomainError(
                f"Pose: expected finite vertices, got NaN or infinity in {wrong:,} of {len(rows):,}; check "
                "what made them."
            )
        rows = rows.to(mesh.vertices)
        extent = rows.detach().amax(0) - rows.detach().amin(0)
        if not 0 < float(extent.max()) < math.inf:
            raise DomainError(
                "Pose: expected vertices with an extent that numbers of 32 bits hold, got "
                f"{float(extent.max()):g} mm; check the unit of what made them."
            )
        return mesh.moved(rows)


def doubts_of(rest: Mesh, posed: Mesh, stretch: float, kept: bool) -> list[str]:
    """What is doubtful about a pose of known stretch, in sentences; `kept`: with the operators of rest."""
    if stretch > TORN:
        return [
            f"The pose stretches the surface {math.exp(stretch):.3g} times (RMS); check that its vertices "
            "come in the order of the mesh."
        ]
    before, after = (_volume(mesh) for mesh in (rest, posed))
    if before * after < 0 and 0.5 < abs(after / before) < 2:
        return ["The pose turns the mesh inside out, where it is dark; an axis of it is mirrored."]
    if stretch < STRETCHED or not kept:
        return []
    off = f"about {stretch / 10:.1%}" if stretch < KNOWN else "more than 3 %"
    return [
        f"The pose stretches the surface by {math.expm1(stretch):.0%} (RMS), but light spreads over it as at "
        f'rest, {off} off; make its operators anew (--refresh-operators, "operators": "pose").'
    ]


def _volume(mesh: Mesh) -> float:
    corners = mesh.corners.detach().double()
    return float(torch.linalg.det(corners - corners.mean((0, 1))).sum() / 6)


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
