"""Texels around the charts of an atlas, each with the triangle nearest to it."""

import torch

from texsss.surface._scanline import SUBTEXELS, doubled_area
from texsss.types import Bool, Cancel, Float, Int, Tensor, check_cancelled, chunks

CHUNK_CANDIDATES = 1 << 21
RESOLUTION = 1 << 16  # steps per texel² in which distances are compared


def gutter_texels(
    grid: Int[Tensor, "F 3 2"],
    taken: Bool[Tensor, " T"],
    size: tuple[int, int],
    radius: float,
    cancel: Cancel | None = None,
) -> tuple[Int[Tensor, " G"], Int[Tensor, " G"], Float[Tensor, "G 3"], Float[Tensor, "G 3"]]:
    """Texel (row-major), face, barycentrics of the nearest point of the face and of the centre itself.

    All texels not `taken` within `radius` [texels] of some face, in row-major order. A centre
    outside every triangle is nearest to a *rim* edge, one without an opposite twin in uv, so only
    those are searched. Ties go to the first edge; faces without area come in only where no other is near.
    """
    corners, face, flat = _rims(grid)
    found = [torch.empty(0, 2, dtype=torch.int64, device=grid.device)]
    for part in _batches(corners, radius):
        check_cancelled(cancel)
        edge, texel = _candidates(corners[part], size, radius)
        free = ~taken[texel]
        edge, texel = edge[free], texel[free]
        distance = _squared_distance(corners[part], edge, texel, size)
        near = distance <= radius**2
        edge, texel, distance = edge[near] + part.start, texel[near], distance[near]
        # one integer orders by distance, then by edge: the same winner every time
        key = (distance * RESOLUTION).long() + torch.where(flat[edge], 1 << 24, 0)
        found.append(_best(torch.stack([texel, (key << 32) | edge], -1)))
    texel, key = _best(torch.cat(found)).unbind(-1)
    edge = key & 0xFFFFFFFF
    nearest, beyond = _barycentrics(grid, corners, face, edge, texel, size)
    return texel, face[edge], nearest, beyond


def _best(found: Int[Tensor, "N 2"]) -> Int[Tensor, "M 2"]:
    """The row with the least key for every texel, by texel."""
    found = found[torch.argsort(found[:, 1])]
    found = found[torch.argsort(found[:, 0], stable=True)]
    first = torch.ones(found.shape[0], dtype=torch.bool, device=found.device)
    first[1:] = found[1:, 0] != found[:-1, 0]
    return found[first]


def _rims(grid: Int[Tensor, "F 3 2"]) -> tuple[Float[Tensor, "E 2 2"], Int[Tensor, " E"], Tensor]:
    """Ends of the rim edges [texels], their faces, and whether the face has no area."""
    area = doubled_area(grid)
    turned = torch.where((area < 0)[:, None, None], grid.flip(1), grid)
    start, stop = turned, turned.roll(-1, 1)
    edges = torch.cat([start, stop], -1).reshape(-1, 4)
    face = torch.arange(grid.shape[0], device=grid.device).repeat_interleave(3)
    flat = (area == 0)[face]
    # a directed edge and its reverse belong to neighbours on both sides: not a rim
    number = _numbers(torch.cat([edges[:, :2], edges[:, 2:]]))
    count = edges.shape[0]
    code = number[:count] * number.numel() + number[count:]
    reverse = number[count:] * number.numel() + number[:count]
    sorted_code = torch.sort(code[~flat]).values
    rim = torch.ones_like(flat)
    if sorted_code.numel():
        place = torch.searchsorted(sorted_code, reverse).clamp_max(sorted_code.numel() - 1)
        rim = sorted_code[place] != reverse
    rim |= flat
    return (edges[rim].double() / SUBTEXELS).reshape(-1, 2, 2), face[rim], flat[rim]


def _numbers(points: Int[Tensor, "N 2"]) -> Int[Tensor, " N"]:
    """The same number for equal points, below N."""
    packed = (points[:, 0] << 32) + points[:, 1]
    return torch.unique(packed, return_inverse=True)[1]


def _batches(corners: Float[Tensor, "E 2 2"], radius: float) -> list[slice]:
    """Runs of edges with a bounded number of candidates."""
    box = (corners.amax(1) - corners.amin(1) + 2 * radius + 1).prod(-1)
    widest = float(box.max()) if box.numel() else 1.0
    mean = float(box.mean()) if box.numel() else 1.0
    return chunks(corners.shape[0], max(1, int(CHUNK_CANDIDATES / max(mean, widest / 64))))


