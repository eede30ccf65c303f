"""Means over nearby points that face the same way: noise down without losing shape."""

import torch
from scipy.spatial import KDTree

from texsss.types import Float, Tensor, chunks

_CHUNK = 1 << 17
_SHARPNESS = 4  # power of the cosine between normals that weighs a neighbour


def neighbours_mean(
    position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], values: Float[Tensor, "P C"], count: int
) -> Float[Tensor, "P C"]:
    """Mean of `values` over each point's `count` nearest ones, itself included.

    They weigh by cos⁴ between unit normals, 0 where they face apart: the other side of a thin part or
    of closed lips does not mix in. Differentiable in values.
    """
    count = min(count, len(position))
    places = position.detach().cpu().numpy()
    tree = KDTree(places, balanced_tree=False, compact_nodes=False)
    facing = normal.detach()
    means = []
    for rows in chunks(len(places), _CHUNK):
        _, found = tree.query(places[rows], k=count, workers=torch.get_num_threads())
        near = torch.from_numpy(found).reshape(-1, count).to(values.device)
        total, weights = torch.zeros_like(values[rows]), values.new_zeros(len(near), 1)
        for column in near.unbind(1):
            weight = (facing[rows] * facing[column]).sum(-1, keepdim=True).clamp_min(0) ** _SHARPNESS
            total = total + weight * values[column]
            weights = weights + weight
        means.append(torch.where(weights > 0, total / weights.clamp_min(1e-6), values[rows]))
    return torch.cat(means)
