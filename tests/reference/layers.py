"""The stack that every reference takes: plain numbers, one channel."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np


@dataclass(frozen=True)
class Layer:
    """One homogeneous slab; `g` is Schlick's k when `phase` is "schlick"."""

    sigma_a: float  # [1/mm]
    sigma_s: float  # [1/mm], not reduced
    thickness: float = inf  # [mm]
    g: float = 0.0
    eta: float = 1.0
    phase: str = "henyey-greenstein"

    @property
    def sigma_s_prime(self) -> float:
        return self.sigma_s * (1 - self.mean_cosine)

    @property
    def sigma_t(self) -> float:
        return self.sigma_a + self.sigma_s

    @property
    def sigma_t_prime(self) -> float:
        return self.sigma_a + self.sigma_s_prime

    @property
    def albedo_prime(self) -> float:
        return self.sigma_s_prime / self.sigma_t_prime

    @property
    def mean_cosine(self) -> float:
        """∫ c p(c) of the phase function; Schlick's integrates (1 - k²) c / 2 (1 - k c)²."""
        k = self.g
        if self.phase != "schlick" or k == 0:
            return k
        return float((1 - k * k) / (2 * k * k) * (np.log((1 - k) / (1 + k)) + 2 * k / (1 - k * k)))


def check_stack(layers: Sequence[Layer]) -> None:
    """Raises ValueError: when only the last layer may be infinite and another one is."""
    if not layers or any(np.isinf(layer.thickness) for layer in layers[:-1]):
        raise ValueError("a stack needs at least one layer, and only its last one may be infinite")
