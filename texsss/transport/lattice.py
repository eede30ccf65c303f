"""Gaussians over points in space by way of a cubic lattice, of which only nodes near the points exist."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import UInt8

from texsss.numerics.sparse import starts
from texsss.transport.bricks import NODES, SIDE, Blur, Bricks, blur_of
from texsss.transport.keys import MASK, ascending, axes_of, key_of
from texsss.transport.stencil import AROUND, MIDDLE, kind_of, kinds
from texsss.transport.ways import Ways, ways
from texsss.types import Bool, Cancel, Float, Int, Tensor, check_cancelled

MARGIN = 1 << 8  # nodes around all points, more than any kernel's reach
REACH = 3.5  # standard deviations at which kernels end; their variance is right all the same
NARROWEST = 0.3  # standard deviation of the narrowest kernel, in edges


@dataclass(frozen=True, eq=False)
class Lattice:
    """Nodes around points.

    `bricks`: which nodes there are, in their order. `edge` [mm]: distance of nodes. `place` (N, 3) [mm].
    `ways`: weights of the nodes at the points; the transpose spreads what the points hold over the nodes.
    Either adds VARIANCE edge² to the variance of what passes.
    """

    bricks: Bricks
    edge: float
    place: Float[Tensor, "N 3"]
    ways: Ways

    def __len__(self) -> int:
        return len(self.place)


def lattice(points: Float[Tensor, "P 3"], edge: float, cancel: Cancel | None = None) -> Lattice:
    """The lattice of `edge` [mm] around points [mm]. Raises Cancelled."""
    low = points.amin(0)
    edge = max(edge, float((points - low).max()) / (MASK - 2 * MARGIN))
    beyond = (points - low) / edge
    cell = (beyond + 0.5).floor()
    beyond -= cell
    own, order = ascending(key_of(*(cell.long() + MARGIN).unbind(1)))
    check_cancelled(cancel)
    fresh = torch.ones_like(own, dtype=torch.bool)
    fresh[1:] = own.diff() != 0
    cells, member = own[fresh], torch.empty(len(own), dtype=torch.int32, device=own.device)
    member[order] = fresh.cumsum(0, dtype=torch.int32) - 1
    kind = kind_of(beyond)
    used = _used(member, kind, len(cells))
    step = key_of(*(torch.tensor(AROUND, device=points.device) + 1).unbind(1))
    asked = [cells[used[:, k]] + along for k, along in enumerate((step - step[MIDDLE]).tolist())]
    key = torch.unique_consecutive(ascending(torch.cat(asked))[0])
    check_cancelled(cancel)
    found = [torch.searchsorted(key, part, out_int32=True) for part in asked]
    near = found[MIDDLE][:, None].repeat(1, len(AROUND))
    for k, part in enumerate(found):
        near[used[:, k], k] = part
    # brick by brick
    own, order = ascending(_by_bricks(axes_of(key)))
    number = torch.empty_like(order, dtype=torch.int32)
    number[order] = torch.arange(len(order), dtype=torch.int32, device=order.device)
    brick, count = torch.unique_consecutive(own // NODES, return_counts=True)
    bricks = Bricks(brick, starts(count), (own % NODES).to(torch.int8))
    place = (axes_of(key[order]) - MARGIN).to(points) * edge + low
    return Lattice(bricks, edge, place, ways(member, beyond.T, kind, number[near.long()], len(key)))


def blur(nodes: Lattice, variance: float, cancel: Cancel | None = None) -> Blur:
    """The Gaussian of `variance` [mm²] between the nodes. Raises Cancelled."""
    return blur_of(nodes.bricks, kernel(variance / nodes.edge**2).to(nodes.place), cancel)


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


def _used(cell: Int[Tensor, " P"], kind: UInt8[Tensor, " P"], cells: int) -> Bool[Tensor, "cells 19"]:
    """Which of the nodes around each cell its points ask for."""
    of_kind = torch.zeros(len(kinds()), len(AROUND), device=cell.device)
    of_kind.scatter_(1, kinds().long().to(cell.device), 1.0)
    met = torch.zeros(cells * len(of_kind), device=cell.device)
    met[cell.long() * len(of_kind) + kind] = 1
    return met.view(cells, -1) @ of_kind > 0


def _by_bricks(axes: Int[Tensor, "N 3"]) -> Int[Tensor, " N"]:
    """Keys of nodes: that of their brick, then their place within."""
    z, y, x = (axes % SIDE).unbind(1)[::-1]
    return key_of(*(axes // SIDE).unbind(1)) * NODES + ((z * SIDE + y) * SIDE + x)
