"""Gaussians over points in space by way of a cubic lattice, of which only nodes near the points exist."""

import math
from dataclasses import dataclass

import torch

from texsss.transport.loops import Scratch
from texsss.transport.runs import Runs, runs
from texsss.transport.ways import Ways, ways
from texsss.types import Cancel, Float, Int, Tensor, check_cancelled

AXIS = 18  # bits of a key per axis
MASK = (1 << AXIS) - 1
MARGIN = 1 << 8  # nodes around all points, more than any kernel's reach
REACH = 3.5  # standard deviations at which kernels end; their variance is right all the same
NARROWEST = 0.3  # standard deviation of the narrowest kernel, in edges


@dataclass(frozen=True, eq=False)
class Lattice:
    """Nodes around points.

    `key` (N,): of every node, ascending: x, y, z in AXIS bits each. `edge` [mm]: distance of nodes.
    `place` (N, 3) [mm]. `ways`: trilinear weights of the nodes at the points; the transpose spreads what the
    points hold over the nodes. Either adds edge²/6 to the variance of what passes.
    """

    key: Int[Tensor, " N"]
    edge: float
    place: Float[Tensor, "N 3"]
    ways: Ways

    def __len__(self) -> int:
        return len(self.key)


def lattice(points: Float[Tensor, "P 3"], edge: float, cancel: Cancel | None = None) -> Lattice:
    """The lattice of `edge` [mm] around points [mm]. Raises Cancelled."""
    low = points.amin(0)
    edge = max(edge, float((points - low).max()) / (MASK - 2 * MARGIN))
    beyond = (points - low) / edge
    cell = beyond.floor()
    beyond -= cell
    own, order = ascending(_key(*(cell.long() + MARGIN).unbind(1)))
    check_cancelled(cancel)
    fresh = torch.ones_like(own, dtype=torch.bool)
    fresh[1:] = own.diff() != 0
    cells, member = own[fresh], torch.empty(len(own), dtype=torch.int32, device=own.device)
    member[order] = fresh.cumsum(0, dtype=torch.int32) - 1
    step = torch.cartesian_prod(*[torch.arange(2, device=points.device)] * 3)
    around = _key(*step.unbind(1))
    key = cells
    for axis in (1 << 2 * AXIS, 1 << AXIS, 1):
        key = torch.unique_consecutive(ascending(torch.cat([key, key + axis]))[0])
    corner = torch.stack(
        [torch.searchsorted(key, cells + step, out_int32=True) for step in around.tolist()], 1
    )
    place = torch.stack([key >> 2 * AXIS, (key >> AXIS) & MASK, key & MASK], 1) - MARGIN
    return Lattice(key, edge, place.to(points) * edge + low, ways(member, beyond, corner, len(key)))


@dataclass(frozen=True, eq=False)
class Blur:
    """A Gaussian between the nodes of a lattice, along z, y and x in turn, which is its own transpose.

    In between there are as many nodes as it takes for no way to be missing.
    """

    along: tuple[Runs, Runs, Runs]

    def times(
        self,
        x: Float[Tensor, "N C"],
        out: Float[Tensor, "N C"] | None = None,
        scratch: Scratch | None = None,
    ) -> Float[Tensor, "N C"]:
        """`x` convolved; in `out`, if there is one."""
        first, second, last = self.along
        rows = [len(first.first), len(second.first)]
        between = (scratch or Scratch(x)).rows(sum(rows), x.shape[1]).split(rows)
        return last.times(second.times(first.times(x, between[0]), between[1]), out)


def blur(nodes: Lattice, variance: float, cancel: Cancel | None = None) -> Blur:
    """The Gaussian of `variance` [mm²] between the nodes. Raises Cancelled."""
    taps = kernel(variance / nodes.edge**2)
    reach = len(taps) // 2
    # z first, then y, and x at last; the last axis of a key is the one whose turn it is
    key = nodes.key
    after_z = _widened(key, reach)
    check_cancelled(cancel)
    before_x = _widened(ascending(_rotated(_rotated(key)))[0], reach)
    check_cancelled(cancel)
    # what is on no way from node to node along y
    after_z, before_x = ascending(_rotated(after_z))[0], ascending(_rotated(_rotated(before_x)))[0]
    check_cancelled(cancel)
    after_z, before_x = (
        after_z[_has_near(before_x, after_z, reach)],
        before_x[_has_near(after_z, before_x, reach)],
    )
    taps = taps.to(nodes.place)
    # each between keys of its own axis: rows stand in the order that the next one reads
    last = ascending(_rotated(before_x))[0]
    along = (
        runs(key, _rotated(_rotated(after_z)), taps),
        runs(after_z, _rotated(_rotated(last)), taps),
        runs(last, _rotated(_rotated(key)), taps),
    )
    return Blur(along)


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


def ascending(key: Int[Tensor, " N"]) -> tuple[Int[Tensor, " N"], Int[Tensor, " N"]]:
    """Keys in ascending order, and where each was."""
    return key.sort(stable=True)


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