def _candidates(corners, size, radius) -> tuple[Int[Tensor, " N"], Int[Tensor, " N"]]:
    """Edge (local) and texel for every centre in a band of `radius` around each edge.

    Row by row, from the run of the edge inside the row's own band, so that long diagonal edges
    don't ask for their whole box.
    """
    height, width = size
    top = corners[..., 1].amin(1) - radius - 0.5
    bottom = corners[..., 1].amax(1) + radius - 0.5
    first, last = top.ceil().long().clamp_min(0), bottom.floor().long().clamp_max(height - 1)
    edge, row = _ranges(first, last)
    ends = corners[edge]
    (ax, ay), (bx, by) = ends[:, 0].unbind(-1), ends[:, 1].unbind(-1)
    centre = row + 0.5
    rise = by - ay
    level = rise.abs() < 1e-9
    rise = torch.where(level, 1.0, rise)
    t0 = torch.where(level, 0.0, ((centre - radius - ay) / rise).clamp(0, 1))
    t1 = torch.where(level, 1.0, ((centre + radius - ay) / rise).clamp(0, 1))
    x0, x1 = ax + t0 * (bx - ax), ax + t1 * (bx - ax)
    left = (torch.minimum(x0, x1) - radius - 0.5).ceil().long().clamp_min(0)
    right = (torch.maximum(x0, x1) + radius - 0.5).floor().long().clamp_max(width - 1)
    index, x = _ranges(left, right)
    return edge[index], row[index] * width + x


def _ranges(first: Int[Tensor, " N"], last: Int[Tensor, " N"]) -> tuple[Tensor, Tensor]:
    """Index n and value for every integer first[n]..last[n]."""
    count = (last - first + 1).clamp_min(0)
    index = torch.repeat_interleave(torch.arange(first.numel(), device=first.device), count)
    before = torch.cumsum(count, 0) - count
    return index, torch.arange(index.numel(), device=first.device) - before[index] + first[index]


def _centres(texel: Int[Tensor, " N"], size: tuple[int, int]) -> Float[Tensor, "N 2"]:
    return torch.stack([texel % size[1], texel // size[1]], -1).double() + 0.5


def _along(ends: Float[Tensor, "N 2 2"], centre: Float[Tensor, "N 2"]) -> Float[Tensor, " N"]:
    """Where on each edge the point nearest to the centre lies, 0..1."""
    a, d = ends[:, 0], ends[:, 1] - ends[:, 0]
    square = (d * d).sum(-1)
    return (((centre - a) * d).sum(-1) / torch.where(square == 0, 1.0, square)).clamp(0, 1)


def _squared_distance(corners, edge, texel, size) -> Float[Tensor, " N"]:
    ends, centre = corners[edge], _centres(texel, size)
    t = _along(ends, centre)[:, None]
    return (centre - torch.lerp(ends[:, 0], ends[:, 1], t)).square().sum(-1)


def _barycentrics(grid, corners, face, edge, texel, size) -> tuple[Tensor, Tensor]:
    """Of the nearest point on the rim, and of the centre by affine continuation of the face."""
    ends, centre = corners[edge], _centres(texel, size)
    t = _along(ends, centre)
    point = torch.lerp(ends[:, 0], ends[:, 1], t[:, None])
    triangle = grid[face[edge]].double() / SUBTEXELS
    a, b, c = triangle.unbind(1)
    p, q = b - a, c - a
    det = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    sound = det != 0
    scale = torch.where(sound, 1 / torch.where(sound, det, 1.0), 0.0)

    # the rim's ends are corners of the face: their weights are exact
    def weight(end: Tensor) -> Tensor:
        same = (triangle == end[:, None]).all(-1).double()
        return same / same.sum(-1, keepdim=True)

    nearest = torch.lerp(weight(ends[:, 0]), weight(ends[:, 1]), t[:, None])
    d = centre - point
    second = (d[:, 0] * q[:, 1] - d[:, 1] * q[:, 0]) * scale
    third = (p[:, 0] * d[:, 1] - p[:, 1] * d[:, 0]) * scale
    step = torch.stack([-(second + third), second, third], -1)
    return nearest, nearest + step
