"""Light scattered more than once in a thin slab between faces that mirror it: the twin of `profiles.even`.

Everywhere alike and in all directions, so that chances of single flights say all: what collides again, ray
by ray, against what leaves. Cosines by dense quadrature, where texsss has four nodes and a closed form.
"""

from collections.abc import Sequence

import numpy as np

from reference.beam import ballistic
from reference.boundary import Array, fresnel
from reference.layers import Layer

REACH = 0.45
UNLIKE = 40.0
NODES = 400


def share(layers: Sequence[Layer]) -> float:
    """How much of this there is in multiple scattering, against two modes."""
    eta = layers[0].eta
    if eta == 1 or np.isinf(layers[-1].thickness) or any(layer.eta != eta for layer in layers):
        return 0.0
    mirrored = np.sqrt(1 - 1 / eta**2)
    depths = np.array([layer.sigma_t_prime * layer.thickness for layer in layers])
    albedo = np.array([layer.sigma_s * (1 - layer.g) / layer.sigma_t_prime for layer in layers])
    unlike = np.cov(albedo, aweights=depths, ddof=0) if len(layers) > 1 else 0.0
    beyond = (depths.sum() * (1 - mirrored) / (REACH * mirrored)) ** 1.5
    return float(np.exp(-beyond * (1 + UNLIKE * unlike)))


def scattered(layers: Sequence[Layer], s: Array) -> Array:
    """R̂(s) = T̂(s) of two or more scatterings under a beam at normal incidence; layers of one index."""
    d = sum(layer.thickness for layer in layers)
    sigma = _depth(layers) / d
    albedo = sum(layer.sigma_s * (1 - layer.g) * layer.thickness for layer in layers) / _depth(layers)
    lost = 1 - sum(ballistic(layers, "normal"))
    mu, weight, mirror = _rays(layers[0].eta)
    slant = np.sqrt(sigma**2 + s[:, None] ** 2 * (1 - mu**2))  # attenuation per path, over azimuths
    passed = np.exp(-slant * d / mu)
    reached = (1 - passed) * mu / (slant * d)  # the first face
    left = reached * (1 - mirror) / (1 - mirror * passed)
    again = (weight * sigma / slant * (1 - left)).sum(1)
    return lost * albedo**2 * again / (1 - albedo * again) * (weight * left).sum(1) / 2


def _depth(layers: Sequence[Layer]) -> float:
    return sum(layer.sigma_t_prime * layer.thickness for layer in layers)


def _rays(eta: float) -> tuple[Array, Array, Array]:
    """Cosines of a hemisphere, weights, and what a face mirrors: beyond the critical cosine, and within."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    t, w = (x + 1) / 2, w / 2
    critical = np.sqrt(1 - 1 / eta**2)
    cosine, weight = critical + (1 - critical) * t**2, (1 - critical) * 2 * t * w
    outside = np.sqrt(1 - (1 - cosine**2) * eta**2)
    mirror = np.append(np.ones(NODES), fresnel(outside, eta))
    return np.append(critical * t, cosine), np.append(critical * w, weight), mirror
