"""From points in space to the nodes of a lattice around them, and back: trilinear weights."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch

from texsss.numerics.sparse import Sparse
from texsss.transport.loops import addresses, call, products, room
from texsss.types import Float, Int, Tensor

WIDTHS = 1, 4, 8, 16  # of vectors, in columns


@dataclass(frozen=True, eq=False)
class Ways:
    """Trilinear weights between points and nodes.

    `member` (P,): the cell that each point is in; `beyond` (P, 3): where, in edges from its first corner;
    `corner` (cells, 8): nodes, z fastest. `nodes`: how many there are.
    """

    member: Int[Tensor, " P"]
    beyond: Float[Tensor, "P 3"]
    corner: Int[Tensor, "cells 8"]
    nodes: int

    @property
    def bytes(self) -> int:
        """Memory that it takes."""
        held = self.member, self.beyond, self.corner
        return sum(part.numel() * part.element_size() for part in held)

    def up(
        self,
        x: Float[Tensor, "N D"],
        out: Sequence[Float[Tensor, "P C"]] | None = None,
        scale: Float[Tensor, "groups P"] | None = None,
    ) -> Float[Tensor, "P D"] | None:
        """What the points get of the nodes, without gradients.

        `out`: where its columns are to go instead, C each, all of one stride; `scale`: times these.
        """
        found = products(x, *(() if out is None else out), *(() if scale is None else [scale]))
        if found is None:
            made = self._plain.times(x)
            if out is None:
                return made
            for k, (to, part) in enumerate(zip(out, made.split(out[0].shape[1], 1), strict=True)):
                to.copy_(part if scale is None else part * scale[k, :, None].to(part))
            return None
        made = room(x, len(self.member), x.shape[1]) if out is None else None
        parts = [made] if made is not None else list(out or ())
        where = addresses(parts)
        x = x if x.stride(1) == 1 else x.contiguous()
        args = self.member, self.beyond, self.corner, x, x.stride(0), where, len(parts), *_layout(parts[0])
        call(found.ways_up, len(self.member), *args, scale)
        return made

    def down(
        self, parts: Sequence[Float[Tensor, "P C"]], scale: Float[Tensor, "groups P"] | None = None
    ) -> Float[Tensor, "N D"]:
        """The transpose: what the nodes get of all columns of `parts`, times `scale`."""
        (x, *_), count = parts, sum(part.shape[1] for part in parts)
        found = products(*parts, *(() if scale is None else [scale]))
        if found is None:
            scaled = [p if scale is None else p * scale[k, :, None].to(p) for k, p in enumerate(parts)]
            return self._plain.transpose.times(torch.cat(scaled, 1))
        if any(part.stride() != (x.stride(0), 1) for part in parts):
            parts = [part.contiguous() for part in parts]
        wide = padded(count)
        made = room(x, self.nodes, wide).zero_()
        spare = room(x, max(torch.get_num_threads() - 1, 0), self.nodes, wide).zero_()
        args = self.member, self.beyond, self.corner, addresses(parts), len(parts), *_layout(parts[0]), scale
        call(found.ways_down, len(self.member), *args, self.nodes, made, wide, spare)
        return made[:, :count]

    @cached_property
    def _plain(self) -> Sparse:
        """The matrix (P × N), for torch."""
        column = self.corner[self.member.long()].flatten()
        (x, y, z) = torch.stack([1 - self.beyond, self.beyond], 2).unbind(1)
        value = (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).flatten()
        start = torch.arange(0, len(column) + 1, 8, dtype=torch.int32, device=column.device)
        return Sparse(start, column, value, self.nodes)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_plain"}


def padded(count: int) -> int:
    """Columns that make whole vectors of at least `count`."""
    return next((width for width in WIDTHS if width >= count), -(-count // WIDTHS[-1]) * WIDTHS[-1])


def _layout(part: Float[Tensor, "P C"]) -> tuple[int, int]:
    """Columns, and numbers from row to row."""
    return part.shape[1], part.stride(0)
