"""Where in frequency a profile has to be met: a band per row, by the mean free path that its light finds."""

from collections.abc import Iterator
from typing import NamedTuple

import torch

from texsss.media.stack import LayerTable
from texsss.numerics.quadrature import graded
from texsss.profiles.hankel import tame_profile, unflattened
from texsss.types import Float, Int, Tensor

PATHS = 20  # highest frequency times mean free path
GRADING = 7.0
LEAST = 1e-6  # [1/mm] of an extinction that counts
BLACK = 1e-9  # of an albedo, so that layers which scatter nothing have a mean free path, too


class Band(NamedTuple):
    """Rows that are met up to one frequency, and their profile there."""

    rows: Int[Tensor, " U"]
    s: Float[Tensor, " S"]
    ds: Float[Tensor, " S"]
    sampled: Float[Tensor, "U S+1 C"]
    """R̂ at `s`, and at 0 in the end."""

    def energy(self, spectrum: Float[Tensor, "U S C"]) -> Float[Tensor, "U C"]:
        """∫ r f² dr of a function whose Hankel transform at `s` is given."""
        return ((self.s * self.ds)[:, None] * spectrum**2).sum(-2)


def extinction(table: LayerTable) -> Float[Tensor, "*B"]:
    """Reduced extinction that light meets where it first scatters [1/mm]: of the densest channel.

    The geometric mean of the layers', weighed by the light that first scatters there: clear, absent
    and black layers do not count, deep ones little. Not differentiable.
    """
    sigma_a, reduced = table.sigma_a.detach(), (table.sigma_s * (1 - table.g)).detach()
    sigma = (sigma_a + reduced).double().clamp_min(LEAST)
    depth = sigma * table.thickness.detach()
    above = depth.cumsum(-2).roll(1, -2)
    above[..., 0, :] = 0
    weight = torch.exp(-above) * -torch.expm1(-depth) * (reduced / sigma + BLACK)
    whole = weight.sum(-2)
    mean = (weight * sigma.log()).sum(-2) / torch.where(whole > 0, whole, 1)
    return torch.where(whole > 0, mean.exp(), LEAST).amax(-1)


def bands(
    table: LayerTable,
    count: int,
    *,
    highest: float | None = None,
    **options,
) -> Iterator[Band]:
    """The rows of a table, sampled at `count` frequencies each; every row is in one band.

    A band reaches to PATHS / mean free path of its densest row, at most twice as far as others need, or to
    `highest` [1/mm]. `options`: of `flat_profile`. Differentiable in the table.
    """
    flat = table.of([x.flatten(0, -3) if x.ndim > 2 else x[None] for x in table.fields])
    reach = PATHS * extinction(flat) if highest is None else flat.sigma_a.new_full(flat.batch, highest)
    octave = torch.floor((reach / reach.max()).log2() + 1e-9)
    for one in octave.unique():
        rows = (octave == one).nonzero()[:, 0]
        s, ds = graded(count, float(reach[rows].max()), grading=GRADING)
        part = flat.rows(rows)
        sampled = unflattened(tame_profile(part, torch.cat([s, s.new_zeros(1)]), **options), part)
        yield Band(rows, s, ds, sampled)


def gathered(found: list[Band], results: list[Tensor], table: LayerTable) -> Tensor:
    """What was found for the rows of each band, in the order and batch of the table."""
    order = torch.argsort(torch.cat([band.rows for band in found]))
    joined = torch.cat(results)[order]
    return joined.reshape(*table.batch, *joined.shape[1:])
