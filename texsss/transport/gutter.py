"""What the surface's texels hold, carried to the gutter: it has no area, so it only ever receives."""

import torch
from scipy.spatial import KDTree

from texsss.numerics.sparse import Sparse, starts
from texsss.types import Cancel, Float, Tensor, check_cancelled

AROUND = 8  # texels of the surface that a gutter texel's value is made of
WIDTH = 0.5  # of their distances' root mean square: standard deviation of their weights
TAME = 1e-3  # relative; keeps the slope of points on a line or in a plane finite
STEEPEST = 1.5  # weights may be turned round, up to half their own size
FARTHEST = 0.5  # of all weight may be cancelled: beyond the surface's edge a slope runs on but a little
LEAST = 1e-30


def gutter_means(
    surface: Float[Tensor, "L 3"], gutter: Float[Tensor, "G 3"], cancel: Cancel | None = None
) -> Sparse:
    """The matrix (G, L) that gives every point of the gutter the value of the surface at its place.

    A moving least-squares fit of a linear function through the nearest points, so that what varies
    linearly stays; where that would extrapolate far (the gutter of an open edge), nearly a mean of them.
    Rows sum to 1. Raises Cancelled. Source: Lancaster & Salkauskas 1981.
    """
    count = min(AROUND, len(surface))
    if not len(gutter) or not count:
        empty = surface.new_zeros(0)
        return Sparse(starts(torch.zeros(len(gutter), dtype=torch.int64)), empty.int(), empty, len(surface))
    tree = KDTree(surface.cpu().double().numpy(), balanced_tree=False, compact_nodes=False)
    check_cancelled(cancel)
    near = torch.from_numpy(tree.query(gutter.cpu().double().numpy(), k=count, workers=-1)[1])
    near = near.to(surface.device).reshape(-1, count)
    check_cancelled(cancel)
    offset = surface[near] - gutter[:, None]
    squared = offset.square().sum(-1)
    weight = torch.exp(-0.5 * squared / (WIDTH**2 * squared.mean(1, keepdim=True)).clamp_min(LEAST))
    weight = weight + LEAST
    first = (weight[..., None] * offset).sum(1)
    second = torch.einsum("gn,gni,gnj->gij", weight, offset, offset)
    trace = second.diagonal(dim1=1, dim2=2).sum(1).clamp_min(LEAST)
    second = second + (TAME * trace)[:, None, None] * torch.eye(3, dtype=second.dtype, device=second.device)
    slope = torch.linalg.solve(second, first)
    along = (offset * slope[:, None]).sum(-1)
    whole, lost = weight.sum(1), (weight * along).sum(1)
    bound = torch.minimum(STEEPEST / along.amax(1).clamp_min(LEAST), FARTHEST * whole / lost.clamp_min(LEAST))
    weight = weight * (1 - bound.clamp_max(1)[:, None] * along)
    weight = weight / weight.sum(1, keepdim=True)
    start = starts(torch.full((len(gutter),), count))
    return Sparse(start, near.int().flatten(), weight.flatten(), len(surface))
