"""Surroundings as an image: an equirectangular panorama of radiance."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import torch

from texsss.errors import DomainError
from texsss.light import cube, panorama
from texsss.light.emitters import POOL, LightSamples, Spots, cosine_hemisphere, tilted
from texsss.light.panorama import (
    Chances,
    centres,
    direction,
    gathered,
    looked_up,
    place,
    solid_angle,
    turned,
)
from texsss.light.spots import brightest_of_the_rest, spots_of
from texsss.media import fresnel
from texsss.types import Float, Int, Tensor, unit

_WIDEST = 1024  # texels that samples are chosen from; larger panoramas are averaged down
_FINEST = 256  # and smaller ones divided, as their look-ups are smooth
_SOURCES = 48  # width of the panorama over which unshadowed light is summed
_COARSER = (48, 32, 24, 16, 12, 8, 6, 4)  # widths of panoramas whose cells stand for directions
_STEPS = 8192  # of the cosine, between which what enters is looked up
_MOST = 1e30  # light that arrives from all around [W/m²]: products of it stay within float32


@dataclass(frozen=True, eq=False)
class ImageEnvironment:
    """Radiance from every direction, `image` (H, W, 3) [W/(m² sr)], times `intensity`.

    Equirectangular: rows from straight up to straight down; the centre lies at -z, what the default
    camera looks at behind the object, and columns run rightwards from there to +x. `rotation`
    [radians] turns it about +y, counter-clockwise seen from above. `name` stands for it in messages,
    `looks` are the kinds of looks that its shadows take, see `Environment.look`.
    Raises DomainError: when radiance or intensity is negative or not finite, or there is too much light.
    """

    image: Float[Tensor, "H W 3"]
    rotation: float = 0.0
    intensity: float = 1.0
    name: str = "ImageEnvironment"
    looks: tuple[bool, ...] = (True, False)
    is_delta = False

    def __post_init__(self):
        seen = self.image.detach()
        least, most = seen.aminmax()
        if not (least >= 0 and most < math.inf):  # NaN is neither
            wrong = int((~(torch.isfinite(seen) & (seen >= 0))).any(-1).sum())
            raise DomainError(
                f"{self.name}: expected finite radiance of at least 0, got {wrong:,} texels without; repair "
                "the image."
            )
        if not (0 <= self.intensity < math.inf and math.isfinite(self.rotation)):
            raise DomainError(
                f"{self.name}: expected a finite rotation and an intensity of at least 0, got "
                f"{self.rotation} and {self.intensity}."
            )
        rows = seen.sum((1, 2)).double() / 3
        total = self.intensity * float((rows * solid_angle(*seen.shape[:2])).sum())
        if not total <= _MOST:
            raise DomainError(
                f"{self.name}: expected at most {_MOST:g} W/m² in all, got {total:.3g}; scale it down."
            )

    def radiance_from(self, direction: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """See `Environment.radiance_from`. Bilinear, seamless at the back. Differentiable in image."""
        return self.intensity * looked_up(self.image, place(turned(direction, -self.rotation))).to(direction)

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """See `Light.sample`; half the samples follow the panorama's brightness, half the cosine.

        Each is weighted by both densities together (balance heuristic); where only one kind is among the
        `looks`, all are of that. Source: Veach & Guibas 1995.
        """
        if len(self.looks) == 2:
            by_image = square[:, 0] < 0.5
            square = torch.stack([torch.frac(2 * square[:, 0]), square[:, 1]], -1)
        else:
            by_image = torch.full_like(square[:, 0], self.looks[0], dtype=torch.bool)
        bright, around = by_image.nonzero()[:, 0], (~by_image).nonzero()[:, 0]
        chosen = self._pool.to(position)[_cell(square[bright])]
        spread, _ = cosine_hemisphere(normal[around], square[around].clamp(0, 1 - 1e-7))
        found = torch.cat([spread, self._cells.to(position)[self._texel(spread)]], 1)
        seen = position.new_empty(len(square), 7).index_copy(0, bright, chosen).index_copy(0, around, found)
        direction, radiance, density = seen[:, :3], seen[:, 3:6], seen[:, 6]
        chance = self._chance(density, (normal * direction).sum(-1).clamp_min(0)) / len(self.looks)
        distance = position.new_full(position.shape[:1], math.inf)
        return LightSamples(direction, distance, radiance / chance.clamp_min(1e-12)[:, None])

    def look(
        self,
        bright: bool,
        cell: Int[Tensor, " P"],
        sphere: Float[Tensor, "D 3"],
        normal: Float[Tensor, "P 3"],
    ) -> tuple[Float[Tensor, "P 3"], Float[Tensor, "P 3"]]:
        """See `Environment.look`; bright looks follow the panorama's brightness, others the cosine.

        Each is weighted by the densities of both kinds together, as in `sample`, if both are taken.
        """
        if not bright:
            direction, cosine = tilted(normal, sphere.index_select(0, cell))
            found = self._cells.to(normal).index_select(0, self._texel(direction))
            radiance, density = found[:, :3], found[:, 3]
        else:
            drawn = self._pool.to(normal).index_select(0, cell)
            direction, radiance, density = drawn[:, :3], drawn[:, 3:6], drawn[:, 6]
            cosine = (normal * direction).sum(-1).clamp_min(0)
        chance = self._chance(density, cosine)
        return direction, radiance * (cosine / chance.clamp_min(1e-12))[:, None]

    def _chance(self, density: Float[Tensor, " P"], cosine: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
        """Sum of the densities of all `looks` [1/sr]; `density`: of those that look for light."""
        around = cosine / math.pi
        return density + around if len(self.looks) == 2 else density if self.looks[0] else around

    def unoccluded(self, eta: float) -> Callable[[Tensor], Tensor]:
        """See `Environment.unoccluded`: summed for normals on a cube, bilinear between them."""
        power = self._power
        light = gathered(power, _SOURCES).reshape(-1, 3)
        # the light of a cell comes from where it is in it: a sun need not be at the centre
        where = direction(centres(*power.shape[:2])).reshape(power.shape)
        sources = unit(gathered(power.mean(-1, keepdim=True) * where, _SOURCES).reshape(-1, 3)).float()
        light = light.float()
        step = torch.linspace(0, 1, _STEPS + 1)
        entering = step * fresnel.transmittance(step, eta)
        rows = []
        for part in cube.nodes().float().split(256):
            cosine = (part @ sources.T).clamp(0, 1)
            near = (cosine * _STEPS).round_().int()
            rows.append(entering.index_select(0, near.reshape(-1)).reshape(near.shape) @ light)
        received = self.intensity * torch.cat(rows)
        return lambda normal: cube.between(received.to(normal), turned(normal, -self.rotation))

    def mean_looks(self, most: int) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N 3"]]:
        """All of its light as if from `most` directions at most, and what each brings facing it [W/m²].

        Those are the means within cells of the sphere, as small as they may be; at least eight are.
        """
        power, most = self._power, max(most, 8)
        where = direction(centres(*power.shape[:2])).reshape(power.shape)
        wide = next(w for w in _COARSER if int((gathered(power, w).mean(-1) > 0).sum()) <= most)
        light = gathered(power, wide).reshape(-1, 3)
        some = light.mean(-1) > 0
        towards = gathered(power.mean(-1, keepdim=True) * where, wide).reshape(-1, 3)[some]
        return turned(unit(towards), self.rotation).float(), self.intensity * light[some].float()

    @cached_property
    def spots(self) -> Spots | None:
        """See `Environment.spots`: what is above four times the mean radiance."""
        return spots_of(self.image, self.intensity, self.rotation)

    @cached_property
    def parts(self) -> tuple["ImageEnvironment", ...]:
        """See `Environment.parts`: the rest, which is looked for all around, and the spots where they are."""
        power = self._power
        radiance = power / solid_angle(*power.shape[:2])[:, None, None]
        level = brightest_of_the_rest(power.mean(-1))
        if level is None:
            return (self,)
        rest = radiance * (level / radiance.mean(-1, keepdim=True).clamp_min(1e-30)).clamp_max(1)
        spots = replace(self, image=(radiance - rest).float(), looks=(True,))
        return replace(self, image=rest.float(), looks=(False,)), spots

    @cached_property
    def _power(self) -> Float[Tensor, "h w 3"]:
        """Radiance × solid angle, in the texels that samples are chosen from. float64."""
        image = self.image.detach()
        height, width = image.shape[:2]
        if width < _FINEST:
            more = -(-_FINEST // width)
            height, width = more * height, more * width
            image = looked_up(image, centres(height, width).to(image)).reshape(height, width, 3)
        return panorama.power(image, _WIDEST).double()

    @cached_property
    def _chances(self) -> Chances:
        return Chances.of(self._power.mean(-1))

    @cached_property
    def _cells(self) -> Float[Tensor, "N 4"]:
        """Mean radiance and density [1/sr] of each texel that samples are chosen from, row by row."""
        density = self._chances.density
        radiance = self.intensity * self._power / solid_angle(*density.shape)[:, None, None]
        return torch.cat([radiance.float(), density[..., None]], -1).reshape(-1, 4)

    @cached_property
    def _pool(self) -> Float[Tensor, "D 7"]:
        """Directions drawn once, one in each cell of a square: direction, radiance, density [1/sr]."""
        step = torch.arange(POOL) / POOL
        corner = torch.stack(torch.meshgrid(step, step, indexing="ij"), -1).reshape(-1, 2)
        within = torch.rand(len(corner), 2, generator=torch.Generator().manual_seed(0)) / POOL
        drawn = turned(self._chances.drawn((corner + within).clamp_max(1 - 1e-7)), self.rotation)
        # of the texels, not of the image between them: radiance / density has no noise of its own
        return torch.cat([drawn, self._cells[self._texel(drawn)]], 1)

    def _texel(self, direction: Float[Tensor, "P 3"]) -> Int[Tensor, " P"]:
        """Which of the texels that samples are chosen from lies there."""
        return self._chances.texel(place(turned(direction.detach(), -self.rotation)))


def _cell(square: Float[Tensor, "P 2"]) -> Int[Tensor, " P"]:
    """Which of the pool's cells."""
    row, column = (square * POOL).long().clamp(0, POOL - 1).unbind(-1)
    return row * POOL + column
