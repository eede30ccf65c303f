"""Equirectangular grids: where their texels look to, how they merge, how directions are drawn from them.

Unrotated: rows from +y to -y, the centre of a row at -z, columns to the right of it towards +x.
"""

import math
from dataclasses import dataclass

import torch

from texsss.numerics.sampling import Texture
from texsss.types import Float, Int, Tensor

STRIP = 256  # rows or columns that are summed at once where spans are uneven: running sums take memory
_UNIFORM = 0.05  # share of the mean brightness added everywhere, so that nothing is never drawn


@dataclass(frozen=True, eq=False)
class Chances:
    """Directions drawn from texels in proportion to their light, uniform within each.

    `density` (h, w) [1/sr]; `rows` (h,): cumulative chance of rows; `columns` (h w,): of the columns in
    them, + the row. float64, but the density.
    """

    density: Float[Tensor, "h w"]
    rows: Float[Tensor, " h"]
    columns: Float[Tensor, " hw"]

    @classmethod
    def of(cls, power: Float[Tensor, "h w"]) -> "Chances":
        """`power`: radiance × solid angle."""
        angle = solid_angle(*power.shape)[:, None]
        bright = power / angle
        bright = bright + _UNIFORM * power.sum() / (4 * math.pi) + 1e-30
        share = bright * angle / (bright * angle).sum()
        rows = share.sum(1)
        columns = share.cumsum(1) / rows[:, None] + torch.arange(len(rows))[:, None]
        return cls((share / angle).float(), rows.cumsum(0), columns.reshape(-1))

    def drawn(self, square: Float[Tensor, "P 2"]) -> Float[Tensor, "P 3"]:
        """Unit directions in the unrotated panorama for places in 0..1²."""
        height, width = self.density.shape
        u, v = square.detach().cpu().double().unbind(-1)
        row = torch.searchsorted(self.rows, u * self.rows[-1]).clamp_max(height - 1)
        before = torch.where(row > 0, self.rows[row - 1], 0.0)
        down = ((u * self.rows[-1] - before) / (self.rows[row] - before)).clamp(0, 1)
        first = row * width
        place = torch.searchsorted(self.columns, row + v * (1 - 1e-12)) - first
        column = place.clamp(0, width - 1)
        start = torch.where(column > 0, self.columns[first + (column - 1).clamp_min(0)] - row, 0.0)
        across = ((v - start) / (self.columns[first + column] - row - start).clamp_min(1e-30)).clamp(0, 1)
        # uniform in the cosine from the zenith
        top, bottom = (
            torch.cos(math.pi * row.double() / height),
            torch.cos(math.pi * (row + 1).double() / height),
        )
        polar = torch.arccos(torch.lerp(top, bottom, down).clamp(-1, 1))
        return direction(torch.stack([(column + across) / width, polar / math.pi], -1)).to(square)

    def texel(self, uv: Float[Tensor, "P 2"]) -> Int[Tensor, " P"]:
        """Which texel lies there, row by row."""
        height, width = self.density.shape
        u, v = uv.unbind(-1)
        row = (v * height).long().clamp(0, height - 1)
        return row * width + torch.floor(u * width).long() % width


def direction(uv: Float[Tensor, "P 2"]) -> Float[Tensor, "P 3"]:
    """Unit direction of a place in an unrotated panorama."""
    azimuth, polar = 2 * math.pi * (uv[:, 0] - 0.5), math.pi * uv[:, 1]
    sine = torch.sin(polar)
    return torch.stack([sine * torch.sin(azimuth), torch.cos(polar), -sine * torch.cos(azimuth)], -1)


def place(direction: Float[Tensor, "P 3"]) -> Float[Tensor, "P 2"]:
    """Where in an unrotated panorama a unit direction is."""
    x, y, z = direction.unbind(-1)
    return torch.stack([0.5 + torch.atan2(x, -z) / (2 * math.pi), torch.arccos(y.clamp(-1, 1)) / math.pi], -1)


def turned(direction: Float[Tensor, "P 3"], angle: float) -> Float[Tensor, "P 3"]:
    """Directions turned about +y by `angle` [radians], counter-clockwise seen from above."""
    x, y, z = direction.unbind(-1)
    cosine, sine = math.cos(angle), math.sin(angle)
    return torch.stack([cosine * x + sine * z, y, cosine * z - sine * x], -1)


def looked_up(image: Float[Tensor, "H W C"] | Texture, uv: Float[Tensor, "P 2"]) -> Float[Tensor, "P C"]:
    """Bilinear; columns go round, rows end at the poles."""
    texture = Texture.of(image, "repeat")
    half = 0.5 / texture.planes.shape[2]
    return texture.at(torch.stack([uv[:, 0], uv[:, 1].clamp(half, 1 - half)], -1))


def centres(height: int, width: int) -> Float[Tensor, "P 2"]:
    """Places of the centres of all texels, row by row. float64."""
    v, u = torch.meshgrid(
        (torch.arange(height, dtype=torch.float64) + 0.5) / height,
        (torch.arange(width, dtype=torch.float64) + 0.5) / width,
        indexing="ij",
    )
    return torch.stack([u, v], -1).reshape(-1, 2)


def solid_angle(height: int, width: int) -> Float[Tensor, " H"]:
    """Of one texel of each row [sr]; all together 4π. float64."""
    edges = torch.cos(math.pi * torch.arange(height + 1, dtype=torch.float64) / height)
    return 2 * math.pi / width * (edges[:-1] - edges[1:])


def power(image: Float[Tensor, "H W D"], widest: int) -> Float[Tensor, "h w D"]:
    """Radiance × solid angle, summed into cells as by `gathered`."""
    height, width = image.shape[:2]
    narrow = _merged(image, 1, min(width, widest))
    angle = solid_angle(height, width).to(narrow)
    return _merged(narrow * angle[:, None, None], 0, _rows(height, width, widest))


def gathered(values: Float[Tensor, "H W D"], widest: int) -> Float[Tensor, "h w D"]:
    """Values summed into cells of a panorama at most `widest` wide; none are lost or counted twice."""
    height, width = values.shape[:2]
    return _merged(_merged(values, 1, min(width, widest)), 0, _rows(height, width, widest))


def _rows(height: int, width: int, widest: int) -> int:
    """Rows of a panorama after it became at most `widest` wide."""
    return height if width <= widest else max(1, round(height * widest / width))


def _merged(values: Float[Tensor, "H W D"], axis: int, cells: int) -> Float[Tensor, "h w D"]:
    """Rows (0) or columns (1) summed into `cells` equal spans; one across an edge is divided."""
    count = values.shape[axis]
    if count == cells:
        return values
    if count % cells == 0:
        return values.unflatten(axis, (cells, -1)).sum(axis + 1)
    edge = torch.arange(cells + 1, dtype=torch.float64) * count / cells
    before = edge.long().clamp_max(count - 1)
    share = (edge - before)[:, None, None]

    def summed(part: Tensor) -> Tensor:
        part = part.movedim(axis, 0)
        total = torch.cat([torch.zeros_like(part[:1]), part]).double().cumsum(0)
        upto = torch.lerp(total[before], total[before + 1], share)
        return (upto[1:] - upto[:-1]).movedim(0, axis)

    return torch.cat([summed(part) for part in values.split(STRIP, 1 - axis)], 1 - axis)
