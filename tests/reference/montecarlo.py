"""Photons through a plane-parallel stack, one at a time, with error bars.

A photon starts just inside the top face, already refracted: every figure is per unit of light that entered.
It flies exponential distances, is reflected or refracted by Fresnel's law at the faces and wherever eta
changes, carries its chance of survival as a weight (albedo per scattering) and plays Russian roulette when
that is small. It leaves at most once; per-photon scores are independent, so their sample variance is the
error bar.

Light is counted by its order of scattering: 0 ballistic, 1 single, 2 and more multiple.
`R` and `T` mean scattered light (all orders from 1 on), by the top and by the bottom.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log, pi, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import j0

from reference.boundary import Array, diffuse_entry, fresnel
from reference.layers import Layer, check_stack

ROULETTE_BELOW = (
    0.05  # weight at which a photon survives with chance ROULETTE_CHANCE, and is 1/ROULETTE_CHANCE heavier
)
ROULETTE_CHANCE = 0.2
LOST, TOP, BOTTOM = 0, 1, 2


@dataclass(frozen=True)
class Estimate:
    """A mean and its standard error."""

    mean: Array
    error: Array

    def agrees_with(self, value: Array | float, sigmas: float = 4, slack: float = 0) -> bool:
        """Whether `value` lies within `sigmas` standard errors plus `slack`, everywhere."""
        return bool(np.all(np.abs(value - self.mean) <= sigmas * self.error + slack))


@dataclass(frozen=True)
class Photons:
    """How each of the launched photons ended."""

    side: NDArray[np.int8]  # LOST (absorbed), TOP or BOTTOM
    order: NDArray[np.int32]  # number of scatterings, up to the end
    radius: Array  # [mm] from entry to exit, along the surface
    weight: Array

    def score(self, side: int, orders: str, f: Callable[[Array], Array] = np.ones_like) -> Estimate:
        """Mean of weight × f(radius) over all launched photons, of those that left by `side` with `orders`.

        `f` maps (N,) radii to (N,) or (..., N); orders: ballistic, single, multiple or scattered.
        """
        chosen = self.side == side
        chosen &= {
            "ballistic": self.order == 0,
            "single": self.order == 1,
            "multiple": self.order >= 2,
            "scattered": self.order >= 1,
        }[orders]
        launched = len(self.side)
        radius, weight = self.radius[chosen], self.weight[chosen]
        total = np.zeros(np.shape(f(np.zeros(1)))[:-1])
        square = np.zeros_like(total)
        for start in range(0, len(radius), 1 << 16):  # (..., N) would not fit at once
            part = slice(start, start + (1 << 16))
            scores = weight[part] * f(radius[part])
            total += scores.sum(-1)
            square += (scores**2).sum(-1)
        mean = total / launched
        return Estimate(mean, np.sqrt(np.maximum(square / launched - mean**2, 0) / launched))

    def hankel(self, side: int, orders: str, s: Array) -> Estimate:
        """R̂(s) or T̂(s), estimated directly as the mean of weight × J0(s r)."""
        return self.score(side, orders, lambda r: j0(np.asarray(s)[:, None] * r))

    def histogram(self, side: int, orders: str, edges: Array) -> Estimate:
        """R(r) or T(r) [1/mm²], averaged over the annuli between `edges` [mm]."""
        area = pi * np.diff(edges**2)

        def inside(r: Array) -> Array:
            return ((r >= edges[:-1, None]) & (r < edges[1:, None])) / area[:, None]

        return self.score(side, orders, inside)

    @cached_property
    def totals(self) -> dict[str, Estimate]:
        """R, R1, R_ballistic and the same for T."""
        return {
            name + suffix: self.score(side, orders)
            for name, side in (("R", TOP), ("T", BOTTOM))
            for suffix, orders in (("", "scattered"), ("1", "single"), ("_ballistic", "ballistic"))
        }


def trace(layers: Sequence[Layer], photons: int, seed: int, incidence: str | float = "normal") -> Photons:
    """The ends of `photons` photons under a pencil beam.

    incidence: "normal", "diffuse" (Lambertian outside, what entered of it), or the outside angle [rad].
    """
    check_stack(layers)
    table = np.array([[l.sigma_a, l.sigma_s, l.thickness, l.g, l.eta] for l in layers], dtype=float)
    schlick = np.array([l.phase == "schlick" for l in layers])
    cosine = _entry_cosines(layers[0].eta, photons, seed, incidence)
    return Photons(*_trace(table, schlick, cosine, np.random.default_rng([seed, 0])))


def _entry_cosines(eta: float, photons: int, seed: int, incidence: str | float) -> Array:
    """Cosines inside, just after entry."""
    if incidence == "normal":
        return np.ones(photons)
    if incidence == "diffuse":
        generator = np.random.default_rng([seed, 1])
        outside = np.empty(0)
        while len(outside) < photons:  # Lambertian flux, of which 1 - F enters
            mu = np.sqrt(generator.random(int(1.1 * photons / diffuse_entry(eta)) + 16))
            outside = np.append(outside, mu[generator.random(len(mu)) >= fresnel(mu, eta)])
        outside = outside[:photons]
    else:
        outside = np.full(photons, np.cos(float(incidence)))
    return np.sqrt(1 - (1 - outside**2) / eta**2)


@njit(cache=True)
def _fresnel(mu: float, eta: float) -> tuple[float, float]:
    """Reflectance and refracted cosine for light at cosine mu into relative index eta."""
    sin2 = (1 - mu * mu) / (eta * eta)
    if sin2 >= 1:
        return 1.0, 0.0
    cos_t = sqrt(1 - sin2)
    perpendicular = (mu - eta * cos_t) / (mu + eta * cos_t)
    parallel = (eta * mu - cos_t) / (eta * mu + cos_t)
    return (perpendicular * perpendicular + parallel * parallel) / 2, cos_t


@njit(cache=True)
def _deflection(rng: np.random.Generator, g: float, schlick: bool) -> float:
    """Cosine of a random deflection; both phase functions by inversion of their cumulative distribution."""
    xi = rng.random()
    if g == 0:
        return 2 * xi - 1
    if schlick:
        return (2 * xi - 1 + g) / (1 - g + 2 * g * xi)
    q = (1 - g * g) / (1 - g + 2 * g * xi)
    return (1 + g * g - q * q) / (2 * g)


@njit(cache=True)
def _turned(
    rng: np.random.Generator, ux: float, uy: float, uz: float, cos: float
) -> tuple[float, float, float]:
    """The unit direction u turned by the angle of cosine `cos` about a random azimuth."""
    sin = sqrt(max(1 - cos * cos, 0.0))
    azimuth = 2 * pi * rng.random()
    a, b = sin * np.cos(azimuth), sin * np.sin(azimuth)
    # frame of Duff et al. 2017, free of poles
    sign = 1.0 if uz >= 0 else -1.0
    p = -1 / (sign + uz)
    q = ux * uy * p
    vx = a * (1 + sign * ux * ux * p) + b * q + cos * ux
    vy = a * sign * q + b * (sign + uy * uy * p) + cos * uy
    vz = -a * sign * ux - b * uy + cos * uz
    norm = sqrt(vx * vx + vy * vy + vz * vz)
    return vx / norm, vy / norm, vz / norm


@njit(cache=True)
def _trace(
    table: Array, schlick: NDArray[np.bool_], cosine: Array, rng: np.random.Generator
) -> tuple[NDArray[np.int8], NDArray[np.int32], Array, Array]:
    """table (L, 5): sigma_a, sigma_s, thickness, g, eta; cosine (N,): just after entry."""
    n, last = len(cosine), len(table) - 1
    side, order = np.zeros(n, np.int8), np.zeros(n, np.int32)
    radius, weight = np.zeros(n), np.zeros(n)
    for i in range(n):
        x = y = z = 0.0  # z is the depth in the current layer
        ux, uy, uz = sqrt(1 - cosine[i] ** 2), 0.0, cosine[i]
        k, w, scatterings = 0, 1.0, 0
        depth = -log(1 - rng.random())  # optical depth to the next collision
        while True:
            sigma_t = table[k, 0] + table[k, 1]
            thickness = table[k, 2]
            to_face = np.inf
            if uz > 0:
                to_face = (thickness - z) / uz
            elif uz < 0:
                to_face = -z / uz
            if depth < sigma_t * to_face:  # collision inside the layer
                flight = depth / sigma_t
                x, y, z = x + flight * ux, y + flight * uy, z + flight * uz
                w *= table[k, 1] / sigma_t
                if w < ROULETTE_BELOW:
                    if rng.random() >= ROULETTE_CHANCE:
                        order[i] = scatterings + 1
                        break
                    w /= ROULETTE_CHANCE
                scatterings += 1
                ux, uy, uz = _turned(rng, ux, uy, uz, _deflection(rng, table[k, 3], schlick[k]))
                depth = -log(1 - rng.random())
                continue
            if to_face == np.inf:  # nothing left to meet
                break
            x, y = x + to_face * ux, y + to_face * uy
            depth -= sigma_t * to_face
            down = uz > 0
            nxt = k + 1 if down else k - 1
            outside = nxt < 0 or nxt > last
            eta = (1.0 if outside else table[nxt, 4]) / table[k, 4]
            if eta != 1:
                reflectance, cos_t = _fresnel(abs(uz), eta)
                if rng.random() < reflectance:
                    z, uz = thickness if down else 0.0, -uz
                    continue
                ux, uy, uz = ux / eta, uy / eta, cos_t if down else -cos_t
            if outside:
                side[i] = BOTTOM if down else TOP
                order[i], radius[i], weight[i] = scatterings, sqrt(x * x + y * y), w
                break
            k = nxt
            z = 0.0 if down else table[k, 2]
    return side, order, radius, weight
