"""From points in space to the nodes of a lattice around them, and back."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from jaxtyping import UInt8
from torch.nn.functional import pad

from texsss.numerics.memory import room
from texsss.numerics.sparse import Sparse
from texsss.transport.gutter import entries, with_rim
from texsss.transport.loops import addresses, call, products
from texsss.transport.stencil import NODES, kinds, weights
from texsss.types import Float, Int, Tensor

WIDTHS = 1, 4, 8, 16  # of vectors, in columns
PARTS = 16  # that points are in, for threads to share


@dataclass(frozen=True, eq=False)
class Ways:
    """The weights of `stencil` between points and nodes.

    A cell is what lies nearest to one node. `cell` (P,): that a point is in; `beyond` (3, P): where, in edges
    from that node; `kind` (P,): of its weights. `near` (cells, 19): nodes, in the order of AROUND, the
    nearest one in place of those that no weight asks for. `nodes`: how many there are. `own` (cells, 19),
    `twin` (T,): see `parted`.
    """

    cell: Int[Tensor, " P"]
    beyond: Float[Tensor, "3 P"]
    kind: UInt8[Tensor, " P"]
    near: Int[Tensor, "cells 19"]
    own: Int[Tensor, "cells 19"]
    twin: Int[Tensor, " T"]
    nodes: int

    @property
    def bytes(self) -> int:
        """Memory that it takes."""
        held = self.cell, self.beyond, self.kind, self.near, self.own, self.twin
        return sum(part.numel() * part.element_size() for part in held)

    def up(
        self,
        x: Float[Tensor, "N D"],
        out: Sequence[Float[Tensor, "P C"]] | None = None,
        scale: Sequence[Float[Tensor, " P"]] | None = None,
    ) -> Float[Tensor, "P D"] | None:
        """What the points get of the nodes, without gradients.

        Rows of `x` are whole vectors: see `padded`. `out`: where its columns are to go instead, C each, as
        many as there are places, all of one stride; `scale`: times these.
        """
        found = products(x, *(out or ()), *(scale or ()))
        made = room(x, len(self.cell), x.shape[1]) if out is None else None
        parts = [made] if made is not None else list(out or ())
        if found is None:
            for k, (to, part) in enumerate(zip(parts, self._plain.times(x).split(parts[0].shape[1], 1))):
                to.copy_(part if scale is None else part * scale[k][:, None].to(part))
            return made
        points = len(self.cell), self.cell, self.beyond, self.kind, kinds(), self.near
        scales = None if scale is None else addresses(scale)
        call(found.ways_up, *points, x, x.stride(0), *_layout(parts), scales)
        return made

    def down(
        self,
        parts: Sequence[Float[Tensor, "Q C"]],
        scale: Sequence[Float[Tensor, " P"]] | None = None,
        rim: Sparse | None = None,
    ) -> Float[Tensor, "N D"]:
        """The transpose: what the nodes get of all columns of `parts`, times `scale`, in whole vectors.

        `rim`: the matrix (P, Q - P) by which points first get what is behind them in `parts`; else Q is P.
        """
        (x, *_), count = parts, sum(part.shape[1] for part in parts)
        found = products(*parts, *(scale or ()))
        wide = padded(count)
        if found is None:
            parts = with_rim(parts, rim)
            scaled = [p if scale is None else p * scale[k][:, None].to(p) for k, p in enumerate(parts)]
            return pad(self._plain.transpose.times(torch.cat(scaled, 1)), (0, wide - count))
        if any(part.stride() != x.stride() for part in parts):
            parts = [part.contiguous() for part in parts]
        made = room(x, self.nodes + len(self.twin), wide).zero_()
        points = len(self.cell), _part(len(self.cell)), self.cell, self.beyond, self.kind, kinds(), self.own
        scales = None if scale is None else addresses(scale)
        twins = self.nodes, len(self.twin), self.twin
        call(found.ways_down, *points, *_layout(parts), scales, *entries(rim), *twins, made, wide)
        return made[: self.nodes]

    @cached_property
    def _plain(self) -> Sparse:
        """The matrix (P × N), for torch."""
        at = kinds().to(self.cell.device)[self.kind.long()].long()
        column = self.near[self.cell.long()].gather(1, at).flatten()
        value = weights(self.beyond.T, self.kind).flatten()
        start = torch.arange(0, len(column) + 1, NODES, dtype=torch.int32, device=column.device)
        return Sparse(start, column, value, self.nodes)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_plain"}


def ways(
    cell: Int[Tensor, " P"],
    beyond: Float[Tensor, "3 P"],
    kind: UInt8[Tensor, " P"],
    near: Int[Tensor, "cells 19"],
    nodes: int,
) -> Ways:
    """The ways of points, each in a `cell`; the others are as in `Ways`.

    Cells come in the order of their first points, near which the others are stored; a cell whose points are
    in several parts comes once for each.
    """
    part = torch.arange(len(cell), device=cell.device) // _part(len(cell))
    met, member = torch.unique(part * len(near) + cell, return_inverse=True)
    points = torch.arange(len(cell), device=cell.device)
    first = torch.full_like(met, len(cell)).scatter_reduce_(0, member, points, "amin")
    rank = torch.argsort(first)
    place = torch.empty_like(rank, dtype=torch.int32)
    place[rank] = torch.arange(len(rank), dtype=torch.int32, device=cell.device)
    near, part = near[(met % len(near))[rank]], (met // len(near))[rank]
    return Ways(place[member], beyond.contiguous(), kind, near, *parted(near, part, nodes), nodes)


def parted(
    near: Int[Tensor, "cells 19"], part: Int[Tensor, " cells"], nodes: int
) -> tuple[Int[Tensor, "cells 19"], Int[Tensor, " T"]]:
    """Rows that parts of the points may add to at the same time, and whose the rows beyond `nodes` are.

    A node near cells of several parts has a row of its own for each of them.
    """
    part, flat = part.repeat_interleave(near.shape[1]), near.flatten().long()
    least = part.new_full((nodes,), PARTS).scatter_reduce_(0, flat, part, "amin")
    shared = torch.nonzero(part != least[flat])[:, 0]
    twins, row = torch.unique(flat[shared] * PARTS + part[shared], return_inverse=True)
    own = near.flatten().clone()
    own[shared] = (nodes + row).int()
    return own.view_as(near), (twins // PARTS).int()


def _part(points: int) -> int:
    """Points of one part."""
    return max(-(-points // PARTS), 1)


def padded(count: int) -> int:
    """Columns that make whole vectors of at least `count`."""
    return next((width for width in WIDTHS if width >= count), -(-count // WIDTHS[-1]) * WIDTHS[-1])


def _layout(parts: Sequence[Float[Tensor, "P C"]]) -> tuple[Tensor, int, int, int, int]:
    """Where each is, how many, their columns, and numbers from row to row and from column to column."""
    (count, (pitch, step)) = parts[0].shape[1], parts[0].stride()
    return addresses(parts), len(parts), count, pitch, step
