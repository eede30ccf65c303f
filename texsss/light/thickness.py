"""How thick an object is under each point of its surface, and where the far side lies."""

from dataclasses import dataclass

import torch

from texsss.light.sites import CHUNK
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Bool, Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks

SHELLS = 8  # surfaces that a ray passes through, at most: shells that lie within others count as one body
STEEP = 0.3  # cosine to the face's normal from which a second ray is cast


@dataclass(frozen=True, eq=False)
class FarSide:
    """What lies opposite P points, straight through the object.

    `thickness` (P,) [mm], infinite where nothing does; `points`: where (any point then); `opposite` (P,):
    0..1, how far both sides face apart, √(½ (1 - n·n')): the cosine between either's normal and that of the
    plate which they bound.
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
    """The far side of `points`: where a ray against the shading normal leaves the object, or a shorter one.

    Where the far side is not parallel, a ray along the normal is too long, and ends where the object is
    thicker: so a second one goes straight through the plate that both sides bound, against n - n'. Gutter
    points look from the rim of their face. In an open mesh rays may leave without meeting a far side.
    Without gradients. Raises Cancelled.
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
    normal, outwards = near.normal(mesh).detach(), near.face_normal(mesh).detach()
    origin = near.position(mesh).detach() - occluder.offset_mm * outwards
    thickness, face, bary = _left(origin, -normal, mesh, occluder)
    # the plate between both sides
    across = torch.nn.functional.normalize(Points(face, bary).normal(mesh).detach() - normal, dim=1)
    some = torch.nonzero((thickness < torch.inf) & ((across * outwards).sum(1) < -STEEP))[:, 0]
    shorter, *place = _left(origin[some], across[some], mesh, occluder)
    better = shorter < thickness[some]
    for old, new in zip((thickness, face, bary), (shorter, *place), strict=True):
        old[some[better]] = new[better]
    cosine = (Points(face, bary).normal(mesh).detach() * normal).sum(1)
    opposite = ((1 - cosine) / 2).clamp(0, 1).sqrt()
    return thickness, face, bary, torch.where(thickness < torch.inf, opposite, 0)


def _left(
    origin: Float[Tensor, "P 3"], into: Float[Tensor, "P 3"], mesh: Mesh, occluder: Occluder
) -> tuple[Float[Tensor, " P"], Int[Tensor, " P"], Float[Tensor, "P 3"]]:
    """How far rays from within the object go until they have left it [mm], through which face and where."""
    origin = origin.clone()
    thickness = origin.new_full((len(origin),), torch.inf)
    face = torch.zeros(len(origin), dtype=torch.int64)
    bary = origin.new_full((len(origin), 3), 1 / 3)
    going = torch.arange(len(origin))
    depth = torch.ones(len(origin), dtype=torch.int64)
    travelled = torch.zeros(len(origin), dtype=origin.dtype)
    for _ in range(SHELLS):
        hit, place, distance = occluder.closest(origin[going], into[going])
        hits = hit >= 0
        going, hit, place, distance = going[hits], hit[hits], place[hits], distance[hits]
        if not len(going):
            break
        travelled[going] += distance
        # leaving one shell, or entering another that lies within
        leaves = (mesh.face_normals.detach()[hit] * into[going]).sum(1) >= 0
        depth[going] += torch.where(leaves, -1, 1)
        out = depth[going] <= 0
        done = going[out]
        thickness[done], face[done] = travelled[done] + occluder.offset_mm, hit[out]
        bary[done] = place[out].to(bary)
        going = going[~out]
        step = 2 * occluder.offset_mm
        origin[going] = origin[going] + (distance[~out] + step)[:, None] * into[going]
        travelled[going] += step
    return thickness, face, bary
