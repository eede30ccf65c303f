"""Spans of texels under triangles, row by row, from exact integer edge functions.

Work is proportional to rows and covered texels, not to bounding boxes; nothing loops over faces.
"""

from dataclasses import dataclass

import torch

from texsss.types import Bool, Cancel, Float, Int, Tensor, check_cancelled

SUBTEXELS = 1 << 16  # snapping moves a corner by at most 2⁻¹⁷ texel: less than float32 uv resolve
CHUNK_FACES = 1 << 17
CHUNK_ROWS = 1 << 21  # of triangles, tested at once: many tall slivers have far more than texels
CHUNK_TEXELS = 1 << 21  # contested texels sorted at once: bounds the peak, not the speed


@dataclass(frozen=True, eq=False)
class Spans:
    """Runs of texels: `face`, `start` (row-major index of the first texel) and `length`, each (R,) int64."""

    face: Int[Tensor, " R"]
    start: Int[Tensor, " R"]
    length: Int[Tensor, " R"]

    def __len__(self) -> int:
        return self.face.shape[0]

    def __getitem__(self, rows: Tensor | slice) -> "Spans":
        return Spans(self.face[rows], self.start[rows], self.length[rows])

    def texels_per_face(self, faces: int) -> Float[Tensor, " F"]:
        """How many texels each face has. float64."""
        # .double() again: without any spans bincount forgets its weights' type
        return torch.bincount(self.face, weights=self.length.double(), minlength=faces).double()

    def expanded(self) -> tuple[Int[Tensor, " N"], Int[Tensor, " N"]]:
        """Number of the span and texel, for every texel of every span in order."""
        number = torch.repeat_interleave(torch.arange(len(self), device=self.face.device), self.length)
        shift = self.start - (torch.cumsum(self.length, 0) - self.length)
        return number, torch.arange(number.numel(), device=number.device).add_(shift.index_select(0, number))


def spans(grid: Int[Tensor, "F 3 2"], size: tuple[int, int], cancel: Cancel | None = None) -> Spans:
    """Every triangle's texels, sorted by first texel, then by face; they overlap where triangles do.

    `grid` holds corners (x, y) on the grid of 1/SUBTEXELS. A centre in a triangle belongs to it; of the
    triangles that meet in an edge the one right of or below it owns centres on the edge.
    """
    parts = []
    for part in _chunks(grid, size):
        check_cancelled(cancel)
        corners = grid[part]
        face, row = _rows(corners, size)
        first, stop = _row_spans(corners, face, row, size)
        used = stop > first
        face, row, first, stop = face[used], row[used], first[used], stop[used]
        parts.append(Spans(face + part.start, row * size[1] + first, stop - first))
    return _sorted(parts)


