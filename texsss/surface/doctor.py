"""The UV doctor: everything that can be wrong with texture coordinates and topology, measured."""

from dataclasses import dataclass

import numpy as np
import torch

from texsss.surface._scanline import Spans, disjoint, doubled_area, filled, spans
from texsss.surface.atlas import MARGIN, AtlasReport, examine_uv
from texsss.surface.dilate import nearest_filled
from texsss.surface.mesh import Mesh
from texsss.surface.metric import Spread, anisotropies, texel_sizes
from texsss.surface.raster import looked_at, snapped
from texsss.surface.topology import Edges, charts, closed_volume, components, edge_report, shared_edges
from texsss.types import Cancel, Float, Int, Tensor

COLOURS = {
    "empty": (0.10, 0.10, 0.11),
    "sound": (0.55, 0.60, 0.62),
    "mirrored": (0.35, 0.55, 0.80),
    "flipped": (0.95, 0.75, 0.20),
    "overlap": (0.90, 0.20, 0.18),
    "seam": (0.95, 0.95, 0.95),
}


@dataclass(frozen=True)
class UvReport:
    """What the doctor found; faces are counted, shares are of the surface's area in 0..1.

    `atlas`: whether the coordinates could store light, and why not. `mirrored`: faces in charts that lie
    mirrored as a whole, which is fine. `flipped`: faces turned against the rest of their chart: folds.
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

    The picture, display-encoded in 0..1, shows empty texels dark, sound ones grey, mirrored charts blue,
    flipped faces yellow, overlaps red and the borders of charts white. It has that size, or less where faces
    cover the square many times over. Raises Cancelled.
    """
    chart = charts(mesh.faces, uv)
    inside = ((uv >= -MARGIN) & (uv <= 1 + MARGIN)).all(-1).all(-1)
    placed = torch.where(inside[:, None, None], uv.detach(), torch.zeros_like(uv)).clamp(0, 1)
    shown = looked_at(placed, size)
    grid = snapped(placed, shown)
    claims = spans(grid, shown, cancel)
    winners = disjoint(claims, cancel)
    count = len(mesh.faces)
    lost = claims.texels_per_face(count) > winners.texels_per_face(count)
    gap = _padding(winners, chart, shown)
    mirrored, flipped = _turned(mesh, uv.detach(), chart)
    part = components(count, shared_edges(mesh.faces))
    report = UvReport(
        atlas=examine_uv(mesh, uv, chart, size, cancel),
        faces=count,
        mirrored=int(mirrored.sum()),
        flipped=int(flipped.sum()),
        flat=int(((doubled_area(grid) == 0) & inside).sum()),
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
    return report, _picture(claims, winners, chart, mirrored, flipped, shown)


def _turned(mesh: Mesh, uv: Tensor, chart: Tensor) -> tuple[Tensor, Tensor]:
    """Faces of charts that are mirrored, and faces against their chart's majority by uv area."""
    a, b, c = uv.double().unbind(1)
    p, q = b - a, c - a
    # v runs down: positive is clockwise on screen, which is mirrored
    area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    total = torch.zeros(int(chart.max()) + 1, dtype=area.dtype, device=area.device).index_add(0, chart, area)
    mirrored_chart = (total > 0)[chart]
    flipped = torch.where(mirrored_chart, area < 0, area > 0)
    return mirrored_chart & ~flipped, flipped


def _image_of(texels: Spans, values: Tensor, size: tuple[int, int], empty: int) -> Int[Tensor, "H W"]:
    """`values` of the faces at their texels, `empty` elsewhere."""
    number, texel = texels.expanded()
    image = torch.full((size[0] * size[1],), empty, dtype=torch.int64, device=values.device)
    image[texel] = values.long()[texels.face[number]]
    return image.reshape(size)


def _padding(winners: Spans, chart: Tensor, size: tuple[int, int]) -> float | None:
    """How many empty texels lie between the two charts that are closest.

    Where neighbouring texels are nearest to different charts, the two texels that they are nearest to
    face each other across the gap.
    """
    image = _image_of(winners, chart, size, -1).cpu()
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


def _picture(
    claims: Spans, winners: Spans, chart: Tensor, mirrored: Tensor, flipped: Tensor, size: tuple[int, int]
) -> Float[Tensor, "H W 3"]:
    names = list(COLOURS)
    kind = torch.full_like(chart, names.index("sound"))
    kind[mirrored] = names.index("mirrored")
    kind[flipped] = names.index("flipped")
    image = _image_of(winners, kind, size, names.index("empty"))
    texel = claims.expanded()[1]
    image.reshape(-1)[torch.bincount(texel, minlength=image.numel()) > 1] = names.index("overlap")
    label = _image_of(winners, chart, size, -1)
    seam = torch.zeros_like(label, dtype=torch.bool)
    seam[1:] |= label[1:] != label[:-1]
    seam[:, 1:] |= label[:, 1:] != label[:, :-1]
    covered = filled(winners, size).reshape(size)
    image[seam & covered & (image != names.index("overlap"))] = names.index("seam")
    return torch.tensor(list(COLOURS.values()), device=image.device)[image]
