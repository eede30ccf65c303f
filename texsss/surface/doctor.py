"""The UV doctor: everything that can be wrong with texture coordinates and topology, measured."""

from dataclasses import dataclass

import numpy as np
import torch

from texsss.surface._scanline import Spans, disjoint, doubled_area, spans
from texsss.surface._uv_picture import drawn, image_of
from texsss.surface.atlas import MARGIN, AtlasReport, examine_uv
from texsss.surface.dilate import nearest_filled
from texsss.surface.mesh import Mesh
from texsss.surface.metric import Spread, anisotropies, texel_sizes
from texsss.surface.raster import looked_at, snapped
from texsss.surface.topology import (
    Edges,
    closed_volume,
    components,
    edge_report,
    shared_edges,
    uv_corners,
)
from texsss.types import Cancel, Float, Int, Tensor

MIRROR = 0.1  # share of a chart that must be turned at least to count as its mirrored half, not as a fold


@dataclass(frozen=True)
class UvReport:
    """What the doctor found; faces are counted, shares are of the surface's area in 0..1.

    `atlas`: whether the coordinates could store light, and why not. `mirrored`: faces in charts, or halves
    of charts, that lie mirrored, which is fine. `flipped`: fewer faces turned against their chart: folds.
    `flat`, `outside`: faces without area in uv, faces that leave the square. `overlapping`: faces of which
    a part lies under another. `texel_mm` and `stretch`: a texel's edge on the surface [mm] and its
    longest over its shortest extent. `padding_texels`: least distance between charts, None for a single
    one. `covered`: share of the square's texels. `edges`: open, non-manifold and inconsistent ones.
    `parts`: connected parts of the surface; `inside_out`: how many of the closed ones face inward.
    """

    atlas: AtlasReport
    faces: int
    mirrored: int
    flipped: int
    flat: int
    outside: int
    overlapping: int
    texel_mm: Spread
    stretch: Spread
    padding_texels: float | None
    covered: float
    edges: Edges
    parts: int
    inside_out: int


def examine(
    mesh: Mesh, uv: Float[Tensor, "F 3 2"], size: tuple[int, int], cancel: Cancel | None = None
) -> tuple[UvReport, Float[Tensor, "h w 3"]]:
    """A report on `uv` as an atlas of `size` (H, W) [texels], and a picture of it.

    The picture shows sound faces grey, mirrored ones blue, flipped ones yellow, those outside of the square
    violet where they lie, overlaps red, faces without area as green dots, and the borders of charts white;
    see `drawn`. Raises Cancelled.
    """
    neighbours = shared_edges(uv_corners(mesh.faces, uv))
    chart = components(len(mesh.faces), neighbours)
    inside = ((uv >= -MARGIN) & (uv <= 1 + MARGIN)).all(-1).all(-1)
    placed = torch.where(inside[:, None, None], uv.detach(), torch.zeros_like(uv)).clamp(0, 1)
    shown = looked_at(placed, size)
    grid = snapped(placed, shown)
    claims = spans(grid, shown, cancel)
    winners = disjoint(claims, cancel)
    count = len(mesh.faces)
    lost = claims.texels_per_face(count) > winners.texels_per_face(count)
    gap = _padding(winners, chart, shown)
    mirrored, flipped = _turned(uv.detach(), chart, neighbours)
    flat = (doubled_area(grid) == 0) & inside
    part = components(count, shared_edges(mesh.faces))
    report = UvReport(
        atlas=examine_uv(mesh, uv, chart, size, cancel),
        faces=count,
        mirrored=int(mirrored.sum()),
        flipped=int(flipped.sum()),
        flat=int(flat.sum()),
        outside=int((~inside).sum()),
        overlapping=int(lost.sum()),
        texel_mm=texel_sizes(mesh, uv, size),
        stretch=anisotropies(mesh, uv, size),
        padding_texels=None if gap is None else gap * size[1] / shown[1],
        covered=float(winners.length.sum()) / (shown[0] * shown[1]),
        edges=edge_report(mesh.faces),
        parts=int(part.max()) + 1,
        inside_out=int((closed_volume(mesh, part) < 0).sum()),
    )
    marks = {"mirrored": mirrored, "flipped": flipped, "outside": ~inside, "flat": flat}
    return report, drawn(uv.detach(), size, chart, marks, cancel)


def _turned(
    uv: Float[Tensor, "F 3 2"], chart: Int[Tensor, " F"], neighbours: Int[Tensor, "N 2"]
) -> tuple[Tensor, Tensor]:
    """Faces that are mirrored with a good part of their chart, and folds: fewer, against its majority.

    Charts are divided where orientation changes: halves that lie on each other meet in their fold.
    """
    a, b, c = uv.double().unbind(1)
    p, q = b - a, c - a
    # v runs down: positive is clockwise on screen, which is mirrored
    area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    side = area.sign()
    alike = side[neighbours[:, 0]] == side[neighbours[:, 1]]
    piece = components(len(uv), neighbours[alike])

    def whole(values: Tensor, part: Tensor) -> Tensor:
        return values.new_zeros(int(part.max()) + 1).index_add(0, part, values)[part]

    large = whole(area.abs(), piece) >= MIRROR * whole(area.abs(), chart)
    flipped = ~large & (side * whole(area, chart) < 0)
    return (area > 0) & ~flipped, flipped


def _padding(winners: Spans, chart: Tensor, size: tuple[int, int]) -> float | None:
    """How many empty texels lie between the two charts that are closest.

    Where neighbouring texels are nearest to different charts, the two texels that they are nearest to
    face each other across the gap.
    """
    image = image_of(winners, chart, size, -1).cpu()
    if len(image[image >= 0].unique()) < 2:
        return None
    nearest = nearest_filled(image >= 0).numpy()
    row, column = np.divmod(nearest, size[1])
    label = image.numpy().reshape(-1)[nearest]
    least = np.inf
    for ahead, behind in ((np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1])):
        border = label[ahead] != label[behind]
        if not border.any():
            continue
        dy = (row[ahead] - row[behind])[border].astype(float)
        dx = (column[ahead] - column[behind])[border].astype(float)
        least = min(least, float(np.hypot(dy, dx).min()))
    # centres one texel apart touch: nothing lies between them
    return max(least - 1, 0.0)
