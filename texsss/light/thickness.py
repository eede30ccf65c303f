"""How thick an object is under each point of its surface, and where the far side lies."""

from dataclasses import dataclass

import torch

from texsss.light.sites import CHUNK
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Bool, Cancel, Float, Progress, Tensor, check_cancelled, chunks

SHELLS = 8  # surfaces that a ray passes through, at most: shells that lie within others count as one body


@dataclass(frozen=True, eq=False)
class FarSide:
    """What lies opposite P points, straight through the object.

    `thickness` (P,) [mm], infinite where nothing does; `points`: where (any point then); `opposite` (P,):
    0..1, how far the far side faces away, ½ (1 - n·n').
    """

    thickness: Float[Tensor, " P"]
    points: Points
    opposite: Float[Tensor, " P"]

    @property
    def found(self) -> Bool[Tensor, " P"]:
        """Where there is a far side."""
        return self.thickness < torch.inf


def far_side(
    points: Points,
    mesh: Mesh,
    occluder: Occluder,
    *,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> FarSide:
    """The far side of `points`: where a ray against the shading normal leaves the object.

    Gutter points look from the rim of their face. In an open mesh rays may leave without meeting a far
    side. Without gradients. Raises Cancelled.
    Source: d'Eon & Luebke 2007 (thickness along the normal), by rays in place of a shadow map.
    """
    parts = []
    rows = chunks(max(len(points), 1), CHUNK)
    for row in rows:
        check_cancelled(cancel)
        parts.append(_through(points[row], mesh, occluder))
        if progress is not None:
            progress("thickness", row.stop / rows[-1].stop)
    thickness, face, bary, opposite = (torch.cat(x) for x in zip(*parts, strict=True))
    return FarSide(thickness, Points(face.to(torch.int32), bary), opposite)


def _through(points: Points, mesh: Mesh, occluder: Occluder) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Thickness, far face, barycentrics and how opposite it is."""
    inside = points.bary.clamp_min(0)
    near = Points(points.face, inside / inside.sum(-1, keepdim=True))
    normal = near.normal(mesh).detach()
    origin = near.position(mesh).detach() - occluder.offset_mm * near.face_normal(mesh).detach()
    thickness = normal.new_full((len(points),), torch.inf)
    face = torch.zeros(len(points), dtype=torch.int64)
    bary = normal.new_full((len(points), 3), 1 / 3)
    going = torch.arange(len(points))
    depth = torch.ones(len(points), dtype=torch.int64)
    travelled = torch.zeros(len(points), dtype=normal.dtype)
    for _ in range(SHELLS):
        hit, place, distance = occluder.closest(origin[going], -normal[going])
        hits = hit >= 0
        going, hit, place, distance = going[hits], hit[hits], place[hits], distance[hits]
        if not len(going):
            break
        travelled[going] += distance
        # leaving one shell, or entering another that lies within
        leaves = (mesh.face_normals.detach()[hit] * normal[going]).sum(1) <= 0
        depth[going] += torch.where(leaves, -1, 1)
        out = depth[going] <= 0
        done = going[out]
        thickness[done], face[done] = travelled[done] + occluder.offset_mm, hit[out]
        bary[done] = place[out].to(bary)
        going = going[~out]
        step = 2 * occluder.offset_mm
        origin[going] = origin[going] - (distance[~out] + step)[:, None] * normal[going]
        travelled[going] += step
    far = Points(face, bary).normal(mesh).detach()
    opposite = (1 - (far * normal).sum(1)) / 2
    return thickness, face, bary, torch.where(thickness < torch.inf, opposite.clamp(0, 1), 0)
