"""Gaussians over points in space by way of a cubic lattice, of which only nodes near the points exist."""

import math
from dataclasses import dataclass

import torch

from texsss.numerics.sparse import Sparse, starts
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled

AXIS = 18  # bits of a key per axis
BRICK = 3  # of them, inside of bricks
MASK = (1 << AXIS) - 1
MARGIN = 1 << 8  # nodes around all points, more than any kernel's reach
REACH = 3.5  # standard deviations at which kernels end; their variance is right all the same
NARROWEST = 0.3  # standard deviation of the narrowest kernel, in edges
WEIGHTED = 1 << 16  # points weighted at once: temporaries stay in the cache


@dataclass(frozen=True, eq=False)
class Lattice:
    """Nodes around points.

    `key` (N,): of every node: x, y, z in AXIS bits each; brick by brick. `edge` [mm]: distance of nodes.
    `place` (N, 3) [mm]. `up` (points × N): trilinear weights of the nodes at the points; its transpose
    spreads what the points hold over the nodes. Either adds edge²/6 to the variance of what passes.
    """

    key: Int[Tensor, " N"]
    edge: float
    place: Float[Tensor, "N 3"]
    up: Sparse

    def __len__(self) -> int:
        return len(self.key)


def lattice(points: Float[Tensor, "P 3"], edge: float, cancel: Cancel | None = None) -> Lattice:
    """The lattice of `edge` [mm] around points [mm]. Raises Cancelled."""
    low = points.amin(0)
    edge = max(edge, float((points - low).max()) / (MASK - 2 * MARGIN))
    cell = ((points - low) / edge).floor_().long() + MARGIN
    cells, member = torch.unique(_key(*cell.unbind(1)), return_inverse=True)
    check_cancelled(cancel)
    corner = torch.cartesian_prod(*[torch.arange(2, device=points.device)] * 3)
    around = cells[:, None] + _key(*corner.unbind(1))
    ascending = torch.unique(around)
    order = _bricks(ascending)
    key, rank = ascending[order], torch.empty_like(order)
    rank[order] = torch.arange(len(order), device=order.device)
    nodes = rank[torch.searchsorted(ascending, around)].to(torch.int32)

    column = torch.empty(len(points), 8, dtype=torch.int32, device=points.device)
    value = points.new_empty(len(points), 8)
    for part in range(0, len(points), WEIGHTED):
        rows = slice(part, part + WEIGHTED)
        column[rows] = nodes[member[rows]]
        beyond = (points[rows] - low) / edge - (cell[rows] - MARGIN)
        (x, y, z) = torch.stack([1 - beyond, beyond], 2).unbind(1)
        value[rows] = (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).flatten(1)
    start = torch.arange(0, 8 * len(points) + 1, 8, dtype=torch.int32, device=points.device)
    place = torch.stack([key >> 2 * AXIS, (key >> AXIS) & MASK, key & MASK], 1) - MARGIN
    up = Sparse(start, column.flatten(), value.flatten(), len(key))
    return Lattice(key, edge, place.to(points) * edge + low, up)


@dataclass(frozen=True, eq=False)
class Blur:
    """A Gaussian between the nodes of a lattice, along z, y and x in turn, which is its own transpose.

    In between there are as many nodes as it takes for no way to be missing.
    """

    along: tuple[Sparse, Sparse, Sparse]

    def times(self, x: Float[Tensor, "N C"]) -> Float[Tensor, "N C"]:
        """`x` convolved."""
        for matrix in self.along:
            x = matrix.times(x)
        return x


