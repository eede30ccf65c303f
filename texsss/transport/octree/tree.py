"""An octree over points: nodes level by level, each a range of the points in Morton order."""

from dataclasses import dataclass

import torch

from texsss.types import Float, Int, Tensor

DEPTH = 18  # levels below the root, at most: three times as many bits make one key


@dataclass(frozen=True, eq=False)
class Octree:
    """Nodes (N), the root first, then level by level.

    `order` (P,): the points in the order that the ranges refer to. `start`, `stop` (N,): the points of
    a node, of `order`. `child`, `children` (N,): its first child and how many follow; 0 of them in a
    leaf. `low`, `high` (N, 3): the box of its points [mm].
    """

    order: Int[Tensor, " P"]
    start: Int[Tensor, " N"]
    stop: Int[Tensor, " N"]
    child: Int[Tensor, " N"]
    children: Int[Tensor, " N"]
    low: Float[Tensor, "N 3"]
    high: Float[Tensor, "N 3"]

    def __len__(self) -> int:
        return len(self.start)

    def sums(self, values: Float[Tensor, "P D"]) -> Float[Tensor, "N D"]:
        """Σ of `values`, given in the order of the tree, over the points of every node."""
        total = torch.cat([values.new_zeros(1, values.shape[1]).double(), values.double().cumsum(0)])
        return (total[self.stop] - total[self.start]).to(values.dtype)


def octree(position: Float[Tensor, "P 3"], leaf: int) -> Octree:
    """The octree of points [mm] whose nodes of more than `leaf` points are split into eighths."""
    code = _morton(position)
    code, order = torch.sort(code)
    place = position[order]
    starts, stops = [torch.zeros(1, dtype=torch.int64)], [torch.tensor([len(order)])]
    firsts, counts = [], []
    total = 1
    for level in range(1, DEPTH + 2):
        start, stop = starts[-1], stops[-1]
        split = (stop - start > leaf) & (level <= DEPTH)
        count, first = torch.zeros_like(start), torch.zeros_like(start)
        firsts.append(first)
        counts.append(count)
        if not bool(split.any()):
            break
        length = (stop - start)[split]
        before = length.cumsum(0) - length
        row = torch.arange(int(length.sum())) + (start[split] - before).repeat_interleave(length)
        key = code[row] >> (3 * (DEPTH - level))
        # neighbours of one parent differ in the last three bits, those of two above them
        new = torch.ones(len(key), dtype=torch.bool)
        new[1:] = key[1:] != key[:-1]
        begin = torch.nonzero(new)[:, 0]
        starts.append(row[begin])
        stops.append(row[torch.cat([begin[1:], begin.new_tensor([len(row)])]) - 1] + 1)
        owner = torch.searchsorted(before, begin, right=True) - 1
        count[split] = torch.bincount(owner, minlength=len(length))
        first[split] = total + count[split].cumsum(0) - count[split]
        total += len(begin)
    start, stop = torch.cat(starts), torch.cat(stops)
    low, high = _boxes(place, start, stop)
    return Octree(order, start, stop, torch.cat(firsts), torch.cat(counts), low, high)


def _boxes(
    place: Float[Tensor, "P 3"], start: Int[Tensor, " N"], stop: Int[Tensor, " N"]
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N 3"]]:
    """The boxes of ranges of points."""
    length = stop - start
    node = torch.arange(len(start)).repeat_interleave(length)
    row = torch.arange(len(node)) + (start - (length.cumsum(0) - length)).repeat_interleave(length)
    index, inside = node[:, None].expand(-1, 3), place[row]
    low = place.new_full((len(start), 3), torch.inf).scatter_reduce_(0, index, inside, "amin")
    high = place.new_full((len(start), 3), -torch.inf).scatter_reduce_(0, index, inside, "amax")
    return low, high


def _morton(position: Float[Tensor, "P 3"]) -> Int[Tensor, " P"]:
    """Keys whose leading bits, three by three, name the cell of a point on every level."""
    place = position.detach().double()
    low = place.amin(0)
    edge = float((place.amax(0) - low).amax())
    cell = ((place - low) / max(edge, 1e-300) * 2**DEPTH).long().clamp(0, 2**DEPTH - 1)
    # spread the bits of each axis three apart
    for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F)):
        cell = (cell | (cell << shift)) & mask
    for shift, mask in ((4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):
        cell = (cell | (cell << shift)) & mask
    return (cell[:, 0] << 2) | (cell[:, 1] << 1) | cell[:, 2]
