"""What the nodes of an octree send: moments of the light in them, where it lies and how far it spreads."""

from dataclasses import dataclass

import torch

from texsss.transport.octree.tree import Octree, octree
from texsss.types import Float, Tensor

LEAF = 8  # samples in a leaf, at most


@dataclass(frozen=True, eq=False)
class Sources:
    """Candidates for a sum over light (M): the nodes of `tree`, then its samples in the tree's order.

    `position` (M, 3): means of the samples' by what they send [mm]; `area` (M,) [mm²]; `spread` (M,): the
    variance of what they send about it, per axis of the surface [mm²]. `moments` (J, M, Q): sums of what
    is asked for, one set for all Gaussians or one for each.
    """

    tree: Octree
    position: Float[Tensor, "M 3"]
    area: Float[Tensor, " M"]
    spread: Float[Tensor, " M"]
    moments: Float[Tensor, "J M Q"]


def sources(
    position: Float[Tensor, "P 3"],
    area: Float[Tensor, " P"],
    flux: Float[Tensor, " P"],
    sent: Float[Tensor, "J P Q"],
    leaf: int = LEAF,
) -> Sources:
    """The candidates for samples at `position` [mm] of `area` [mm²] that send `sent`.

    `flux` ≥ 0 weighs samples where a node's position is the mean of theirs; where all are dark, area does.
    """
    tree = octree(position, leaf)
    place, area, flux = (x[tree.order].detach() for x in (position, area, flux))
    # positions from the middle: sums of squares keep their digits
    middle = place.mean(0)
    weight = (flux * area + 1e-9 * (flux * area).sum() / area.sum().clamp_min(1e-30) * area).double()
    weight = torch.where(weight.sum() > 0, weight, area.double())[:, None]
    local = (place - middle).double()
    packed = torch.cat([weight, weight * local, weight * local.square().sum(1, keepdim=True)], 1)
    total = tree.sums(torch.cat([packed, area.double()[:, None]], 1))
    mean = total[:, 1:4] / total[:, :1]
    # two of three axes lie in the surface
    spread = ((total[:, 4] / total[:, 0] - mean.square().sum(1)) / 2).clamp_min(0)
    moments = torch.stack(
        [torch.cat([tree.sums(part), part]) for part in (part[tree.order] for part in sent)]
    )
    return Sources(
        tree,
        torch.cat([mean.to(place) + middle, place]),
        torch.cat([total[:, 5].to(place), area]),
        torch.cat([spread.to(place), torch.zeros_like(area)]),
        moments,
    )
