"""The direction of the light that entered, as a cosine inside the medium."""

import math
from functools import lru_cache

import numpy as np

from texsss.errors import DomainError
from texsss.media import fresnel

Incidence = float | str
"""`normal`, `diffuse` (Lambertian, weighted by what enters) or an angle from the normal outside [rad]."""


def incidence_cosine(incidence: Incidence, eta: float) -> float:
    """Cosine of the refracted light in the medium: of diffuse light the mean, weighted by flux.

    .667 at eta 1 and .865 at 1.4 for diffuse light. Raises DomainError: for other names, and angles
    outside 0..π/2.
    """
    if incidence == "normal":
        return 1.0
    if incidence == "diffuse":
        return _mean_cosine(eta)
    if isinstance(incidence, str) or not 0 <= incidence <= math.pi / 2:
        raise DomainError(
            f"incidence: expected 'diffuse', 'normal' or an angle in 0..π/2 [rad], got {incidence!r}."
        )
    # grazing light of an unrefracting medium never gets in: stay a hair above
    return max(math.sqrt(1 - math.sin(incidence) ** 2 / eta**2), 1e-3)


@lru_cache(maxsize=64)
def _mean_cosine(eta: float) -> float:
    x, w = np.polynomial.legendre.leggauss(96)
    mu, w = ((x + 1) / 2) ** 2, w * (x + 1) / 2
    entered = w * mu * np.array([1 - fresnel.reflectance(float(m), eta) for m in mu])
    inside = np.sqrt(1 - (1 - mu**2) / eta**2)
    return float((entered * inside).sum() / entered.sum())
