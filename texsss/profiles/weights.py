"""Weights of the Gaussian bank for every texel, computed once per distinct material."""

from dataclasses import dataclass, replace

import torch

from texsss.media.stack import LayerTable, Stack
from texsss.numerics.threads import in_threads
from texsss.profiles.hankel import Material, as_table, flat_profile
from texsss.profiles.incidence import Incidence
from texsss.profiles.project import NODES, frequencies, projector
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks

LEVELS = 256  # an 8-bit map keeps its values
TABLE = 8  # texels per row, from which rows are few enough as they are
MAPS = 2  # that vary independently, at most, for rounding to make a table of them
ALIKE = 255 * 256  # steps of a column's range, within which values count as equal; whole for 8-bit maps
SAMPLE = 2**14  # rows that are looked at before all are compared
CHUNK = 16_384  # rows solved at once
WORKSPACE = 2**22  # [numbers] set aside before


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights per texel as a table of distinct rows and an index into it.

    `variances` (K,) [mm²]; `table` (U, K, C); `row` (P,): the row of each texel.
    """

    variances: Float[Tensor, " K"]
    table: Float[Tensor, "U K C"]
    row: Int[Tensor, " P"]

    def at(self, points: slice | Tensor = slice(None)) -> Float[Tensor, "P K C"]:
        """Weights of some texels, of all unless told."""
        return self.table[self.row[points].long()]

    @property
    def total(self) -> Float[Tensor, "P C"]:
        """Share of the light that comes back at every texel."""
        return self.table.sum(1)[self.row.long()]

    def scaled(self, share: Float[Tensor, "V _"], row: Int[Tensor, " P"]) -> "Weights":
        """The same shapes times `share[row]` at every texel."""
        if share.shape[0] == 1:
            return replace(self, table=self.table * share[:, None])
        keys, rows = torch.unique(self.row.long() * share.shape[0] + row, return_inverse=True)
        table = self.table[keys // share.shape[0]] * share[keys % share.shape[0]][:, None]
        return replace(self, table=table, row=rows.to(torch.int32))


def weights_for(
    material: Material,
    variances: Float[Tensor, " K"],
    *,
    points_uv: Float[Tensor, "P 2"] | None = None,
    points: int | None = None,
    model: str = "layered-sp3",
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    side: str = "reflectance",
    nodes: int = NODES,
    channels: int = 3,
    levels: int | None = LEVELS,
    dtype: torch.dtype = torch.float32,
    compiled: bool = False,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Weights:
    """Weights of the ladder `variances` [mm²] for every texel.

    `material`: a stack whose maps are looked up at `points_uv` (P, 2); a uniform one has a single row,
    shared by all of `points_uv` or by `points` texels. `side`: reflectance or transmittance. Equal rows
    are solved once; where they are many and one or two maps make all that varies, every coefficient is
    first rounded to `levels` steps between its extremes, so that they become a table (None: exact;
    ignored while gradients are asked for). Totals move by up to .002, where a layer is thinnest.
    Grey materials are shown in `channels` channels. `compiled`: layered models under torch.compile, five
    times faster once compiled (under a minute, kept on disk); ignored while gradients are asked for.
    Differentiable in maps and coefficients.
    Raises DomainError: for unknown names; Cancelled.
    """
    if not isinstance(material, (LayerTable, Stack)):
        material = Stack(material)
    if points_uv is not None:
        points = points_uv.shape[0]
    if points_uv is not None and isinstance(material, Stack) and material.varies:
        table = material.at(points_uv)
    else:
        table = as_table(material)
    table = table.to(dtype).expand(channels)
    table, row = _distinct(table, points, None if table.requires_grad else levels)
    table = replace(table, known_isotropic=table.isotropic)

    s, ds = frequencies(variances, nodes)
    matrix = projector(variances, s, ds).to(table.sigma_a)
    s = torch.cat([s, s.new_zeros(1)]).to(table.sigma_a)
    # glibc hands memory back after every operation until it has seen something large freed: half the time
    torch.empty(WORKSPACE, device=matrix.device)
    compiled = compiled and not table.requires_grad
    options = {"model": model, "scattering": scattering, "incidence": incidence, "compiled": compiled}
    done: list[int] = []

    def solve(part: slice) -> Float[Tensor, "B K C"]:
        check_cancelled(cancel)
        count = part.stop - part.start
        rows = table.rows(part)
        if compiled and count < CHUNK:  # one shape is compiled for all
            rows = rows.rows(torch.arange(CHUNK).clamp_max(count - 1))
        spectrum = flat_profile(rows, s, side=side, **options)
        done.append(count)
        if progress is not None:
            progress("weights", sum(done) / table.batch[0])
        # channels and rows, flattened → rows, weights and channels
        made = (matrix @ spectrum).view(len(variances) * table.channels, -1).t()
        return made.reshape(-1, len(variances), table.channels)[:count]

    parts = chunks(table.batch[0], CHUNK)
    if table.requires_grad:
        return Weights(variances.to(table.sigma_a), torch.cat([solve(part) for part in parts]), row)
    weights = matrix.new_empty(table.batch[0], len(variances), table.channels)

    def fill(part: slice) -> None:
        weights[part] = solve(part)

    if compiled:  # kernels hold the interpreter, and are parallel themselves
        with torch.no_grad():
            for part in parts:
                fill(part)
    else:
        in_threads(fill, parts)
    return Weights(variances.to(table.sigma_a), weights, row)


def _distinct(
    table: LayerTable, points: int | None, levels: int | None
) -> tuple[LayerTable, Int[Tensor, " P"]]:
    """The distinct rows of a table, batch (U,), and which of them every texel has."""
    device = table.sigma_a.device
    if not table.batch:
        return table.of([x[None] for x in table.fields]), torch.zeros(
            points or 1, dtype=torch.int32, device=device
        )
    table = table.of([x.reshape(-1, *x.shape[-2:]) for x in table.fields])
    count = table.batch[0]
    if table.requires_grad:  # a shared row would pass its gradient to one texel only
        return table, torch.arange(count, dtype=torch.int32, device=device)
    if count > SAMPLE * TABLE and _all_differ(table.rows(slice(None, None, count // SAMPLE)), levels):
        return table, torch.arange(count, dtype=torch.int32, device=device)
    flat = torch.cat([x.reshape(count, -1) for x in table.fields], 1)
    columns = (flat != flat[:1]).any(0)
    varying = flat[:, columns]
    if varying.shape[1] == 0:
        return table.rows(slice(0, 1)), torch.zeros(count, dtype=torch.int32, device=device)
    first, row = _unique_rows(_keys(varying))
    if levels is not None and len(first) > count / TABLE and _independent(varying) <= MAPS:
        low, high = varying.aminmax(dim=0)
        step = (high - low) / (levels - 1)
        varying = low + torch.round((varying - low) / step) * step
        first, row = _unique_rows(varying)
    flat = flat[first]
    flat[:, columns] = varying[first]
    fields = [x.reshape(-1, *table.sigma_a.shape[1:]) for x in flat.chunk(4, 1)]
    return table.of(fields), row.to(torch.int32)


def _all_differ(few: LayerTable, levels: int | None) -> bool:
    """Whether some rows of a table show that hardly any two are alike, nor would be after rounding."""
    flat = torch.cat([x.reshape(few.batch[0], -1) for x in few.fields], 1)
    varying = flat[:, (flat != flat[:1]).any(0)]
    if varying.shape[1] == 0 or (levels is not None and _independent(varying) <= MAPS):
        return False
    return len(_unique_rows(_keys(varying))[0]) == len(varying)


def _keys(varying: Float[Tensor, "P F"]) -> Float[Tensor, "P F"]:
    """Columns in steps of their range: look-ups round what is equal in a map, by some 1e-6 of it."""
    low, high = varying.aminmax(dim=0)
    return torch.round((varying - low) * (ALIKE / (high - low)))


def _independent(varying: Float[Tensor, "P F"]) -> int:
    """How many columns differ by more than scale and offset, judged by a few hundred rows."""
    low, high = varying.aminmax(dim=0)
    some = (varying[:: max(len(varying) // 256, 1)] - low) / (high - low)
    some = torch.where(some[:1] > 0.5, 1 - some, some)  # a map and its inverse are one
    count = 0
    while some.shape[1]:
        count += 1
        some = some[:, ((some - some[:, :1]).abs() > 1e-3).any(0)]
    return count


def _unique_rows(rows: Float[Tensor, "P F"]) -> tuple[Int[Tensor, " U"], Int[Tensor, " P"]]:
    """Index of the first of each set of equal rows, and the set of each row."""
    generator = torch.Generator().manual_seed(0)
    odd = torch.randint(-(2**62), 2**62, (rows.shape[1],), generator=generator).to(rows.device) * 2 + 1
    bits = rows.contiguous().view(torch.int64 if rows.dtype == torch.float64 else torch.int32).long()
    # multiply-and-shift hash: sorting one integer per row is far cheaper than sorting rows
    mixed = bits * odd
    _, row = torch.unique((mixed ^ (mixed >> 29)).sum(1), return_inverse=True)
    count = int(row.max()) + 1
    first = torch.full((count,), rows.shape[0], device=rows.device)
    first.scatter_reduce_(0, row, torch.arange(rows.shape[0], device=rows.device), "amin")
    if not torch.equal(rows[first][row], rows):  # two rows shared a hash: do it the slow way
        _, row = torch.unique(rows, dim=0, return_inverse=True)
        first = torch.full((int(row.max()) + 1,), rows.shape[0], device=rows.device)
        first.scatter_reduce_(0, row, torch.arange(rows.shape[0], device=rows.device), "amin")
    return first, row
