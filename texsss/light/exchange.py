"""Light that parts of an object send each other: who sees whom, once, and what that carries."""

from dataclasses import dataclass

import torch
from torch.quasirandom import SobolEngine

from texsss.light.emitters import cosine_hemisphere
from texsss.light.sites import Sites, dot
from texsss.light.smoothing import neighbours_mean
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.numerics.threads import in_threads
from texsss.surface.points import Points, TexelMaps
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks

LOOKS = 8  # of every texel, in directions of its own
SHARING = 16  # texels that take each other's looks: 128 for each
RAYS = 1 << 15  # texels whose rays a thread traces at a time


@dataclass(frozen=True, eq=False)
class Exchange:
    """Which texels see which: `share` (R,) of the exitance at `source` (R,) enters at texel `row` (R,).

    Only pairs that see each other are listed, `LOOKS` for a texel at most.
    """

    sites: Sites
    row: Int[Tensor, " R"]
    source: Int[Tensor, " R"]
    share: Float[Tensor, " R"]

    def gathered(self, exitance: Float[Tensor, "P C"], cancel: Cancel | None = None) -> Float[Tensor, "P C"]:
        """Irradiance that enters at the texels from where `exitance` [W/m²] leaves others [W/m²].

        Without gradients. Raises Cancelled.
        """
        arriving = exitance.detach().index_select(0, self.source) * self.share[:, None]
        own = torch.zeros_like(exitance).index_add_(0, self.row, arriving)
        if not len(self.row):
            return own
        check_cancelled(cancel)
        return neighbours_mean(self.sites.position, self.sites.smooth, [own], SHARING, cancel)[0]


def exchange(
    texels: TexelMaps,
    sites: Sites,
    occluder: Occluder,
    *,
    eta: float = 1.0,
    looks: int = LOOKS,
    seed: int = 0,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Exchange:
    """What the texels of an object, at `sites`, see of each other.

    Each looks in `looks` directions, drawn by the cosine to its normal, and finds what it sees there; what
    leaves does so as F_t(cos) M / (π F_dt) and enters by F_t. The same seed gives the same.
    Without gradients. Raises Cancelled.
    """
    mesh, uv = texels.mesh, texels.atlas_uv
    height, width = texels.size
    place = torch.full((height * width,), -1, dtype=torch.int64)
    place[texels.index] = torch.arange(len(texels))
    place = place[texels.nearest.reshape(-1)]  # from anywhere in the square to the nearest texel
    common = SobolEngine(2, scramble=True, seed=seed).draw(looks)
    rows, ended = chunks(len(sites), RAYS), []

    def seen(part: slice) -> tuple[Tensor, Tensor, Tensor]:
        site = sites[part]
        generator = torch.Generator().manual_seed(seed + part.start)
        shift = torch.rand(len(site), 2, generator=generator)
        origin = site.origin + occluder.offset_mm * site.face_normal
        found = []
        for square in common:
            check_cancelled(cancel)
            direction, arriving = cosine_hemisphere(site.normal, torch.frac(square + shift).to(origin))
            face, bary, _ = occluder.closest(origin, direction)
            above = (face >= 0) & (dot(site.smooth, direction) > 0)  # bumps lift no horizon
            above &= dot(mesh.face_normals[face], direction) < 0  # nor do far sides send anything
            here = above.nonzero()[:, 0]
            there = Points(face[here].to(torch.int32), bary[here].to(origin))
            share = direction.new_full((len(here),), 1 / looks)
            if eta != 1:
                leaving = -dot(there.normal(mesh), direction[here])
                passes = fresnel.transmittance(leaving.clamp_min(0), eta) / fresnel.F_dt(eta)
                share = share * passes * fresnel.transmittance(arriving[here], eta)
            found.append((here + part.start, place[_texel(there.uv(uv), height, width)], share))
        ended.append(part)
        if progress is not None:
            progress("light", len(ended) / len(rows))
        row, source, share = (torch.cat(x) for x in zip(*found, strict=True))
        return row.to(torch.int32), source.to(torch.int32), share

    _ = mesh.corner_normals, mesh.face_normals  # by all threads, before they part
    row, source, share = (torch.cat(x) for x in zip(*in_threads(seen, rows, cancel), strict=True))
    return Exchange(sites, row, source, share)


def _texel(uv: Float[Tensor, "R 2"], height: int, width: int) -> Int[Tensor, " R"]:
    """Row-major index of the texel that holds `uv`."""
    column = (uv[:, 0] * width).long().clamp(0, width - 1)
    return (uv[:, 1] * height).long().clamp(0, height - 1) * width + column
