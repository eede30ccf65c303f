"""Diffusion through N layers in closed form, per row and Hankel frequency: `layered-diffusion`.

The diffusion equation is solved for the whole stack at once, with u = φ / eta² and the flux
eta² D u' continuous across interfaces. The light enters as an exponential source σs' e^-τ(z) through
all layers, not as a point in the first. What the boundary receives of a source at some depth is the
solution that satisfies the conditions on the far side, scaled to 1 at the boundary.
Source: the boundary-value problem of Donner & Jensen 2005, solved without poles; D of d'Eon & Irving 2011.
"""

from functools import cache
from typing import NamedTuple, no_type_check

import torch

from texsss.media import fresnel
from texsss.media.stack import LayerTable
from texsss.profiles.blocks import Loops, Solver, solved
from texsss.profiles.modes import LEAST, Ray, Sheet, crossed, crossing, ray_of, received, sheet_of
from texsss.profiles.slab import TINY, Directions, from_side, light_in
from texsss.types import Float, Tensor


class Diffusive(NamedTuple):
    """One layer, whatever the frequency, (1, N) each."""

    rate: Tensor  # κ² - s² [1/mm²], times d² where the layer has a bottom
    sheet: Sheet | None  # None in a half-space
    rays: tuple[Ray, ...]
    into: Tensor  # from the admittance of what is below, or of the far face, to this layer's Gd


class Prepared(NamedTuple):
    """A stack seen from one side, whatever the frequency: layers from the near to the far face."""

    layers: tuple[Diffusive, ...]
    out: Tensor  # from the first layer's admittance to the share of light that it leaves to the inside


def profile(
    table: LayerTable,
    s: Float[Tensor, " S"],
    directions: Directions,
    *,
    side: str,
    loops: Loops | None = None,
) -> Float[Tensor, "S N"]:
    """R̂ or T̂ (`side`) of light that entered in `directions`, per row and channel, flattened to N.

    `s` [1/mm]; 0 below a stack without a bottom. Differentiable in `table` and `s`.
    """
    return solved(table, s, Solver(prepare, (directions, side), spectrum, side), loops)


@no_type_check
def prepare(layers, directions, side):
    """All of R̂ or T̂ (`side`) that does not depend on the frequency."""
    ends = [admittance(layers[k].eta) for k in (0, -1)]
    lights = light_in(layers, directions)
    if side == "transmittance":  # the stack seen from below
        ends = ends[::-1]
    layers, lights = from_side(side, layers, lights)
    prepared, below = [], ends[1]  # eta² D of the layer below, over its thickness, or the face's admittance
    for layer, beams in zip(reversed(layers), reversed(lights)):
        D = (2 - layer.sigma_s / layer.sigma) / (3 * layer.sigma)
        rate, flux = layer.sigma_a / D + TINY, D * layer.eta**2
        rays = tuple(ray_of(light, layer.d) for light in beams)
        if layer.d is None:
            prepared.append(Diffusive(rate, None, rays, rate))
            below = flux
            continue
        sheet = sheet_of(layer.d, rays)
        prepared.append(Diffusive(rate * sheet.d2 + LEAST, sheet, rays, below * sheet.d / flux))
        below = flux / sheet.d
    return Prepared(tuple(prepared[::-1]), below / ends[0])


@no_type_check
def spectrum(prepared, s):
    """R̂ or T̂ per frequency, row and channel (S, N); `s`: frequencies (S, 1)."""
    s2 = s * s
    response, admittance, whole = None, None, None  # the first two over the third
    # upwards: the admittance of all below, and what the top of each layer receives from there
    for layer in reversed(prepared.layers):
        if layer.sheet is None:
            admittance = (s2 + layer.rate).sqrt_()
            response = received(layer.rays, admittance)
            continue
        Gd = layer.into if admittance is None else layer.into * admittance
        if whole is not None:
            Gd, response = Gd / whole, response / whole
        squared = torch.addcmul(layer.rate, s2, layer.sheet.d2)
        mode = crossing(squared, layer.sheet)
        response, admittance, whole = crossed(mode, squared, layer.sheet, response, Gd)
    if whole is None:
        return response / (1 + admittance * prepared.out)
    return response / torch.addcmul(whole, admittance, prepared.out)


@cache
def admittance(eta: float) -> float:
    """Admittance of the outer surface, eta² / (2 A)."""
    return eta**2 / (2 * fresnel.A(eta))
