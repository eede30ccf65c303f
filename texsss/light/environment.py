"""Surroundings as an image: an equirectangular panorama of radiance."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch

from texsss.errors import DomainError
from texsss.light.emitters import POOL, LightSamples, cosine_hemisphere, tilted
from texsss.media import fresnel
from texsss.numerics.sampling import bilinear
from texsss.types import Float, Int, Tensor, unit

_WIDEST = 1024  # texels that samples are chosen from; larger panoramas are averaged down
_CELLS = 96  # normals around which unshadowed light is summed
_SOURCES = 48  # width of the panorama that it is summed over
_STEPS = 8192  # of the cosine, between which what enters is looked up
_UNIFORM = 0.05  # share of the mean brightness added everywhere, so that nothing is never sampled


@dataclass(frozen=True, eq=False)
class ImageEnvironment:
    """Radiance from every direction, `image` (H, W, 3) [W/(m² sr)], times `intensity`.

    Equirectangular: rows from straight up to straight down; the centre lies at -z, what the default
    camera looks at behind the object, and columns run rightwards from there to +x. `rotation`
    [radians] turns it about +y, counter-clockwise seen from above.
    Raises DomainError: when radiance or intensity is negative or not finite.
    """

    image: Float[Tensor, "H W 3"]
    rotation: float = 0.0
    intensity: float = 1.0
    is_delta = False

    def __post_init__(self):
        seen = self.image.detach()
        if not (bool(torch.isfinite(seen).all()) and bool((seen >= 0).all())):
            raise DomainError("ImageEnvironment: expected finite radiance of at least 0; repair the image.")
        if not (0 <= self.intensity < math.inf and math.isfinite(self.rotation)):
            raise DomainError(
                f"ImageEnvironment: expected a finite rotation and an intensity of at least 0, got "
                f"{self.rotation} and {self.intensity}."
            )

    def radiance_from(self, direction: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """See `Environment.radiance_from`. Bilinear, seamless at the back. Differentiable in image."""
        return self.intensity * _looked_up(self.image.to(direction), self._uv(direction))

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """See `Light.sample`; half the samples follow the panorama's brightness, half the cosine.

        Each is weighted by both densities together (balance heuristic). Source: Veach & Guibas 1995.
        """
        by_image = square[:, 0] < 0.5
        bright, around = by_image.nonzero()[:, 0], (~by_image).nonzero()[:, 0]
        chosen = self._pool.to(position)[_cell(square[bright] * square.new_tensor([2.0, 1.0]))]
        free = square[around] * square.new_tensor([2.0, 1.0]) - square.new_tensor([1.0, 0.0])
        spread, _ = cosine_hemisphere(normal[around], free.clamp(0, 1 - 1e-7))
        found = torch.cat([spread, self.radiance_from(spread), self._density(spread)[:, None]], 1)
        seen = position.new_empty(len(square), 7).index_copy(0, bright, chosen).index_copy(0, around, found)
        direction, radiance, density = seen[:, :3], seen[:, 3:6], seen[:, 6]
        cosine = (normal * direction).sum(-1).clamp_min(0)
        irradiance = radiance / ((density + cosine / math.pi) / 2).clamp_min(1e-12)[:, None]
        return LightSamples(direction, position.new_full(position.shape[:1], math.inf), irradiance)

    def look(
        self,
        bright: bool,
        cell: Int[Tensor, " P"],
        sphere: Float[Tensor, "D 3"],
        normal: Float[Tensor, "P 3"],
    ) -> tuple[Float[Tensor, "P 3"], Float[Tensor, "P 3"]]:
        """See `Environment.look`; bright looks follow the panorama's brightness, others the cosine.

        Each is weighted by both densities together, as in `sample`.
        """
        if not bright:
            direction, cosine = tilted(normal, sphere.index_select(0, cell))
            found = self._cells.to(normal).index_select(0, self._texel(direction))
            radiance, density = found[:, :3], found[:, 3]
        else:
            drawn = self._pool.to(normal).index_select(0, cell)
            direction, radiance, density = drawn[:, :3], drawn[:, 3:6], drawn[:, 6]
            cosine = (normal * direction).sum(-1).clamp_min(0)
        return direction, radiance * (cosine / (density + cosine / math.pi).clamp_min(1e-12))[:, None]

    def unoccluded(self, eta: float) -> Callable[[Tensor], Tensor]:
        """See `Environment.unoccluded`: summed for a grid of normals, bilinear between them."""
        power = self._power
        if power.shape[1] < _SOURCES:
            height, width = _SOURCES // 2, _SOURCES
            image = _looked_up(self.image.detach().double(), _centres(height, width))
            power = image.reshape(height, width, 3) * _solid_angle(height, width)[:, None, None]
        light = _gathered(power, _SOURCES).reshape(-1, 3)
        # the light of a cell comes from where it is in it: a sun need not be at the centre
        where = _direction(_centres(*power.shape[:2])).reshape(power.shape)
        centres = unit(_gathered(power.mean(-1, keepdim=True) * where, _SOURCES).reshape(-1, 3)).float()
        light = light.float()
        step = torch.linspace(0, 1, _STEPS + 1)
        entering = step * fresnel.transmittance(step, eta)
        normals = _direction(_centres(_CELLS // 2, _CELLS)).float()
        rows = []
        for part in normals.split(256):
            cosine = (part @ centres.T).clamp(0, 1)
            near = (cosine * _STEPS).round_().int()
            rows.append(entering.index_select(0, near.reshape(-1)).reshape(near.shape) @ light)
        received = self.intensity * torch.cat(rows).reshape(_CELLS // 2, _CELLS, 3)
        return lambda normal: _looked_up(received.to(normal), self._uv(normal))

    @cached_property
    def _power(self) -> Float[Tensor, "h w 3"]:
        """Radiance × solid angle, merged into the texels that samples are chosen from. float64."""
        image = self.image.detach()
        angle = _solid_angle(*image.shape[:2]).to(image)
        return _gathered(image * angle[:, None, None], _WIDEST).double()

    @cached_property
    def _pool(self) -> Float[Tensor, "D 7"]:
        """Directions drawn once, one in each cell of a square: direction, radiance, density [1/sr]."""
        step = torch.arange(POOL) / POOL
        corner = torch.stack(torch.meshgrid(step, step, indexing="ij"), -1).reshape(-1, 2)
        within = torch.rand(len(corner), 2, generator=torch.Generator().manual_seed(0)) / POOL
        direction = self._drawn((corner + within).clamp_max(1 - 1e-7))
        return torch.cat(
            [direction, self.radiance_from(direction), self._density(direction)[:, None]], 1
        ).detach()

    @cached_property
    def _chances(self) -> tuple[Tensor, Tensor, Tensor]:
        """Density per steradian (h, w); cumulative chance of rows (h,); of columns in them, + row (h w,)."""
        power = self._power.mean(-1)
        angle = _solid_angle(*power.shape)[:, None]
        bright = _spread(power / angle)
        bright = bright + _UNIFORM * bright.mean() + 1e-30
        share = bright * angle / (bright * angle).sum()
        rows = share.sum(1)
        columns = share.cumsum(1) / rows[:, None] + torch.arange(len(rows))[:, None]
        return (share / angle).float(), rows.cumsum(0), columns.reshape(-1)

    @cached_property
    def _cells(self) -> Float[Tensor, "N 4"]:
        """Mean radiance and density [1/sr] of each texel that samples are chosen from, row by row."""
        density = self._chances[0]
        radiance = self.intensity * self._power / _solid_angle(*density.shape)[:, None, None]
        return torch.cat([radiance.float(), density[..., None]], -1).reshape(-1, 4)

    def _drawn(self, square: Float[Tensor, "P 2"]) -> Float[Tensor, "P 3"]:
        """Directions with the panorama's density, uniform within each texel."""
        density, rows, columns = self._chances
        height, width = density.shape
        u, v = square.detach().cpu().double().unbind(-1)
        row = torch.searchsorted(rows, u * rows[-1]).clamp_max(height - 1)
        before = torch.where(row > 0, rows[row - 1], 0.0)
        down = ((u * rows[-1] - before) / (rows[row] - before)).clamp(0, 1)
        first = row * width
        place = torch.searchsorted(columns, row + v * (1 - 1e-12)) - first
        column = place.clamp(0, width - 1)
        start = torch.where(column > 0, columns[first + (column - 1).clamp_min(0)] - row, 0.0)
        across = ((v - start) / (columns[first + column] - row - start).clamp_min(1e-30)).clamp(0, 1)
        # uniform in the cosine from the zenith
        top, bottom = (
            torch.cos(math.pi * row.double() / height),
            torch.cos(math.pi * (row + 1).double() / height),
        )
        polar = torch.arccos(torch.lerp(top, bottom, down).clamp(-1, 1))
        uv = torch.stack([(column + across) / width - self.rotation / (2 * math.pi), polar / math.pi], -1)
        return _direction(uv).to(square)

    def _density(self, direction: Float[Tensor, "P 3"]) -> Float[Tensor, " P"]:
        """Of `_drawn` [1/sr]."""
        return self._chances[0].to(direction).reshape(-1)[self._texel(direction.detach())]

    def _texel(self, direction: Float[Tensor, "P 3"]) -> Int[Tensor, " P"]:
        """Which of the texels that samples are chosen from lies there."""
        height, width = self._chances[0].shape
        u, v = self._uv(direction).unbind(-1)
        row = (v * height).long().clamp(0, height - 1)
        return row * width + torch.floor(u * width).long() % width

    def _uv(self, direction: Float[Tensor, "P 3"]) -> Float[Tensor, "P 2"]:
        """Where in the image a world direction is; u goes round."""
        x, y, z = direction.unbind(-1)
        azimuth = torch.atan2(x, -z) + self.rotation
        return torch.stack([0.5 + azimuth / (2 * math.pi), torch.arccos(y.clamp(-1, 1)) / math.pi], -1)


