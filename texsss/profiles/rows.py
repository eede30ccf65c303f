"""The distinct rows of a table of layers: equal ones are solved once."""

import torch

from texsss.media.stack import FAR_MM, LayerTable
from texsss.numerics.threads import in_threads
from texsss.types import Float, Int, Tensor, chunks

TABLE = 8  # texels per row, from which rows are few enough as they are
MAPS = 2  # that vary independently, at most, for rounding to make a table of them
ENDLESS = FAR_MM / 2  # [mm], thicker layers have no end
ALIKE = 255 * 256  # steps of a column's range, within which values count as equal; whole for 8-bit maps
SAMPLE = 2**10  # rows that are looked at before all are compared: of a table's some are equal
BLOCK = 2**14  # rows compared at once
FEW = 256  # rows that show which columns vary together
JUDGED = 2**12  # rows that show what rounding loses
LOST_ALIKE = 1e-3  # of values on average, at most, where those within a step are taken as equal
ALIKE_SHARE = 1e-3  # of their ranges, by which columns of one map differ
OFF_LEVEL = 0.02  # of a step, within which a value lies on a level
LOST_LEVELS = 0.02  # ... and by rounding to levels
LOOKED_UP = 1e-6  # [mm or 1/mm], look-ups round by as much, so that nothing is lost by less
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
    ends = _ends(table)[columns]
    judged = slice(None, None, count // JUDGED | 1)
    first, row = _unique_rows(_keys(varying, ends))
    if _lost(varying[judged], varying[first[row[judged]]], ends) > LOST_ALIKE:
        first, row = _unique_rows(torch.where(varying > ends, FAR_MM, varying))
    if levels is not None and len(first) > count / TABLE and _independent(varying, ends) <= MAPS:
        rounded = _rounded(varying, ends, levels)
        if _lost(varying[judged], rounded[judged], ends) < LOST_LEVELS:
            varying = rounded
            first, row = _unique_rows(varying)
    flat = flat[first]
    flat[:, columns] = varying[first]
    fields = [x.reshape(-1, *table.sigma_a.shape[1:]) for x in flat.chunk(4, 1)]
    return table.of(fields), row.to(torch.int32)


def _rounded(varying: Float[Tensor, "P F"], ends: Tensor, levels: int) -> Float[Tensor, "P F"]:
    """Columns on `levels` of their range: even ones where they lie on such already, as maps of 8 bits do.

    Else their square roots are even: light depends on the first traces of absorption most. What falls where
    another column rises, as one map makes both, is rounded with it.
    """
    low, high = _range(varying, ends)
    last, share = levels - 1, ((varying - low) / (high - low)).clamp(0, 1)
    even = torch.round(share * last) / last
    on_them = ((even - share).abs() * (varying <= ends) < OFF_LEVEL / last).all(0)
    few = slice(None, None, len(varying) // FEW | 1)
    falls = torch.zeros_like(on_them)
    for base in _bases(varying[few], ends):
        falls |= ((share[few] + share[few, base, None] - 1).abs() < ALIKE_SHARE).all(0)
    root = torch.where(falls, 1 - share, share).sqrt()
    finer = (torch.round(root * last) / last) ** 2
    kept = torch.where(on_them, even, torch.where(falls, 1 - finer, finer))
    return torch.where(varying > ends, FAR_MM, low + kept * (high - low))


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
    some, ends = some[:, columns], _ends(table)
    low, high = _range(some, ends[columns])
    bases = columns[_bases(some, ends[columns])]
    if len(bases) > MAPS:
        return None
    row, sets = torch.zeros(count, dtype=torch.long, device=some.device), 1
    shape = (len(fields), *fields[0].shape[1:])
    for field, layer, channel in zip(*(x.tolist() for x in torch.unravel_index(bases, shape)), strict=True):
        column = fields[field][:, layer, channel, None].contiguous()
        end = ends.view(shape)[field, layer, channel]
        level, levels = _numbered(_keys(column, end)[:, 0].long())
        row, sets = row * levels + level, sets * levels
        if sets > PAIRS:
            return None
    row, sets = _numbered(row)
    first = _firsts(row, sets)
    least = float((high - low).min()) / ALIKE
    moving = set(torch.unravel_index(columns, shape)[0].tolist())
    known = [x[first] if k in moving else x[:1] for k, x in enumerate(fields)]
    judged = slice(None, None, count // JUDGED | 1)
    for k in moving:
        true, kept = fields[k][judged].flatten(1), known[k][row[judged]].flatten(1)
        if _lost(true, kept, ends.view(len(fields), -1)[k]) > LOST_ALIKE:
            return None

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
    columns = (flat != flat[:1]).any(0)
    varying, ends = flat[:, columns], _ends(few)[columns]
    if varying.shape[1] == 0 or (levels is not None and _independent(varying, ends) <= MAPS):
        return False
    return len(_unique_rows(_keys(varying, ends))[0]) == len(varying)


def _ends(table: LayerTable) -> Float[Tensor, " F"]:
    """What is endless in every column of the fields side by side: only thicknesses can be."""
    ends = table.sigma_a.new_full((len(table.fields), table.sigma_a.shape[-2:].numel()), torch.inf)
    ends[-1] = ENDLESS
    return ends.flatten()


def _keys(varying: Float[Tensor, "P F"], ends: Tensor) -> Float[Tensor, "P F"]:
    """Columns in steps of their range: look-ups round what is equal in a map, by some 1e-6 of it."""
    low, high = _range(varying, ends)
    steps = torch.round((varying - low) * (ALIKE / (high - low)))
    return torch.where(varying > ends, steps.new_tensor(ALIKE + 1), steps)


def _lost(values: Float[Tensor, "J F"], kept: Float[Tensor, "J F"], ends: Tensor) -> float:
    """How far values are from what is kept of them on average, as a share of each, in the worst column.

    Much, where a few great values make the steps of a range large.
    """
    endless = values > ends
    size = torch.where(endless, 0, values).abs()
    moved = ((kept - values).abs() - LOOKED_UP).clamp_min(0) / size.clamp_min(1e-30)
    # endless stays endless, whatever its number
    return float(torch.where(endless, 0, moved.clamp_max(1)).mean(0).max())


def _range(values: Float[Tensor, "P F"], ends: Tensor) -> tuple[Float[Tensor, " F"], Float[Tensor, " F"]]:
    """Least and greatest value of every column, but for endless layers: in steps of their size all are one.

    Where nothing else differs, the range is as wide as the value.
    """
    near = values <= ends
    low = torch.where(near, values, torch.inf).amin(0).clamp_max(FAR_MM)
    high = torch.where(near, values, -torch.inf).amax(0)
    return low, torch.where(high > low, high, 2 * low.abs() + 1e-30)


def _independent(varying: Float[Tensor, "P F"], ends: Tensor) -> int:
    """How many columns differ by more than scale and offset, judged by a few hundred rows."""
    return len(_bases(varying[:: len(varying) // FEW | 1], ends))


def _bases(some: Float[Tensor, "P F"], ends: Tensor) -> list[int]:
    """Columns of which all others differ only by scale and offset."""
    low, high = _range(some, ends)
    some = (torch.where(some > ends, high, some) - low) / (high - low)
    some = torch.where(some[:1] > 0.5, 1 - some, some)  # a map and its inverse are one
    left, bases = torch.arange(some.shape[1]), []
    while len(left):
        bases.append(int(left[0]))
        left = left[((some[:, left] - some[:, left[:1]]).abs() > ALIKE_SHARE).any(0)]
    return bases


def _unique_rows(rows: Float[Tensor, "P F"]) -> tuple[Int[Tensor, " U"], Int[Tensor, " P"]]:
    """Index of the first of each set of equal rows, and the set of each row."""
    generator = torch.Generator().manual_seed(0)
    odd = torch.randint(-(2**62), 2**62, (rows.shape[1],), generator=generator).to(rows.device) * 2 + 1
    bits = rows.contiguous().view(torch.int64 if rows.dtype == torch.float64 else torch.int32).long()
    # multiply-and-shift hash: sorting one integer per row is far cheaper than sorting rows
    mixed = bits * odd
    _, row = torch.unique((mixed ^ (mixed >> 29)).sum(1), return_inverse=True)
    first = _firsts(row, int(row.max()) + 1)
    if not torch.equal(rows[first][row], rows):  # two rows shared a hash: do it the slow way
        _, row = torch.unique(rows, dim=0, return_inverse=True)
        first = _firsts(row, int(row.max()) + 1)
    return first, row


def _firsts(row: Int[Tensor, " P"], sets: int) -> Int[Tensor, " U"]:
    """Where the first of each set is, by the set of each row."""
    first = torch.full((sets,), len(row), device=row.device)
    return first.scatter_reduce_(0, row, torch.arange(len(row), device=row.device), "amin")