def _chunks(grid: Int[Tensor, "F 3 2"], size: tuple[int, int]) -> list[slice]:
    """Faces in order, in parts of at most CHUNK_FACES and of about CHUNK_ROWS rows."""
    if grid.shape[0] * size[0] <= CHUNK_ROWS:
        return [slice(0, grid.shape[0])]
    y = grid[..., 1]
    tall = ((y.amax(1) - y.amin(1)) // SUBTEXELS).clamp_max(size[0])
    number = tall.cumsum(0) // CHUNK_ROWS
    number = number + torch.arange(len(number), device=number.device) // CHUNK_FACES
    ends = torch.unique_consecutive(number, return_counts=True)[1].cumsum(0).tolist()
    return [slice(low, high) for low, high in zip([0, *ends[:-1]], ends)]


def disjoint(claims: Spans, cancel: Cancel | None = None) -> Spans:
    """`claims` without overlaps: the lowest face keeps a contested texel. Sorted by first texel."""
    stop = torch.cummax(claims.start + claims.length, 0).values if len(claims) else claims.start
    joins = torch.zeros_like(stop, dtype=torch.bool)
    joins[1:] = claims.start[1:] < stop[:-1]
    if not bool(joins.any()):
        return claims
    group = torch.cumsum(~joins, 0) - 1
    contested = torch.bincount(group)[group] > 1
    settled = [claims[~contested]]
    for part in _groups(claims[contested], group[contested]):
        check_cancelled(cancel)
        part = part[torch.argsort(part.face, stable=True)]
        number, texel = part.expanded()
        texel, order = torch.sort(texel, stable=True)
        winner = torch.ones_like(texel, dtype=torch.bool)
        winner[1:] = texel[1:] != texel[:-1]
        texel, face = texel[winner], part.face[number[order[winner]]]
        settled.append(Spans(face, texel, torch.ones_like(texel)))
    return _sorted(settled)


def _sorted(parts: list[Spans]) -> Spans:
    """All spans by first texel, in the order given where that is the same."""
    start, order = torch.sort(torch.cat([part.start for part in parts]), stable=True)
    face = torch.cat([part.face for part in parts]).index_select(0, order)
    return Spans(face, start, torch.cat([part.length for part in parts]).index_select(0, order))


def _groups(claims: Spans, group: Int[Tensor, " R"]) -> list[Spans]:
    """Overlapping spans in parts of about CHUNK_TEXELS; no group is split."""
    total = torch.cumsum(claims.length, 0) // CHUNK_TEXELS
    last = torch.ones_like(group, dtype=torch.bool)
    last[:-1] = group[1:] != group[:-1]
    fresh = torch.nonzero(last)[:, 0]
    cut = torch.ones_like(fresh, dtype=torch.bool)
    cut[:-1] = total[fresh[1:]] != total[fresh[:-1]]
    ends = (fresh[cut] + 1).tolist()
    return [claims[slice(low, high)] for low, high in zip([0, *ends[:-1]], ends)]


def _rows(corners: Int[Tensor, "F 3 2"], size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Face (local) and row index for every row of centres that a triangle's height spans."""
    half = SUBTEXELS // 2
    y = corners[..., 1]
    # centres at (i + ½)·SUBTEXELS: the first at or below the top, the last at or above the bottom
    first = ((y.amin(1) - half) + SUBTEXELS - 1) // SUBTEXELS
    last = (y.amax(1) - half) // SUBTEXELS
    first, last = first.clamp_min(0), last.clamp_max(size[0] - 1)
    count = (last - first + 1).clamp_min(0)
    count = torch.where(doubled_area(corners) == 0, 0, count)
    face = torch.repeat_interleave(torch.arange(corners.shape[0], device=corners.device), count)
    before = torch.cumsum(count, 0) - count
    row = torch.arange(face.numel(), device=corners.device) + (first - before)[face]
    return face, row


def _row_spans(
    corners: Int[Tensor, "F 3 2"], face: Int[Tensor, " R"], row: Int[Tensor, " R"], size: tuple[int, int]
) -> tuple[Tensor, Tensor]:
    """Column of the first texel and one past the last of every row, from three exact inequalities.

    Edge p → q of a triangle with positive area holds a centre c if
    E(c) = (q−p) × (c−p) > 0, or = 0 on a top or left edge. With c = (x + ½)·SUBTEXELS along a row
    this reads slope·x + rest ≥ 0 for integers, solved for x by a floor division.
    """
    positive = doubled_area(corners) > 0
    corners = torch.where(positive[:, None, None], corners, corners.flip(1))
    half = SUBTEXELS // 2
    centre = row * SUBTEXELS + half
    start = torch.zeros_like(face)
    stop = torch.full_like(face, size[1])
    for edge in range(3):
        p, q = corners[:, edge], corners[:, (edge + 1) % 3]
        dx, dy = (q - p).unbind(-1)
        # v down: of a triangle with positive area, edges going up lie left, level ones going right on top
        closed = (dy < 0) | ((dy == 0) & (dx > 0))
        # E = dx·(cy − py) − dy·(cx − px), with cx = x·SUBTEXELS + half
        constant = -dx * p[:, 1] - dy * (half - p[:, 0]) - torch.where(closed, 0, 1)
        slope = (-dy * SUBTEXELS)[face]
        rest = dx[face] * centre + constant[face]
        bound = torch.div(rest, slope.abs().clamp_min(1), rounding_mode="floor")
        # slope > 0: x ≥ −floor(rest/slope);  slope < 0: x ≤ floor(rest/|slope|)
        start = torch.where(slope > 0, torch.maximum(start, -bound), start)
        stop = torch.where(slope < 0, torch.minimum(stop, bound + 1), stop)
        stop = torch.where((slope == 0) & (rest < 0), 0, stop)
    return start, stop


def doubled_area(corners: Int[Tensor, "F 3 2"]) -> Int[Tensor, " F"]:
    """Signed, in units of the grid, exactly; positive when the corners turn clockwise on screen (v down)."""
    a, b, c = corners.unbind(1)
    p, q = b - a, c - a
    return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]


def barycentric_steps(corners: Int[Tensor, "F 3 2"]) -> tuple[Float[Tensor, "F 2"], Float[Tensor, "F 2"]]:
    """∂/∂x and ∂/∂y of the first two barycentrics [1/texel]; 0 for triangles without area."""
    a, b, c = (corners.double() / SUBTEXELS).unbind(1)
    area = doubled_area(corners)
    scale = torch.where(area == 0, 0.0, SUBTEXELS**2 / torch.where(area == 0, 1, area).double())[:, None]
    dx = torch.stack([(b - c)[:, 1], (c - a)[:, 1]], -1) * scale
    dy = torch.stack([(c - b)[:, 0], (a - c)[:, 0]], -1) * scale
    return dx, dy


def filled(taken: Spans, size: tuple[int, int]) -> Bool[Tensor, " T"]:
    """Which texels of the square lie in some span of `taken`, which are disjoint."""
    change = torch.zeros(size[0] * size[1] + 1, dtype=torch.int8, device=taken.face.device)
    one = torch.ones_like(taken.start, dtype=torch.int8)
    # +1 at a start, −1 past an end; where a span begins at another's end they cancel
    change.index_add_(0, taken.start, one).index_add_(0, taken.start + taken.length, -one)
    return torch.cumsum(change[:-1], 0, dtype=torch.int8) > 0
