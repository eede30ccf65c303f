"""Means over nearby points that face the same way: noise down without losing shape."""

from collections.abc import Sequence

import scipy  # its parts are loaded where they are first used
import torch

from texsss.numerics.threads import in_threads
from texsss.types import Cancel, Float, Tensor, check_cancelled, chunks

_CHUNK = 1 << 13  # points at a time: their neighbours stay in the cache
_LEAF, _SLACK = 32, 0.5  # a neighbour may lie half as far again as the nearest: a quarter of the time less
_SHARPNESS = 4  # power of the cosine between normals that weighs a neighbour


def neighbours_mean(
    position: Float[Tensor, "P 3"],
    normal: Float[Tensor, "P 3"],
    values: Sequence[Float[Tensor, "P C"]],
    count: int,
    cancel: Cancel | None = None,
) -> list[Float[Tensor, "P C"]]:
    """Means of each of `values` over each point's `count` nearest ones or nearly so, itself included.

    They weigh by cos⁴ between unit normals, 0 where they face apart: the other side of a thin part or
    of closed lips does not mix in. Without gradients. Raises Cancelled.
    """
    count = min(count, len(position))
    places, facing = position.detach().cpu().numpy(), normal.detach().contiguous()
    widths = [value.shape[1] for value in values]
    table = torch.cat([value.detach() for value in values], 1)
    tree = scipy.spatial.KDTree(places, leafsize=_LEAF, balanced_tree=False, compact_nodes=False)

    def mean(rows: slice) -> Float[Tensor, "rows D"]:
        check_cancelled(cancel)
        _, nearest = tree.query(places[rows], k=count, eps=_SLACK)
        found = torch.from_numpy(nearest).to(table.device).reshape(-1)
        around = facing.index_select(0, found).reshape(-1, count, 3)
        weight = (around * facing[rows, None]).sum(-1).clamp_min(0) ** _SHARPNESS
        near = table.index_select(0, found).reshape(-1, count, table.shape[1])
        total = torch.bmm(weight[:, None], near)[:, 0]
        whole = weight.sum(1, keepdim=True)
        return torch.where(whole > 0, total / whole.clamp_min(1e-6), table[rows])

    return list(torch.cat(in_threads(mean, chunks(len(places), _CHUNK), cancel)).split(widths, 1))
