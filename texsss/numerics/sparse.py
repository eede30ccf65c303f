"""Fixed sparse matrices, applied to many columns."""

import warnings
from dataclasses import dataclass
from functools import cached_property

import torch
from torch.nn.functional import embedding_bag

from texsss.errors import DomainError
from texsss.types import Float, Int, Tensor

MANY = 6  # columns from which rows of x are summed by embedding_bag, faster by a half


@dataclass(frozen=True, eq=False)
class Sparse:
    """A matrix in compressed rows: row i holds `value[start[i]:start[i+1]]` at `column[…]`.

    Indices are int32. Products are faster by far with columns of `x` that are few and stored row by row.
    """

    start: Int[Tensor, " starts"]
    column: Int[Tensor, " entries"]
    value: Float[Tensor, " entries"]
    columns: int

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.start.shape[0] - 1

    @property
    def bytes(self) -> int:
        """Memory that the entries take."""
        return self.column.numel() * (self.column.element_size() + self.value.element_size())

    def times(self, x: Float[Tensor, "columns C"]) -> Float[Tensor, "rows C"]:
        """The product with the columns of `x`, without gradients."""
        if x.shape[1] > MANY:
            weight = {"per_sample_weights": self.value.to(x.dtype), "include_last_offset": True}
            return embedding_bag(self.column, x.contiguous(), self.start, mode="sum", **weight)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
            matrix = torch.sparse_csr_tensor(
                self.start,
                self.column,
                self.value.to(x.dtype),
                (self.rows, self.columns),
                check_invariants=False,
            )
        return matrix @ x.contiguous()

    @cached_property
    def transpose(self) -> "Sparse":
        """The transpose, its rows in ascending order. As large as the matrix, made when first asked for.

        Its own transpose is this matrix.
        """
        row = torch.repeat_interleave(
            torch.arange(self.rows, dtype=torch.int32, device=self.column.device), self.start.diff().long()
        )
        order = torch.argsort(self.column, stable=True)
        count = torch.bincount(self.column, minlength=self.columns)
        made = Sparse(starts(count), row[order], self.value[order], self.rows)
        made.__dict__["transpose"] = self  # where cached_property keeps it
        return made


def starts(count: Int[Tensor, " rows"]) -> Int[Tensor, " starts"]:
    """Where each row starts, and the last one ends, of rows with `count` entries.

    Raises DomainError: when there are more than indices can count.
    """
    ends = count.cumsum(0)  # int64
    total = int(ends[-1]) if len(ends) else 0
    if total > torch.iinfo(torch.int32).max:
        raise DomainError(f"starts: expected at most 2³¹ - 1 entries, got {total:,}; choose a smaller atlas.")
    return torch.cat([ends.new_zeros(1), ends]).to(torch.int32)
