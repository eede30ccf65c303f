"""Texture coordinates drawn: what overlaps, is folded, leaves the square or has no area, and where."""

import torch

from texsss.surface._scanline import Spans, disjoint, filled, spans
from texsss.surface.raster import looked_at, snapped
from texsss.types import Bool, Cancel, Float, Int, Tensor

COLOURS = {
    "empty": (0.10, 0.10, 0.11),
    "sound": (0.55, 0.60, 0.62),
    "mirrored": (0.35, 0.55, 0.80),
    "flipped": (0.95, 0.75, 0.20),
    "outside": (0.62, 0.45, 0.72),
    "overlap": (0.90, 0.20, 0.18),
    "flat": (0.20, 0.85, 0.45),
    "seam": (0.95, 0.95, 0.95),
}
FARTHEST = 8  # squares to every side that are shown
MARGIN = 1e-4  # of the square that exporters round by


def drawn(
    uv: Float[Tensor, "F 3 2"],
    size: tuple[int, int],
    chart: Int[Tensor, " F"],
    marks: dict[str, Bool[Tensor, " F"]],
    cancel: Cancel | None = None,
) -> Float[Tensor, "h w 3"]:
    """Faces in the colours of their `marks`, sound ones grey; display-encoded in 0..1.

    `marks`: by names of `COLOURS`, the later the more telling; faces that are `flat` are dots at corners and
    middle. Shows the unit square at `size` (H, W) or, shrunk to that, what is up to eight squares away, too;
    then the unit square has a border. Coarser where faces lie on each other many times over.
    """
    names = list(COLOURS)
    kind = torch.full_like(chart, names.index("sound"))
    for name, mark in marks.items():
        kind[mark] = names.index(name)
    within = ((uv >= -FARTHEST) & (uv <= 1 + FARTHEST)).flatten(1).all(1)
    corners = torch.cat([uv[within].reshape(-1, 2), uv.new_tensor([[0.0, 0.0], [1.0, 1.0]])])
    low, high = corners.amin(0), corners.amax(0)
    low, high = torch.where(low < -MARGIN, low, 0.0), torch.where(high > 1 + MARGIN, high, 1.0)
    extent = high - low
    across, down = (extent / extent.max()).tolist()
    placed = torch.where(within[:, None, None], (uv - low) / extent, torch.zeros_like(uv)).clamp(0, 1)
    shown = looked_at(placed, (max(round(size[0] * down), 1), max(round(size[1] * across), 1)))
    claims = spans(snapped(placed, shown), shown, cancel)
    winners = disjoint(claims, cancel)
    image = image_of(winners, kind, shown, names.index("empty"))
    twice = torch.bincount(claims.expanded()[1], minlength=image.numel()).reshape(shown) > 1
    image[twice] = names.index("overlap")
    label = image_of(winners, chart, shown, -1)
    seam = torch.zeros_like(twice)
    seam[1:] |= label[1:] != label[:-1]
    seam[:, 1:] |= label[:, 1:] != label[:, :-1]
    image[seam & filled(winners, shown).reshape(shown) & ~twice] = names.index("seam")
    _dots(image, placed[marks["flat"] & within], names.index("flat"))
    if bool((extent > 1).any()):
        corner = torch.stack([-low, 1 - low]) / extent * extent.new_tensor([shown[1], shown[0]])
        (left, top), (right, bottom) = corner.round().long().tolist()
        square = torch.zeros_like(twice)
        square[top:bottom, left:right] = True
        square[top + 1 : bottom - 1, left + 1 : right - 1] = False
        image[square] = names.index("seam")
    return torch.tensor(list(COLOURS.values()), device=image.device)[image]


def image_of(texels: Spans, values: Tensor, size: tuple[int, int], empty: int) -> Int[Tensor, "H W"]:
    """`values` of the faces at their texels, `empty` elsewhere."""
    number, texel = texels.expanded()
    image = torch.full((size[0] * size[1],), empty, dtype=torch.int64, device=values.device)
    image[texel] = values.long()[texels.face[number]]
    return image.reshape(size)


def _dots(image: Int[Tensor, "H W"], uv: Float[Tensor, "F 3 2"], kind: int) -> None:
    """Marks corners and middles of faces, three texels wide, in `image`."""
    height, width = image.shape
    at = torch.cat([uv, uv.mean(1, keepdim=True)], 1).reshape(-1, 2)
    x, y = (at * at.new_tensor([width, height])).long().unbind(1)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            image[(y + dy).clamp(0, height - 1), (x + dx).clamp(0, width - 1)] = kind
