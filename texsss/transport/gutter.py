"""What the surface's texels hold, carried to the gutter: it has no area, so it only ever receives."""

from collections.abc import Sequence

import scipy  # its parts are loaded where they are first used
import torch

from texsss.numerics.sparse import Sparse, starts
from texsss.transport.loops import addresses, call, products
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled, chunks

AROUND = 8  # texels of the surface that a gutter texel's value is made of
LOOKED_AT = 16  # nearest ones that these are chosen from: in thin parts half of them face away
WIDTH = 0.5  # of their distances' root mean square: standard deviation of their weights
AWAY = 0.5  # cosine between normals, turned, from which a point is on the other side
TAME = 1e-3  # relative; keeps the slope of points on a line or in a plane finite
STEEPEST = 1.5  # weights may be turned round, up to half their own size
FARTHEST = 0.5  # of all weight may be cancelled: beyond the surface's edge a slope runs on but a little
LEAST = 1e-30
CHUNK = 1 << 16  # points of the gutter at once
ENTRY_BYTES = 8

BYTES = AROUND * ENTRY_BYTES
"""What each point of the gutter takes."""


def gutter_means(
    place: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], covered: int, cancel: Cancel | None = None
) -> Sparse:
    """The matrix (P - L, L) that gives the gutter the value of the surface at its place; `covered`: L.

    The surface's points come first. A moving least-squares fit of a linear function through the nearest
    points that face the same way, so that what varies linearly stays; where that would extrapolate far (the
    gutter of an open edge), nearly a mean of them. Rows sum to 1. Raises Cancelled.
    Source: Lancaster & Salkauskas 1981.
    """
    surface, gutter = place[:covered], place[covered:]
    looked, count = min(LOOKED_AT, covered), min(AROUND, covered)
    columns, values = [surface.new_zeros(0, count, dtype=torch.int32)], [surface.new_zeros(0, count)]
    tree = scipy.spatial.KDTree(surface.cpu().double().numpy(), balanced_tree=False, compact_nodes=False)
    for rows in chunks(len(gutter), CHUNK):
        check_cancelled(cancel)
        near = tree.query(gutter[rows].cpu().double().numpy(), k=looked, workers=-1)[1]
        near = torch.from_numpy(near).to(surface.device).reshape(-1, looked)
        offset = surface[near] - gutter[rows, None]
        facing = (normal[covered:][rows, None] * normal[near]).sum(-1)
        column, value = _weights(near, offset, facing, count)
        columns.append(column)
        values.append(value)
    start = starts(torch.full((len(gutter),), count))
    return Sparse(start, torch.cat(columns).flatten(), torch.cat(values).flatten(), covered)


def fill_gutter(means: Sparse, copies: Sequence[Float[Tensor, "P C"]]) -> None:
    """Puts into the gutter, the last rows of each of `copies`, what `means` makes of the others.

    All of them contiguous.
    """
    covered = means.columns
    found = products(means.value, *copies) if copies else None
    if found is None:
        for copy in copies:
            copy[covered:] = means.times(copy[:covered])
        return
    args = means.rows, means.start, means.column, means.value, covered
    call(found.gutter_times, *args, addresses(copies), len(copies), copies[0].shape[1])


def with_rim(parts: Sequence[Float[Tensor, "P C"]], rim: Sparse | None) -> list[Float[Tensor, "L C"]]:
    """The surface's rows of each part, and what `rim`, the transpose of the means, makes of the gutter's."""
    if rim is None:
        return list(parts)
    return [part[: rim.rows] + rim.times(part[rim.rows :]) for part in parts]


def entries(rim: Sparse | None) -> tuple[Tensor | None, Tensor | None, Tensor | None]:
    """What loops take of it."""
    return (None, None, None) if rim is None else (rim.start, rim.column, rim.value)


def _weights(
    near: Int[Tensor, "G M"], offset: Float[Tensor, "G M 3"], facing: Float[Tensor, "G M"], count: int
) -> tuple[Int[Tensor, "G N"], Float[Tensor, "G N"]]:
    """Which of the points `near` count, and how much. `facing`: cosine between normals."""
    squared = offset.square().sum(-1)
    width = WIDTH**2 * squared[:, :count].mean(1, keepdim=True)
    weight = torch.exp(-0.5 * squared / width.clamp_min(LEAST)) * (1 + facing / AWAY).clamp(0, 1)
    weight, best = (weight + LEAST).topk(count, dim=1)
    offset = offset.gather(1, best[..., None].expand(-1, -1, 3))
    first = (weight[..., None] * offset).sum(1)
    second = torch.einsum("gn,gni,gnj->gij", weight, offset, offset)
    trace = second.diagonal(dim1=1, dim2=2).sum(1).clamp_min(LEAST)
    second = second + (TAME * trace)[:, None, None] * torch.eye(3, dtype=second.dtype, device=second.device)
    along = (offset * torch.linalg.solve(second, first)[:, None]).sum(-1)
    whole, lost = weight.sum(1), (weight * along).sum(1)
    bound = torch.minimum(STEEPEST / along.amax(1).clamp_min(LEAST), FARTHEST * whole / lost.clamp_min(LEAST))
    weight = weight * (1 - bound.clamp_max(1)[:, None] * along)
    return near.gather(1, best).int(), weight / weight.sum(1, keepdim=True)
