"""The distinct rows of a table of layers: equal ones are solved once."""

import torch

from texsss.media.stack import FAR_MM, LayerTable
from texsss.numerics.threads import in_threads
from texsss.types import Float, Int, Tensor, chunks

TABLE = 8  # texels per row, from which rows are few enough as they are
MAPS = 2  # that vary independently, at most, for rounding to make a table of them
ENDLESS = FAR_MM / 2  # thicker layers have no end; no other column holds numbers as large
ALIKE = 255 * 256  # steps of a column's range, within which values count as equal; whole for 8-bit maps
SAMPLE = 2**10  # rows that are looked at before all are compared: of a table's some are equal
BLOCK = 2**14  # rows compared at once
FEW = 256  # rows that show which columns vary together
PAIRS = 2**22  # of levels of two maps, at most, for a look-up table


def distinct(
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
    tabulated = by_maps(table)
    if tabulated is not None and len(tabulated[0]) <= max(count / TABLE, 1):
        return table.rows(tabulated[0]), tabulated[1].to(torch.int32)
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


def by_maps(table: LayerTable) -> tuple[Int[Tensor, " U"], Int[Tensor, " P"]] | None:
    """Index of one of each set of equal rows, and the set of each row, where one or two maps decide.

    That is guessed from a few rows and proven for all; None where it is not so. Nothing is sorted.
    """
    count = table.batch[0]
    fields, step = table.fields, count // FEW | 1  # odd: not one column of a map
    some = torch.cat([x[::step].flatten(1) for x in fields], 1)
    columns = (some != some[:1]).any(0).nonzero()[:, 0]
    if not len(columns):
        return None
    bases = columns[_bases(some[:, columns])]
    if len(bases) > MAPS:
        return None
    row, sets = torch.zeros(count, dtype=torch.long, device=some.device), 1
    shape = (len(fields), *fields[0].shape[1:])
    for field, layer, channel in zip(*(x.tolist() for x in torch.unravel_index(bases, shape)), strict=True):
        level, levels = _numbered(_keys(fields[field][:, layer, channel, None].contiguous())[:, 0].long())
        row, sets = row * levels + level, sets * levels
        if sets > PAIRS:
            return None
    row, sets = _numbered(row)
    first = torch.full((sets,), count, device=row.device)
    first.scatter_reduce_(0, row, torch.arange(count, device=row.device), "amin")
    low, high = _range(some[:, columns])
    least = float((high - low).min()) / ALIKE
    moving = set(torch.unravel_index(columns, shape)[0].tolist())
    known = [x[first] if k in moving else x[:1] for k, x in enumerate(fields)]

    def alike(part: slice) -> bool:
        for k, x in enumerate(fields):
            if x.stride(0) == 0:
                continue
            same = torch.index_select(known[k], 0, row[part]) if k in moving else known[k]
            # infinities leave nothing behind
            low, high = torch.nan_to_num_(same - x[part]).aminmax()
            if max(float(high), -float(low)) > 2 * least:
                return False
        return True

    return (first, row) if all(in_threads(alike, chunks(count, BLOCK))) else None


def _numbered(key: Int[Tensor, " P"]) -> tuple[Int[Tensor, " P"], int]:
    """Keys ≥ 0 as numbers without gaps, in the same order, and how many there are."""
    number = (torch.bincount(key) > 0).cumsum(0)
    return torch.index_select(number, 0, key) - 1, int(number[-1])


def _all_differ(few: LayerTable, levels: int | None) -> bool:
    """Whether some rows of a table show that hardly any two are alike, nor would be after rounding."""
    flat = torch.cat([x.reshape(few.batch[0], -1) for x in few.fields], 1)
    varying = flat[:, (flat != flat[:1]).any(0)]
    if varying.shape[1] == 0 or (levels is not None and _independent(varying) <= MAPS):
        return False
    return len(_unique_rows(_keys(varying))[0]) == len(varying)


def _keys(varying: Float[Tensor, "P F"]) -> Float[Tensor, "P F"]:
    """Columns in steps of their range: look-ups round what is equal in a map, by some 1e-6 of it."""
    low, high = _range(varying)
    steps = torch.round((varying - low) * (ALIKE / (high - low)))
    return torch.where(varying > ENDLESS, steps.new_tensor(ALIKE + 1), steps)


def _range(values: Float[Tensor, "P F"]) -> tuple[Float[Tensor, " F"], Float[Tensor, " F"]]:
    """Least and greatest value of every column, but for endless layers: in steps of their size all are one.

    Where nothing else differs, the range is as wide as the value.
    """
    near = values <= ENDLESS
    low = torch.where(near, values, torch.inf).amin(0).clamp_max(FAR_MM)
    high = torch.where(near, values, -torch.inf).amax(0)
    return low, torch.where(high > low, high, 2 * low.abs() + 1e-30)


def _independent(varying: Float[Tensor, "P F"]) -> int:
    """How many columns differ by more than scale and offset, judged by a few hundred rows."""
    return len(_bases(varying[:: len(varying) // FEW | 1]))


def _bases(some: Float[Tensor, "P F"]) -> list[int]:
    """Columns of which all others differ only by scale and offset."""
    low, high = some.aminmax(dim=0)
    some = (some - low) / (high - low)
    some = torch.where(some[:1] > 0.5, 1 - some, some)  # a map and its inverse are one
    left, bases = torch.arange(some.shape[1]), []
    while len(left):
        bases.append(int(left[0]))
        left = left[((some[:, left] - some[:, left[:1]]).abs() > 1e-3).any(0)]
    return bases


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