def _cell(square: Float[Tensor, "P 2"]) -> Int[Tensor, " P"]:
    """Which of the pool's cells."""
    row, column = (square * POOL).long().clamp(0, POOL - 1).unbind(-1)
    return row * POOL + column


def _direction(uv: Float[Tensor, "P 2"]) -> Float[Tensor, "P 3"]:
    """Unit direction of a place in an unrotated panorama."""
    azimuth, polar = 2 * math.pi * (uv[:, 0] - 0.5), math.pi * uv[:, 1]
    sine = torch.sin(polar)
    return torch.stack([sine * torch.sin(azimuth), torch.cos(polar), -sine * torch.cos(azimuth)], -1)


def _looked_up(image: Float[Tensor, "H W 3"], uv: Float[Tensor, "P 2"]) -> Float[Tensor, "P 3"]:
    """Bilinear; columns go round, rows end at the poles."""
    half = 0.5 / image.shape[0]
    return bilinear(image, torch.stack([uv[:, 0], uv[:, 1].clamp(half, 1 - half)], -1), "repeat")


def _centres(height: int, width: int) -> Float[Tensor, "P 2"]:
    v, u = torch.meshgrid(
        (torch.arange(height) + 0.5) / height, (torch.arange(width) + 0.5) / width, indexing="ij"
    )
    return torch.stack([u, v], -1).reshape(-1, 2).double()


