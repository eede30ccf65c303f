"""Light that crosses a clear film straight: how far aside, in Hankel space.

Light at an angle θ within moves aside by d tan θ on its way through thickness d, which is J0(s d tan θ)
averaged over azimuth. What arrives is taken as even over all angles. The means over what the outer face lets
out, and over what it mirrors back, total reflection included, are functions of s d alone; both are fitted by

    e^(-q (rise + bend q) / (1 + level q)),   q = (s d)²,

which falls everywhere. At eta 1 the mean is x K1(x), x = s d, which it meets to .013; elsewhere to .02
of what leaves. What is mirrored goes below 0 by up to .17, of rings around the entry, and stays above here.
"""

import math
from functools import cache
from itertools import combinations
from typing import NamedTuple, no_type_check

import numpy as np
import torch

from texsss.media import fresnel
from texsss.numerics.quadrature import gauss_legendre

LEAST = 0.05  # means below are left to the fit
FAR = 100.0  # s d beyond is as this


class Fading(NamedTuple):
    """Numbers of the fit."""

    rise: float
    bend: float
    level: float


@no_type_check
def faded(fading, aside):
    """The mean of J0 at s d = `aside` ≥ 0. Differentiable."""
    q = aside.clamp_max(FAR) ** 2
    return torch.exp(q * (q * -fading.bend - fading.rise) / (q * fading.level + 1))


@cache
def leaving(eta: float) -> Fading:
    """Of light that a face of index `eta` lets out, on one way to it."""
    mu, w, mirrored = _angles(eta)
    return _fitted(mu, w * mu * (1 - mirrored))


@cache
def returning(eta: float) -> Fading:
    """Of light that a face of index `eta` mirrors back, on one way to it; there and back is twice as far."""
    mu, w, mirrored = _angles(eta)
    return _fitted(mu, w * mu * mirrored) if eta > 1 else Fading(0.0, 0.0, 0.0)


def _angles(eta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines within, quadrature weights, and the reflectance of the face."""
    critical = math.sqrt(1 - 1 / eta**2)
    parts = [gauss_legendre(400, *ends) for ends in ((0.0, critical), (critical, 1.0)) if ends[0] < ends[1]]
    mu, w = (torch.cat(x) for x in zip(*parts, strict=True))
    return mu.numpy(), w.numpy(), fresnel.reflectance(mu, 1 / eta).numpy()


def _fitted(mu: np.ndarray, weight: np.ndarray) -> Fading:
    """The best fit whose numbers are all at least 0."""
    x = np.geomspace(0.05, 10, 60)
    slope = np.sqrt(1 / mu**2 - 1)
    mean = torch.special.bessel_j0(torch.from_numpy(np.outer(x, slope))).numpy() @ weight / weight.sum()
    last = int(np.argmax(mean < LEAST))
    q, mean = x[:last] ** 2, mean[:last]
    depth = -np.log(mean)
    columns = np.stack([q, q * q, -depth * q], 1)  # the exponent times its denominator is linear
    best = np.zeros(3)
    for _ in range(8):  # by the denominator found before, errors of the mean itself count
        by = mean / (1 + best[2] * q)
        best = _not_negative(columns * by[:, None], depth * by)
    return Fading(*map(float, best))


def _not_negative(columns: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Least squares with no number below 0; few enough to try all sets of them."""
    count, least, best = columns.shape[1], math.inf, np.zeros(columns.shape[1])
    for size in range(1, count + 1):
        for kept in map(list, combinations(range(count), size)):
            found = np.linalg.lstsq(columns[:, kept], wanted, rcond=None)[0]
            missed = float(((columns[:, kept] @ found - wanted) ** 2).sum())
            if (found >= 0).all() and missed < least:
                least, best = missed, np.zeros(count)
                best[kept] = found
    return best
