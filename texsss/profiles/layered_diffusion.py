"""Diffusion through N layers in closed form, per row and Hankel frequency: `layered-diffusion`.

The diffusion equation is solved for the whole stack at once, with u = φ / eta² and the flux
eta² D u' continuous across interfaces. The light enters as an exponential source σs' e^-τ(z) through
all layers, not as a point in the first. What the boundary receives of a source at some depth is the
solution that satisfies the conditions on the far side, scaled to 1 at the boundary.
Source: the boundary-value problem of Donner & Jensen 2005, solved without poles; D of d'Eon & Irving 2011.
"""

from functools import lru_cache

import torch

from texsss.media import fresnel
from texsss.media.stack import LayerTable
from texsss.profiles.slab import TINY, Coefficients, Directions, Mode, layers_of, light_in
from texsss.types import Float, Tensor


def reflectance(table: LayerTable, s: Float[Tensor, " S"], directions: Directions) -> Float[Tensor, "S N"]:
    """R̂(s) of light that entered in `directions`, per row and channel, flattened to N.

    `s` [1/mm]. Differentiable in `table` and `s`.
    """
    layers = layers_of(table)
    top, far = _boundary(table.eta[0]), s.new_tensor(_boundary(table.eta[-1]))
    s2 = s[:, None] ** 2
    response = s.new_zeros(())
    # upwards: the admittance of all below, and what the top of each layer receives from there
    for layer, lights in zip(reversed(layers), reversed(light_in(layers, directions)), strict=True):
        flux, squared = _flux_and_decay(layer, s2)
        kappa = torch.sqrt(squared)
        if layer.d is None:
            response = sum(light.source * light.down / (light.sigma + kappa) for light in lights)
            far = flux * kappa
            continue
        mode = Mode(kappa, squared, layer.d)
        near, lower = mode.lit(lights)
        passed = mode.sech / (1 + far / flux * mode.th)
        response = near + passed * (lower + response)
        far = flux * squared * mode.th + mode.sech * passed * far
    return top / (top + far) * response


def transmittance(table: LayerTable, s: Float[Tensor, " S"], directions: Directions) -> Float[Tensor, "S N"]:
    """T̂(s) of scattered light below the stack, like `reflectance`; 0 without a bottom."""
    layers = layers_of(table)
    if table.bottomless:
        return s.new_zeros(s.shape[0], layers[0].sigma_a.shape[0])
    bottom, near = _boundary(table.eta[-1]), s.new_tensor(_boundary(table.eta[0]))
    s2 = s[:, None] ** 2
    response = s.new_zeros(())
    # downwards: the same, seen from the lower face
    for layer, lights in zip(layers, light_in(layers, directions), strict=True):
        flux, squared = _flux_and_decay(layer, s2)
        assert layer.d is not None
        mode = Mode(torch.sqrt(squared), squared, layer.d)
        upper, far = mode.lit(lights)
        passed = mode.sech / (1 + near / flux * mode.th)
        response = far + passed * (upper + response)
        near = flux * squared * mode.th + mode.sech * passed * near
    return bottom / (bottom + near) * response


@lru_cache(maxsize=256)
def _boundary(eta: float) -> float:
    """Admittance of the outer surface, eta² / (2 A)."""
    return eta**2 / (2 * fresnel.A(eta))


def _flux_and_decay(layer: Coefficients, s2: Tensor) -> tuple[Tensor, Tensor]:
    """eta² D [mm] and κ(s)² [1/mm²]."""
    D = (2 - layer.sigma_s / layer.sigma) / (3 * layer.sigma)
    return D * layer.eta**2, s2 + (layer.sigma_a / D + TINY)
