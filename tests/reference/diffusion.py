"""N-layer diffusion by collocation: the twin of `layered-diffusion`.

Per layer, at lateral frequency s, with t(z) the collimated light of `beam`, which bounces between the faces,

    -D φ'' + (σa + D s²) φ = σs' t(z)

    top              φ = 2 A D φ'
    between layers   φ / eta² and D φ' continuous
    bottom           φ = -2 A D φ'

and R̂ = φ(0) / 2A, T̂ = φ(bottom) / 2A: the flux out, since nothing comes in.
Sources: Jensen et al. 2001 (boundary), Aronson 1995 (change of index), d'Eon & Irving 2011 (Grosjean's D).
"""

from collections.abc import Sequence

import numpy as np

from reference.beam import Light, beams
from reference.boundary import Array, impedance
from reference.collocation import Region, solve
from reference.layers import Layer, check_stack


def diffusion_coefficient(layer: Layer, classical: bool = False) -> float:
    """D [mm]: Grosjean's (2 σa + σs') / 3 σt'², or the classical 1 / 3 σt'."""
    if classical:
        return 1 / (3 * layer.sigma_t_prime)
    return (2 * layer.sigma_a + layer.sigma_s_prime) / (3 * layer.sigma_t_prime**2)


def hankel(
    layers: Sequence[Layer], s: Array, classical: bool = False, cosine: float = 1.0
) -> tuple[Array, Array]:
    """R̂(s) and T̂(s), without ballistic light, (S,) each.

    cosine: of the entering beam inside the first layer.
    """
    check_stack(layers)
    A_top, A_bottom = impedance(layers[0].eta), impedance(layers[-1].eta)
    infinite = np.isinf(layers[-1].thickness)
    R, T = [], []
    for frequency in np.atleast_1d(s):
        regions = []
        for layer, light in zip(layers, beams(layers, cosine)):
            D = diffusion_coefficient(layer, classical)
            M = np.array([[layer.sigma_a + D * frequency**2]])

            def source(z: float, layer: Layer = layer, light: Light = light) -> Array:
                return np.array([layer.sigma_s_prime * light.both(z)])

            regions.append(Region(np.array([D]), M, source, light.rate, layer.thickness, layer.eta**2))
        # φ = 2 A D φ'  ⇔  D φ' = φ / 2A
        bottom = None if infinite else np.array([1 / (2 * A_bottom)])
        upper, lower = solve(regions, np.array([1 / (2 * A_top)]), bottom)
        R.append(upper[0] / (2 * A_top))
        T.append(lower[0] / (2 * A_bottom))
    return np.array(R), np.array(T)
