"""The hierarchical sum of Gaussians: blocks of receivers against nodes, level by level.

Which nodes serve is decided for a block of receivers at a time, by those of them that are nearest;
what then remains are products of small dense matrices, one per block and Gaussian, over the nodes
within that Gaussian's reach.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from texsss.errors import DomainError, ShapeError
from texsss.transport.octree.blocks import blocks
from texsss.transport.octree.sources import Sources
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks

BLOCK = 256  # receivers in a block, at most
BLOCKS = 256  # blocks whose nodes are looked for at once
REACH = 4.2  # standard deviations beyond which a Gaussian is not summed: 1.5e-4 of its light
FAINT = -60.0  # exponents end here: denormal numbers are slow
Finish = Callable[[Int[Tensor, " b"], Float[Tensor, "K Q b"]], Float[Tensor, "b C"]]
"""Receivers by their number, and Σ G × moments of each Gaussian there, to what is kept of them."""


@dataclass(frozen=True, eq=False)
class _Lists:
    """Candidates of some blocks, block by block, the nearest first.

    `candidate` (L,); `begin` (B,): where each block's start; `within` (K, B): how many are in each
    Gaussian's reach.
    """

    candidate: Int[Tensor, " L"]
    begin: list[int]
    within: list[list[int]]


def integrated(
    sent: Sources,
    receivers: Float[Tensor, "P 3"],
    variances: Float[Tensor, " K"],
    finish: Finish,
    *,
    epsilon: float,
    widened: bool = True,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "P C"]:
    """What `finish` makes of Σ_p G(v_k, ‖x - P‖) m_p at every receiver x [mm], gathered over an octree.

    A node of area A serves those it does not hold, at a distance d from all of them with A / d² <
    `epsilon`; else its children do; leaves sum their samples. `variances` > 0, ascending [mm²].
    `widened`: a node's Gaussians are as much wider as what it stands for is spread, which is what
    makes a wider Gaussian from narrower ones.
    Raises DomainError: when epsilon is not above 0; Cancelled.
    Source: Jensen & Buhler 2002; Mayorga 2008, section 4.3.
    """
    if not (epsilon > 0 and math.isfinite(epsilon)):
        raise DomainError(f"octree: expected epsilon > 0, got {epsilon:g}; .05 errs by less than 1 %.")
    if not len(receivers):
        raise ShapeError("octree: expected receivers of light, got none; check the atlas or the camera.")
    groups = blocks(receivers.to(sent.position), BLOCK)
    reach = REACH * variances.sqrt()
    result: Tensor | None = None
    parts = chunks(len(groups.member), BLOCKS)
    for part in parts:
        lists = _candidates(sent, groups.centre[part], groups.radius[part], reach, epsilon)
        for b, rows in enumerate(groups.member[part]):
            check_cancelled(cancel)
            within = [counts[b] for counts in lists.within]
            some = lists.candidate[lists.begin[b] : lists.begin[b] + within[-1]]
            middle = groups.centre[part.start + b]
            x = receivers[rows].to(middle) - middle
            kept = finish(rows, _summed(sent, some, within, x, middle, variances, widened))
            if result is None:
                result = kept.new_empty(len(receivers), *kept.shape[1:])
            result[rows] = kept
        if progress is not None:
            progress("octree", part.stop / parts[-1].stop)
    assert result is not None, "there is at least one block"
    return result


def _summed(
    sent: Sources,
    some: Int[Tensor, " L"],
    within: list[int],
    x: Float[Tensor, "b 3"],
    middle: Float[Tensor, "3"],
    variances: Float[Tensor, " K"],
    widened: bool,
) -> Float[Tensor, "K Q b"]:
    """Σ G × moments over the candidates at the receivers of one block, whose centre is `middle`."""
    p = sent.position.index_select(0, some) - middle
    near = p.square().sum(1, keepdim=True) + x.square().sum(1)
    squared = torch.addmm(near, p, x.T, alpha=-2).clamp_min_(0)
    variance = variances[:, None].expand(-1, len(some))
    if widened:
        variance = variance + sent.spread.index_select(0, some)
    # one product per node instead of one per pair
    weighted = sent.moments.index_select(1, some) / (2 * math.pi * variance)[:, :, None]
    weighted, slope = weighted.transpose(1, 2), (-0.5 / variance)[:, :, None]
    sums = x.new_empty(len(within), weighted.shape[1], len(x))
    for k, count in enumerate(within):
        kernel = (squared[:count] * slope[k, :count]).clamp_min_(FAINT).exp_()
        torch.mm(weighted[k, :, :count], kernel, out=sums[k])
    return sums


def _candidates(
    sent: Sources,
    centre: Float[Tensor, "B 3"],
    radius: Float[Tensor, " B"],
    reach: Float[Tensor, " K"],
    epsilon: float,
) -> _Lists:
    """The nodes and samples that serve each of some blocks."""
    tree, widest = sent.tree, float(reach[-1])
    block = torch.arange(len(centre))
    node = torch.zeros_like(block)
    taken: list[tuple[Tensor, Tensor, Tensor]] = []
    while len(node):
        middle = centre.index_select(0, block)
        low, high = tree.low.index_select(0, node), tree.high.index_select(0, node)
        outside = torch.maximum(low - middle, middle - high).clamp_min_(0)
        away = torch.linalg.vector_norm(outside, dim=1) - radius[block]
        # the nearest that any receiver of the block can be to the node's position
        apart = torch.linalg.vector_norm(middle - sent.position[node], dim=1) - radius[block]
        in_reach = away < widest
        serves = in_reach & (away > 0) & (apart > 0) & (sent.area[node] < epsilon * apart * apart)
        taken.append((block[serves], node[serves], apart[serves]))
        left = torch.nonzero(in_reach & ~serves)[:, 0]
        block, node = block[left], node[left]
        leaf = tree.children[node] == 0
        taken.append(_samples(sent, block[leaf], node[leaf], centre, radius, widest))
        split = torch.nonzero(~leaf)[:, 0]
        count = tree.children[node[split]]
        owner = split.repeat_interleave(count)
        number = torch.arange(len(owner)) - (count.cumsum(0) - count).repeat_interleave(count)
        block, node = block[owner], tree.child[node[owner]] + number
    block, candidate, apart = (torch.cat(x) for x in zip(*taken, strict=True))
    nearest = torch.argsort(apart)
    order = nearest[torch.argsort(block[nearest], stable=True)]
    block, candidate, apart = block[order], candidate[order], apart[order]
    total = torch.bincount(block, minlength=len(centre))
    within = [torch.bincount(block[apart < far], minlength=len(centre)).tolist() for far in reach]
    return _Lists(candidate, (total.cumsum(0) - total).tolist(), within)


def _samples(
    sent: Sources,
    block: Int[Tensor, " L"],
    leaf: Int[Tensor, " L"],
    centre: Float[Tensor, "B 3"],
    radius: Float[Tensor, " B"],
    widest: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """The samples of leaves, as blocks, candidates and least distances."""
    start, count = sent.tree.start[leaf], (sent.tree.stop - sent.tree.start)[leaf]
    owner = block.repeat_interleave(count)
    number = torch.arange(len(owner)) + (start - (count.cumsum(0) - count)).repeat_interleave(count)
    sample = number + len(sent.tree)
    apart = torch.linalg.vector_norm(centre[owner] - sent.position[sample], dim=1) - radius[owner]
    near = apart < widest
    return owner[near], sample[near], apart[near]
