"""Diffusion through N layers in closed form, per row and Hankel frequency: `layered-diffusion`.

The diffusion equation is solved for the whole stack at once, with u = φ / eta² and the flux
eta² D u' continuous across interfaces. The light enters as an exponential source σs' e^-τ(z) through
all layers, not as a point in the first. What the boundary receives of a source at some depth is the
solution that satisfies the conditions on the far side, scaled to 1 at the boundary.
Source: the boundary-value problem of Donner & Jensen 2005, solved without poles; D of d'Eon & Irving 2011.
"""

from typing import NamedTuple, no_type_check

import torch

from texsss.media import fresnel
from texsss.media.stack import LayerTable
from texsss.numerics.compiled import constant
from texsss.profiles.blocks import Solver, solved
from texsss.profiles.modes import Ray, crossed, ray_of, received
from texsss.profiles.slab import TINY, Directions, from_side, light_in
from texsss.types import Float, Tensor


class Diffusive(NamedTuple):
    """One layer, whatever the frequency, (N,) each."""

    flux: Tensor  # eta² D [mm]
    rate: Tensor  # κ² - s² [1/mm²]
    d: Tensor | None
    rays: tuple[Ray, ...]


class Prepared(NamedTuple):
    """A stack seen from one side, whatever the frequency: layers from the near to the far face."""

    layers: tuple[Diffusive, ...]
    near: Tensor  # admittances of the outer surfaces
    far: Tensor


def profile(
    table: LayerTable, s: Float[Tensor, " S"], directions: Directions, *, side: str, compiled: bool = False
) -> Float[Tensor, "S N"]:
    """R̂ or T̂ (`side`) of light that entered in `directions`, per row and channel, flattened to N.

    `s` [1/mm]; 0 below a stack without a bottom. Differentiable in `table` and `s`.
    """
    return solved(table, s, Solver(prepare, (directions, side), spectrum, side), compiled)


@no_type_check
def prepare(layers, directions, side):
    """All of R̂ or T̂ (`side`) that does not depend on the frequency."""
    ends = [layers[k].sigma.new_full((), _boundary(layers[k].eta)) for k in (0, -1)]
    lights = light_in(layers, directions)
    if side == "transmittance":  # the stack seen from below
        ends = ends[::-1]
    layers, lights = from_side(side, layers, lights)
    prepared = []
    for layer, beams in zip(layers, lights):
        D = (2 - layer.sigma_s / layer.sigma) / (3 * layer.sigma)
        rays = tuple(ray_of(light, layer.d) for light in beams)
        prepared.append(Diffusive(D * layer.eta**2, layer.sigma_a / D + TINY, layer.d, rays))
    return Prepared(tuple(prepared), *ends)


@no_type_check
def spectrum(prepared, s):
    """R̂ or T̂ per frequency, row and channel (S, N); `s`: frequencies (S, 1)."""
    s2 = s * s
    response, admittance, whole = None, prepared.far, None  # the first two over the third
    # upwards: the admittance of all below, and what the top of each layer receives from there
    for layer in reversed(prepared.layers):
        squared = s2 + layer.rate
        if layer.d is None:
            kappa = torch.sqrt(squared)
            response, admittance = received(layer.rays, kappa), layer.flux * kappa
            continue
        G = admittance / layer.flux
        if whole is not None:
            G, response = G / whole, response / whole
        response, admittance, whole = crossed(squared, layer.d, layer.rays, response, G)
        admittance = layer.flux * admittance
    if whole is None:
        return response / (1 + admittance / prepared.near)
    return response / (whole + admittance / prepared.near)


@constant
def _boundary(eta: float) -> float:
    """Admittance of the outer surface, eta² / (2 A)."""
    return eta**2 / (2 * fresnel.A(eta))
