"""Shadows that flat faces throw on each other although the smooth surface that they stand for is lit."""

import torch

from texsss.light.sites import dot
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh
from texsss.types import Bool, Float, Tensor

REACH = 2.0  # edges of a face that it is cut off within: what is farther throws a true shadow
PASSES = 3  # of flat faces one after the other, that a ray may have cut off


def cut_by_faces(
    origins: Float[Tensor, "P 3"],
    directions: Float[Tensor, "P 3"],
    distance: Float[Tensor, " P"] | None,
    mesh: Mesh,
    occluder: Occluder,
) -> Bool[Tensor, " P"]:
    """Whether all that stands between `origins` [mm] and the light are corners that flat faces cut off.

    For rays that are hidden, along unit `directions`, from the lifted starts of `sites_at`, `offset_mm` off
    their faces: those do for convex parts, but saddles and hollows leave teeth along the terminator. A ray
    that enters a face whose smooth normal faces the light enters no smooth surface: it may go on where it
    leaves again nearby, no deeper beneath the face than the corners' tangent planes stand off it. Sheets
    without a back hide all. `distance` [mm] of the light, None: the sky. Without gradients.
    """
    corners, corner_normals = mesh.corners.detach(), mesh.corner_normals.detach()
    face_normals, aside = mesh.face_normals.detach(), occluder.offset_mm
    free = torch.zeros(len(origins), dtype=torch.bool, device=origins.device)
    rows, start = torch.arange(len(origins), device=origins.device), origins.detach()
    ahead, left = directions.detach(), None if distance is None else distance.detach()
    for _ in range(PASSES):
        if not len(rows):
            break
        face, bary, near = occluder.closest(start, ahead)
        normals, steep = corner_normals[face], -dot(face_normals[face], ahead)
        smooth = (normals * bary[..., None].to(ahead)).sum(1)
        inside = start + (near + aside)[:, None].to(ahead) * ahead
        out, _, far = occluder.closest(inside, ahead)
        enters = (face >= 0) & (steep > 0) & (dot(smooth, ahead) > 0)
        leaves = (out >= 0) & (dot(face_normals[out], ahead) > 0)
        edge = (corners[face] - corners[face].roll(1, 1)).square().sum(-1).amax(1).sqrt()
        nigh = torch.maximum(near, far).to(edge) <= REACH * edge
        if left is not None:  # a light within hides itself
            nigh &= left > (near + far + 2 * aside).to(left)
        kept = enters & leaves & nigh & (far.to(steep) * steep <= _stand_off(corners[face], normals))
        rows, ahead = rows[kept], ahead[kept]
        start = inside[kept] + (far[kept] + aside)[:, None].to(ahead) * ahead
        left = None if left is None else (left - (near + far + 2 * aside).to(left))[kept]
        hidden = occluder.occluded(start, ahead, left)
        free[rows[~hidden]] = True
        rows, start, ahead = rows[hidden], start[hidden], ahead[hidden]
        left = None if left is None else left[hidden]
    return free


def _stand_off(corners: Float[Tensor, "P 3 3"], normals: Float[Tensor, "P 3 3"]) -> Float[Tensor, " P"]:
    """How far the corners of faces lie off each other's tangent planes, at most [mm]."""
    apart = corners[:, :, None] - corners[:, None]  # to the first corner from the second
    return (apart * normals[:, None]).sum(-1).abs().amax((1, 2))