def blur(nodes: Lattice, variance: float, cancel: Cancel | None = None) -> Blur:
    """The Gaussian of `variance` [mm²] between the nodes. Raises Cancelled."""
    taps = kernel(variance / nodes.edge**2)
    reach = len(taps) // 2
    key = nodes.key
    # z first, then y, and x at last; the last axis of a key is the one whose turn it is
    after_z = _widened(key.sort()[0], reach)
    before_x = _widened(_rotated(_rotated(key)).sort()[0], reach)
    before_x = _rotated(before_x)
    # what is on no way from node to node along y
    one, other = _rotated(after_z), _rotated(before_x)
    one_sorted, other_sorted = one.sort()[0], other.sort()[0]
    after_z = after_z[_has_near(other_sorted, one, reach)]
    before_x = before_x[_has_near(one_sorted, other, reach)]
    after_z, before_x = after_z[_bricks(after_z)], before_x[_bricks(before_x)]
    along = []
    for turns, source, target in ((0, key, after_z), (1, after_z, before_x), (2, before_x, key)):
        check_cancelled(cancel)
        for _ in range(turns):
            source, target = _rotated(source), _rotated(target)
        along.append(_along(source, target, taps.to(nodes.place)))
    return Blur((along[0], along[1], along[2]))


def kernel(variance: float) -> Float[Tensor, " taps"]:
    """Weights of a Gaussian at the integers around 0, their sum 1, with `variance` as sampled and cut."""
    variance = max(variance, NARROWEST**2)
    reach = math.ceil(REACH * math.sqrt(variance))
    squared = torch.arange(-reach, reach + 1, dtype=torch.float64).square()
    low, high = -12.0, 12.0  # of the logarithm of sharpness
    for _ in range(60):
        middle = (low + high) / 2
        weight = torch.exp(-squared * math.exp(middle))
        low, high = (middle, high) if float(weight @ squared / weight.sum()) > variance else (low, middle)
    weight = torch.exp(-squared * math.exp(high))
    return weight / weight.sum()


def _key(x: Tensor, y: Tensor, z: Tensor) -> Int[Tensor, " N"]:
    return (x << AXIS | y) << AXIS | z


def _bricks(key: Int[Tensor, " N"]) -> Int[Tensor, " N"]:
    """The order in which nodes of a brick follow each other: products find neighbours in the cache."""
    inside = (1 << BRICK) - 1
    x, y, z = key >> 2 * AXIS, key >> AXIS & MASK, key & MASK
    brick = _key(x >> BRICK, y >> BRICK, z >> BRICK)
    return (brick << 3 * BRICK | ((x & inside) << BRICK | y & inside) << BRICK | z & inside).argsort()


def _rotated(key: Int[Tensor, " N"]) -> Int[Tensor, " N"]:
    """Keys whose last axis comes first: x, y, z becomes z, x, y."""
    return key >> AXIS | (key & MASK) << 2 * AXIS


def _widened(key: Int[Tensor, " N"], reach: int) -> Int[Tensor, " M"]:
    """All keys within `reach` along the last axis of ascending ones, ascending."""
    fresh = torch.cat([key.new_tensor([2 * reach + 1]), key.diff().clamp_max(2 * reach + 1)])
    first = key + reach + 1 - fresh.cumsum(0)
    return torch.repeat_interleave(first, fresh) + torch.arange(int(fresh.sum()), device=key.device)


def _has_near(ascending: Tensor, key: Tensor, reach: int) -> Tensor:
    """Whether any of the `ascending` keys is within `reach` of each key along the last axis."""
    next_one = torch.searchsorted(ascending, key - reach).clamp_max(len(ascending) - 1)
    return (ascending[next_one] - key).abs() <= reach


def _along(source: Tensor, target: Tensor, taps: Float[Tensor, " taps"]) -> Sparse:
    """The convolution with `taps` from source to target nodes along the last axis of their keys."""
    reach = len(taps) // 2
    ascending, order = source.sort()
    first = torch.searchsorted(ascending, target - reach)
    count = torch.searchsorted(ascending, target + reach, right=True) - first
    start = starts(count)
    at = torch.repeat_interleave(first - start[:-1], count)
    at += torch.arange(len(at), device=at.device)
    tap = ascending[at] - torch.repeat_interleave(target - reach, count)
    return Sparse(start, order[at].to(torch.int32), taps[tap], len(source))
