"""Random walks through a plate whose thickness changes along x, which scatters evenly and refracts nothing.

Walked backwards: from where light leaves to where it entered, which by reciprocity is as likely.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Along = Callable[[Array], Array]
"""A function of x [mm]."""
LEAST = 0.02  # chance of survival below which a path goes on by ROULETTE, so much heavier
ROULETTE = 0.1
LOOKS = 16  # along each free path for the surface
INSIDE = 1e-7  # of the surface where paths begin [mm]


@dataclass(frozen=True)
class Plate:
    """Between z = ± ½ `thickness` [mm]; `sigma_a`, `sigma_s` [1/mm]."""

    thickness: Along
    sigma_a: float
    sigma_s: float

    def passed(self, x: Array, light: Along, paths: int, seed: int) -> tuple[Array, Array]:
        """What leaves the upper side at `x` after one scattering or more, and its standard error.

        Per unit of diffuse light: on the lower side shines `light`.
        """
        random, extinction = np.random.default_rng(seed), self.sigma_a + self.sigma_s
        place, into = self._begin(np.repeat(x, paths), random)
        path, weight, found = np.arange(len(place)), np.ones(len(place)), np.zeros(len(place))
        scattered = False
        while len(path):
            way = random.exponential(1 / extinction, len(path))[:, None] * into
            at, below, left = place + way, np.zeros(len(path), bool), np.zeros(len(path), bool)
            for step in range(1, LOOKS + 1):
                here = place + way * (step / LOOKS)
                out = ~left & (np.abs(here[:, 2]) > self.thickness(here[:, 0]) / 2)
                at[out], below[out] = here[out], here[out, 2] < 0
                left |= out
            if scattered:
                found[path[below]] = weight[below] * light(at[below, 0])
            scattered = True
            place, path, weight = at[~left], path[~left], weight[~left] * (self.sigma_s / extinction)
            weak = weight < LEAST
            kept = ~weak | (random.random(len(weight)) < ROULETTE)
            weight = np.where(weak, weight / ROULETTE, weight)
            place, path, weight = place[kept], path[kept], weight[kept]
            into = _even(len(path), random)
        found = found.reshape(len(x), paths)
        return found.mean(1), found.std(1) / np.sqrt(paths)

    def _begin(self, x: Array, random: np.random.Generator) -> tuple[Array, Array]:
        """Places on the upper side, and directions into the plate by the cosine."""
        slope = (self.thickness(x + 1e-3) - self.thickness(x - 1e-3)) / 4e-3
        normal = np.stack([-slope, np.zeros_like(x), np.ones_like(x)], 1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        place = np.stack([x, np.zeros_like(x), self.thickness(x) / 2], 1) - INSIDE * normal
        into = _even(len(x), random) - normal
        return place, into / np.linalg.norm(into, axis=1, keepdims=True)


def _even(count: int, random: np.random.Generator) -> Array:
    """Directions spread evenly."""
    way = random.normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1, keepdims=True)
