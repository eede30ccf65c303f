"""The multipole of one slab at a distance, pole by pole: the twin of `multipole`, which has its transform.

z_i = 2i (d + 2 z_b) + l and z_i - 2l - 2 z_b are depths of sources and of sinks, l = 1 / σt', z_b = 2 A D
with D = l / 3 and Egan's A; each sends z (1 + σ ρ) e^(-σ ρ) / 4π ρ³ to the top, ρ² = r² + z², and the same
with d - z in place of z to the bottom. Source: Donner & Jensen 2005.
"""

import numpy as np

from reference.boundary import Array
from reference.layers import Layer


def at_distance(layer: Layer, r: Array, pairs: int = 20) -> tuple[Array, Array]:
    """R(r) and T(r) of a slab [1/mm²], (R,) each; eta of the layer above 1."""
    l, eta = 1 / layer.sigma_t_prime, layer.eta
    mirrored = -1.4399 / eta**2 + 0.7099 / eta + 0.6681 + 0.0636 * eta
    z_b = 2 * (1 + mirrored) / (1 - mirrored) * l / 3
    sigma = np.sqrt(3 * layer.sigma_a * layer.sigma_t_prime)

    def sent(z: float) -> Array:
        path = np.hypot(r, z)
        return z * (1 + sigma * path) * np.exp(-sigma * path) / (4 * np.pi * path**3)

    R, T = np.zeros_like(r), np.zeros_like(r)
    for i in range(-pairs, pairs + 1):
        source = 2 * i * (layer.thickness + 2 * z_b) + l
        sink = source - 2 * l - 2 * z_b
        R += layer.albedo_prime * (sent(source) - sent(sink))
        T += layer.albedo_prime * (sent(layer.thickness - source) - sent(layer.thickness - sink))
    return R, T
