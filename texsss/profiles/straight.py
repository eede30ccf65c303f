"""Light that crosses a clear film straight: how far aside, in Hankel space.

Light at an angle θ within moves aside by d tan θ on its way through thickness d, which is J0(s d tan θ)
averaged over azimuth. What arrives is taken as even over all angles. The means over what the outer face lets
out, and over what it mirrors back, total reflection included, are functions of s d alone; both are fitted by

    e^(-q (rise + bend q) / (1 + level q)),   q = (s d)²,

which falls everywhere. At eta 1 the mean is x K1(x), x = s d, which it meets to .017; elsewhere it meets
what leaves to .04, and what is mirrored to .07, where these are positive. Both go below 0, by up to .06 and
.17, of rings around the entry; the fit stays above. Source: our own.
"""

import math
from functools import cache
from typing import NamedTuple, no_type_check

import numpy as np
import torch

from texsss.media import fresnel
from texsss.numerics.quadrature import gauss_legendre

LEAST = 0.05  # means below are left to the fit
FAR = 100.0  # s d beyond is as this
LEVELS = [0.0, *np.geomspace(0.01, 30, 160)]  # tried, per squared mean tangent


class Fading(NamedTuple):
    """Numbers of the fit."""

    rise: float
    bend: float
    level: float


@no_type_check
def faded(fading, aside):
    """The mean of J0 at s d = `aside` ≥ 0, of any shape. Differentiable."""
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
    """The best fit with no number below 0: at a given level the exponent is linear in the others."""
    slope, share = np.sqrt(1 / mu**2 - 1), weight / weight.sum()
    reach = share @ slope  # mean tangent: by it all indices are alike
    x = np.geomspace(0.05, 20, 80)
    mean = torch.special.bessel_j0(torch.from_numpy(np.outer(x, slope / reach))).numpy() @ share
    last = int(np.argmax(mean < LEAST))
    q, mean = x[:last] ** 2, mean[:last]
    tried = [_at_level(q, mean, level) for level in LEVELS]
    best = min(tried, key=lambda found: float(((_fading(q, found) - mean) ** 2).sum()))
    return Fading(*map(float, (best.rise * reach**2, best.bend * reach**4, best.level * reach**2)))


def _fading(q: np.ndarray, found: Fading) -> np.ndarray:
    return np.exp(-q * (found.rise + found.bend * q) / (1 + found.level * q))


def _at_level(q: np.ndarray, mean: np.ndarray, level: float) -> Fading:
    """Rise and bend, none below 0, by least squares; errors of the mean itself count."""
    slope = mean * q / (1 + level * q)
    columns, wanted = np.stack([slope, slope * q], 1), -mean * np.log(mean)
    both = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    if not (both >= 0).all():
        alone = columns.T @ wanted / (columns**2).sum(0) * np.eye(2)
        both = min(alone, key=lambda found: float(((columns @ found - wanted) ** 2).sum()))
    return Fading(float(both[0]), float(both[1]), float(level))
