"""Depth textures of an object whose layers are modelled as nested meshes."""

from collections.abc import Sequence

import torch

from texsss.errors import ShapeError
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled, chunks

CHUNK = 2**18  # rays at once


def depths_from_meshes(
    points: Points,
    mesh: Mesh,
    layers: Sequence[Mesh],
    *,
    greatest_mm: float | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "P L"]:
    """Depth [mm] of every layer's lower boundary under `points`, along the inward normal; never decreasing.

    `layers`: closed meshes [mm] within each other and within `mesh`, from the outermost. A boundary that
    a ray misses, or meets only beyond the far side of the object, lies at that far side: the layer is as
    deep as the object there. One that is met behind a deeper one touches it; one that sticks out of the
    object lies at its surface there. `greatest_mm` caps all.
    Not differentiable; float32 rays. Raises ShapeError: without layers; Cancelled.
    Rays start a hair inside; the depths count from the surface.
    """
    if not layers:
        raise ShapeError("depths_from_meshes: expected at least one layer mesh, got none; pass one.")
    around = Occluder(mesh)
    inside = [Occluder(layer) for layer in layers]
    found = []
    for part in chunks(len(points), CHUNK):
        check_cancelled(cancel)
        some = points[part]
        ahead = -some.normal(mesh)
        start = some.position(mesh) + around.offset_mm * ahead
        # smooth normals may point out of coarse faces; then the far side is where the ray starts
        far = around.closest(start, ahead)[2]
        far = torch.where(torch.isfinite(far), far, torch.zeros_like(far))
        depths = [
            torch.minimum(_met(boundary, layer, start, ahead), far)
            for boundary, layer in zip(inside, layers, strict=True)
        ]
        found.append(torch.stack(depths, -1).cummax(-1).values + around.offset_mm)
        if progress is not None:
            progress("depths", part.stop / len(points))
    depth = torch.cat(found)
    return depth if greatest_mm is None else depth.clamp_max(greatest_mm)


def _met(
    boundary: Occluder, layer: Mesh, start: Float[Tensor, "P 3"], ahead: Float[Tensor, "P 3"]
) -> Float[Tensor, " P"]:
    """Distance to a closed mesh [mm]; 0 where the ray starts within it, infinite where it misses."""
    corners = layer.vertices[layer.faces]
    normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = (corners[:, 0] * normal).sum().sign()  # of the volume: faces may be wound either way
    face, _, distance = boundary.closest(start, ahead)
    leaves = (outwards * (normal[face.clamp_min(0)] * ahead).sum(-1) > 0) & (face >= 0)
    return torch.where(leaves, 0, distance)
