"""The collimated light inside a stack, which feeds the diffusion-like references."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from reference.boundary import Array, fresnel
from reference.layers import Layer


class Light(NamedTuple):
    """Collimated light in one layer, over its cosine: strengths at a depth [mm] in the layer."""

    cosine: float
    rate: float  # extinction along the depth, σt'/μ [1/mm]
    down: Callable[[float], float]
    up: Callable[[float], float]

    def both(self, z: float) -> float:
        return self.down(z) + self.up(z)


def beams(layers: Sequence[Layer], cosine: float) -> list[Light]:
    """The light in every layer.

    A free bottom mirrors the beam by Fresnel's law, and the top mirrors what comes back, and so on: the
    geometric series 1 / (1 - F_top F_bottom e^-2τ). `cosine`: in the first layer; refracted in the others.
    Reflections at inner interfaces (1 % from 1.5 to 1.2) are left out.
    """
    sine = np.sqrt(1 - cosine**2) * layers[0].eta  # of the refracted direction outside; kept by Snell's law
    inside = [float(np.sqrt(1 - (sine / layer.eta) ** 2)) for layer in layers]
    rates = [layer.sigma_t_prime / mu for layer, mu in zip(layers, inside)]
    depths = np.cumsum([0.0, *(rate * layer.thickness for rate, layer in zip(rates, layers))])
    top, bottom = faces(layers, cosine)
    gain = 1 / (1 - top * bottom * np.exp(-2 * depths[-1]))

    def light(rate: float, above: float, mu: float) -> Light:
        def down(z: float) -> float:
            return gain / mu * np.exp(-above - rate * z)

        def up(z: float) -> float:
            return gain / mu * bottom * np.exp(above + rate * z - 2 * depths[-1])

        return Light(mu, rate, down, up)

    return [light(rate, above, mu) for rate, above, mu in zip(rates, depths, inside)]


def faces(layers: Sequence[Layer], cosine: float) -> tuple[float, float]:
    """What the top and the bottom mirror of light at `cosine` in the first layer."""
    outside = float(np.sqrt(max(1 - (1 - cosine**2) * layers[0].eta ** 2, 0)))
    return float(fresnel(outside, layers[0].eta)), float(fresnel(outside, layers[-1].eta))


def entered(eta: float, incidence: str | float, nodes: int = 64) -> tuple[Array, Array]:
    """Cosines just inside and their shares of the entered light, which sum to 1; (N,) each."""
    if incidence == "normal":
        return np.ones(1), np.ones(1)
    if incidence == "diffuse":  # μ = t² removes the corner of F at grazing
        t, w = np.polynomial.legendre.leggauss(nodes)
        outside = ((t + 1) / 2) ** 2
        share = w * (t + 1) * outside * (1 - fresnel(outside, eta))
    else:
        outside, share = np.array([np.cos(float(incidence))]), np.ones(1)
    return np.sqrt(1 - (1 - outside**2) / eta**2), share / share.sum()


def ballistic(layers: Sequence[Layer], incidence: str | float) -> tuple[float, float]:
    """Unscattered light that leaves by the top and by the bottom, per unit of entered light.

    In reduced coefficients: what a model that reduces them leaves to the beam.
    """
    R, T = 0.0, 0.0
    for cosine, share in zip(*entered(layers[0].eta, incidence)):
        above, below = unscattered(layers, float(cosine))
        R, T = R + share * above, T + share * below
    return R, T


def unscattered(layers: Sequence[Layer], cosine: float) -> tuple[float, float]:
    """The same of a beam at `cosine` inside the first layer."""
    if np.isinf(layers[-1].thickness):
        return 0.0, 0.0
    lights, (top, bottom) = beams(layers, cosine), faces(layers, cosine)
    T = lights[-1].down(layers[-1].thickness) * lights[-1].cosine * (1 - bottom)
    return lights[0].up(0.0) * lights[0].cosine * (1 - top), T
