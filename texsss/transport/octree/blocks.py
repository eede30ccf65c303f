"""Receivers gathered into compact blocks of one size, by halving them across their longest side."""

from dataclasses import dataclass

import torch

from texsss.types import Float, Int, Tensor


@dataclass(frozen=True, eq=False)
class Blocks:
    """`member` (B, n): the points of each block, some of them twice where they do not divide evenly.

    `centre` (B, 3), `radius` (B,): a ball around each [mm].
    """

    member: Int[Tensor, "B n"]
    centre: Float[Tensor, "B 3"]
    radius: Float[Tensor, " B"]


def blocks(position: Float[Tensor, "P 3"], most: int) -> Blocks:
    """The blocks of at most `most` points [mm]; at least one point is given."""
    position = position.detach()
    halvings = 0
    while -(-len(position) >> halvings) > most:
        halvings += 1
    size = -(-len(position) // 2**halvings)
    # the last point stands in for those that are missing
    member = torch.arange(size * 2**halvings).clamp_max_(len(position) - 1)[None]
    for _ in range(halvings):
        place = position[member]
        axis = (place.amax(1) - place.amin(1)).argmax(1)
        along = place.gather(2, axis[:, None, None].expand(-1, place.shape[1], 1))[..., 0]
        member = member.gather(1, along.argsort(1)).reshape(2 * len(member), -1)
    place = position[member]
    low, high = place.amin(1), place.amax(1)
    centre = (low + high) / 2
    radius = torch.linalg.vector_norm(place - centre[:, None], dim=2).amax(1)
    return Blocks(member, centre, radius)
