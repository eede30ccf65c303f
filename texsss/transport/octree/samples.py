"""Where irradiance is sampled for the hierarchical integration: on a pattern within every triangle."""

import torch

from texsss.errors import DomainError
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Float, Int, Tensor

MOST_SAMPLES = 3_000_000  # what 4 GB hold with the profiles of eight Gaussians


def surface_samples(mesh: Mesh, spacing_mm: float) -> tuple[Points, Float[Tensor, " P"]]:
    """Points such that none of the surface is farther than `spacing_mm` from one, and the area of each [mm²].

    A triangle whose farthest corner lies d from its centroid is split into n² similar ones, n the least
    integer ≥ d / spacing; the centroids of those that are not flipped are the samples. Each has its own
    part's area and a third of every flipped neighbour's: equal shares, as the source has them, would
    leave the inside of a triangle dark by 1 / (n + 1). Triangles without area have no sample.
    Raises DomainError: when the spacing is not above 0, or asks for more than 3 million samples.
    Source: Mayorga 2008, section 4.1 (the mean free path for the spacing).
    """
    if not (spacing_mm > 0 and spacing_mm < float("inf")):
        raise DomainError(
            f"octree: expected a spacing > 0 of samples [mm], got {spacing_mm:g}; take a mean free path."
        )
    parts = _parts(mesh, spacing_mm)
    total = int((parts * (parts + 1) // 2).sum())
    if total > MOST_SAMPLES:
        raise DomainError(
            f"octree: samples every {spacing_mm:g} mm would be {total:,}, at most {MOST_SAMPLES:,} are "
            f"taken; try a spacing of {affordable_spacing(mesh, spacing_mm):.3g} mm."
        )
    faces, barys, areas = [], [], []
    for n in parts.unique().tolist():
        if n == 0:
            continue
        face = torch.nonzero(parts == n)[:, 0]
        bary, share = (x.to(mesh.vertices) for x in _pattern(n))
        faces.append(face.repeat_interleave(len(bary)))
        barys.append(bary.repeat(len(face), 1))
        areas.append((mesh.face_area[face].detach()[:, None] * share).flatten())
    face = torch.cat(faces) if faces else torch.zeros(0, dtype=torch.int64)
    if not len(face):
        raise DomainError(f"octree: {mesh.name} has no area to sample; check the mesh.")
    return Points(face.to(torch.int32), torch.cat(barys)), torch.cat(areas)


def affordable_spacing(mesh: Mesh, spacing_mm: float, most: int = MOST_SAMPLES) -> float:
    """`spacing_mm`, or the least multiple of it by √2 that takes at most `most` samples [mm]."""
    while True:
        parts = _parts(mesh, spacing_mm)
        if int((parts * (parts + 1) // 2).sum()) <= most or int(parts.max()) <= 1:
            return spacing_mm
        spacing_mm *= 2**0.5


def _parts(mesh: Mesh, spacing_mm: float) -> Int[Tensor, " F"]:
    """Into how many parts each side of a face is split; 0 for faces without area."""
    corners = mesh.corners.detach()
    farthest = torch.linalg.vector_norm(corners - corners.mean(1, keepdim=True), dim=-1).amax(1)
    # a corner of the pattern may lie on the limit exactly: digits must not add a row
    parts = torch.ceil(farthest.double() / spacing_mm * (1 - 1e-6)).clamp(1, 1e6).long()
    return torch.where(mesh.face_area.detach() > 0, parts, 0)


def _pattern(n: int) -> tuple[Float[Tensor, "N 3"], Float[Tensor, " N"]]:
    """Barycentrics of the centroids of the n (n + 1) / 2 parts that are not flipped, and their shares."""
    i, j = torch.meshgrid(torch.arange(n), torch.arange(n), indexing="ij")
    inside = i + j < n
    place = torch.stack([i[inside], j[inside], (n - 1 - i - j)[inside]], 1)
    # a part has a flipped neighbour across each side that is not on the rim
    return (place + 1 / 3) / n, (1 + (place > 0).sum(1) / 3) / n**2
