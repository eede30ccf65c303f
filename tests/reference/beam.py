"""The collimated light inside a stack, which feeds the diffusion-like references."""

from collections.abc import Callable, Sequence

import numpy as np

from reference.boundary import Array, fresnel
from reference.layers import Layer

Beam = Callable[[float], float]


def beams(layers: Sequence[Layer], cosine: float) -> list[tuple[float, Beam]]:
    """Per layer: extinction along the depth, σt'/μ [1/mm], and the light at a depth [mm] in it, over μ.

    A free bottom mirrors the beam by Fresnel's law, and the top mirrors what comes back, and so on: the
    geometric series 1 / (1 - F_top F_bottom e^-2τ). `cosine`: in the first layer; refracted in the others.
    Reflections at inner interfaces (1 % from 1.5 to 1.2) are left out.
    """
    sine = np.sqrt(1 - cosine**2) * layers[0].eta  # of the refracted direction outside; kept by Snell's law
    inside = [float(np.sqrt(1 - (sine / layer.eta) ** 2)) for layer in layers]
    rates = [layer.sigma_t_prime / mu for layer, mu in zip(layers, inside)]
    depths = np.cumsum([0.0, *(rate * layer.thickness for rate, layer in zip(rates, layers))])
    outside = float(np.sqrt(max(1 - sine**2, 0)))
    top, bottom = (float(fresnel(outside, layers[k].eta)) for k in (0, -1))
    gain = 1 / (1 - top * bottom * np.exp(-2 * depths[-1]))

    def light(rate: float, above: float, mu: float) -> Beam:
        def at(z: float) -> float:
            down = above + rate * z
            return gain / mu * (np.exp(-down) + bottom * np.exp(down - 2 * depths[-1]))

        return at

    return [(rate, light(rate, above, mu)) for rate, above, mu in zip(rates, depths, inside)]


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
    if np.isinf(layers[-1].thickness):
        return 0.0, 0.0
    R, T = 0.0, 0.0
    for cosine, share in zip(*entered(layers[0].eta, incidence)):
        sine = np.sqrt(1 - cosine**2) * layers[0].eta
        outside = float(np.sqrt(max(1 - sine**2, 0)))
        top, bottom = (float(fresnel(outside, layers[k].eta)) for k in (0, -1))
        last = layers[-1]
        mu = np.sqrt(1 - (sine / last.eta) ** 2)
        _, beam = beams(layers, float(cosine))[-1]
        at_bottom = beam(last.thickness) * mu / (1 + bottom)  # of beam down + mirrored, the part going down
        through = np.exp(
            -sum(rate * l.thickness for (rate, _), l in zip(beams(layers, float(cosine)), layers))
        )
        T += share * at_bottom * (1 - bottom)
        R += share * at_bottom * bottom * through * (1 - top)
    return R, T