def _solid_angle(height: int, width: int) -> Float[Tensor, " H"]:
    """Of one texel of each row [sr]; all together 4π."""
    edges = torch.cos(math.pi * torch.arange(height + 1, dtype=torch.float64) / height)
    return 2 * math.pi / width * (edges[:-1] - edges[1:])


def _spread(brightness: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    """A tent of 3 × 3 texels over it: bilinear look-ups carry a bright texel's light that far."""
    for axis in (0, 1):
        # rows end at the poles, columns go round
        back = brightness[:, -1:] if axis else brightness[:1]
        front = brightness[:, :1] if axis else brightness[-1:]
        padded = torch.cat([back, brightness, front], axis)
        count = brightness.shape[axis]
        left, right = padded.narrow(axis, 0, count), padded.narrow(axis, 2, count)
        brightness = (left + 2 * brightness + right) / 4
    return brightness


def _gathered(values: Float[Tensor, "H W D"], widest: int) -> Float[Tensor, "h w D"]:
    """Values summed into cells of a panorama at most `widest` wide; none are lost or counted twice."""
    height, width = values.shape[:2]
    if width <= widest:
        return values
    rows = _merged(values, max(1, round(height * widest / width)))
    return _merged(rows.transpose(0, 1), widest).transpose(0, 1)


def _merged(values: Float[Tensor, "H W D"], cells: int) -> Float[Tensor, "h W D"]:
    """Rows summed into `cells` equal spans; a row across an edge is divided."""
    if values.shape[0] % cells == 0:
        return values.unflatten(0, (cells, -1)).sum(1)
    total = torch.cat([torch.zeros_like(values[:1]), values]).double().cumsum(0)
    edge = torch.arange(cells + 1, dtype=torch.float64) * values.shape[0] / cells
    before = edge.long().clamp_max(values.shape[0] - 1)
    upto = torch.lerp(total[before], total[before + 1], (edge - before)[:, None, None].to(total))
    return upto[1:] - upto[:-1]
