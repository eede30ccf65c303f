"""Layers flattened to rows, and the collimated light in them: what profiles hold at every frequency.

Layers are annotated in words only: on small tables, checks of shapes would take longer than the work.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple, no_type_check

import torch

from texsss.media import fresnel
from texsss.media.stack import LayerTable
from texsss.profiles.incidence import finer
from texsss.types import Tensor

CLEAR = 1e-6  # a layer extinguishes at least this [1/mm], so that a clear one has a finite D
FAR = 40.0  # e^-x beyond is nothing: products of what is left are no denormal numbers
DEEP = 1e5  # optical depth from which layers are equal: in white ones 1e-5 of the light comes through
# Where derivatives are asked for, those at 0 are of a layer that is hardly there ...
FAINT = 1e-9  # and scatters this much [1/mm]
ABSENT = 1e-10  # of this optical depth, or [mm]: derivatives by a thickness of THIN are rounding errors
THIN = 1e-15  # [mm] that every layer is thicker, so that an absent one has an admittance
TINY = 1e-24  # keeps the derivative of √ finite where nothing is absorbed and s = 0

Directions = Sequence[tuple[float, float]]
"""Where the light comes from: cosines inside the first layer, and their shares."""


class Coefficients(NamedTuple):
    """One layer of a table, (1, N): N channels and rows, flattened; `d` is None for a half-space."""

    sigma_a: Tensor
    sigma_s: Tensor  # reduced [1/mm]
    sigma: Tensor  # reduced extinction, CLEAR at least
    g: Tensor
    d: Tensor | None
    eta: float


class Light(NamedTuple):
    """Collimated light in one layer: e^(-σz) from above, and what its bottom mirrors back up."""

    cosine: float  # to the normal, inside this layer
    share: Tensor | float  # of the light that comes from this direction
    sigma: Tensor  # extinction per depth
    source: Tensor  # scattering per depth, times the share of this direction
    beam: Tensor | None  # e^(-σd) through this layer; None through a half-space
    down: Tensor  # beam at the top of the layer, its bounces included
    up: Tensor | None  # mirrored beam at the bottom of the layer; None where nothing mirrors


def layers_of(table: LayerTable, reduced: bool = True) -> list[Coefficients]:
    """The layers of a table from the surface inwards; with the true coefficients unless `reduced`.

    Differentiable, also at 0. Where a layer neither absorbs nor scatters, derivatives are those at which it
    scatters a little; one that absorbs a little has others by sigma_a in slabs, and by the diffusion models.
    """
    count, channels = len(table.eta), table.channels
    # one copy per field, in the order in which it will be read
    fields = [x.reshape(-1, count * channels).t().contiguous().view(count, 1, -1) for x in table.fields]
    isotropic = table.known_isotropic
    layers = []
    for k, (sigma_a, sigma_s, g, d) in enumerate(zip(*fields, strict=True)):
        if reduced and not isotropic:
            sigma_s = sigma_s * (1 - g)
        endless, least = table.bottomless and k == count - 1, CLEAR
        if table.requires_grad and not endless:
            least = FAINT
            sigma_s = sigma_s + (least - sigma_a - sigma_s).clamp_min(0).detach()
            d = d + ABSENT / (1 + sigma_a + sigma_s).detach()
        sigma = (sigma_a + sigma_s).clamp_min(least)
        # beyond it squares would overflow
        d = None if endless else torch.minimum(d, DEEP / sigma)
        layers.append(Coefficients(sigma_a, sigma_s, sigma, g, d, table.eta[k]))
    return layers


@no_type_check
def from_side(side, layers, lights):
    """A stack and the lights in it, from the side where they are looked at."""
    if side == "reflectance":
        return layers, lights
    return layers[::-1], flipped(lights)


@no_type_check
def flipped(lights):
    """The lights of all layers seen from below."""
    return [[light._replace(down=light.up, up=light.down) for light in beams] for beams in reversed(lights)]


@no_type_check
def light_in(layers, directions, mirrored=True):
    """The collimated light in every layer, by direction, per unit that entered in all of them.

    It refracts where the index changes. A free bottom mirrors it, unless told, and the top again, as long as
    it lasts; reflections at inner interfaces (1 % from 1.5 to 1.2) are left out. A few directions lose as
    much between mirrors as many do, of which the grazing ones are mirrored again and again.
    """
    more, fine = 1.0, finer(directions, [layer.eta for layer in layers])
    if mirrored and layers[-1].d is not None and fine is not directions:
        more = (_lost(layers, fine) + THIN) / (_lost(layers, directions) + THIN)
    each = [_light_from(layers, cosine, share * more, mirrored) for cosine, share in directions]
    return [list(lights) for lights in zip(*each, strict=True)]


@no_type_check
def _light_from(layers, cosine, share, mirrored=True):
    cosines = [refracted(cosine, layers[0].eta, layer.eta) for layer in layers]
    sigma = [layer.sigma / c for layer, c in zip(layers, cosines, strict=True)]
    depth = [None if layer.d is None else s * layer.d for s, layer in zip(sigma, layers, strict=True)]
    above, down = torch.zeros_like(sigma[0]), []
    for tau in depth:
        down.append(torch.exp(-above.clamp_max(FAR)))
        above = above if tau is None else above + tau
    up = [None] * len(layers)
    if mirrored and layers[-1].d is not None:
        top, bottom = mirrors([layer.eta for layer in layers], cosine)
        through = torch.exp(-above.clamp_max(FAR))
        gain = 1 / (1 - top * bottom * through**2)
        below = torch.zeros_like(above)
        for k in reversed(range(len(layers))):
            up[k] = gain * bottom * through * torch.exp(-below.clamp_max(FAR))
            tau = depth[k]
            below = below + tau
        down = [t * gain for t in down]
    return [
        Light(
            cosine=c,
            share=share,
            sigma=s,
            source=share / c * layer.sigma_s,
            beam=None if tau is None else torch.exp(-tau.clamp_max(FAR)),
            down=t,
            up=u,
        )
        for c, s, layer, tau, t, u in zip(cosines, sigma, layers, depth, down, up, strict=True)
    ]


def mirrors(etas: Sequence[float], cosine: float) -> tuple[float, float]:
    """Fresnel reflectance of the first and of the last face for light at `cosine` in the first layer."""
    outside = refracted(cosine, etas[0], 1.0)
    return _mirror(outside, etas[0]), _mirror(outside, etas[-1])


@cache
def _mirror(outside: float, eta: float) -> float:
    return fresnel.reflectance(outside, eta)


@no_type_check
def extinguished(layers, directions):
    """Share of the light that does not leave unscattered by the top or the bottom, (1, N).

    In reduced coefficients, which is how the profiles count: R̂(0) + T̂(0) + absorption is this.
    """
    if layers[-1].d is None:
        return torch.ones_like(layers[0].sigma)
    return _lost(layers, finer(directions, [layer.eta for layer in layers]))


@no_type_check
def _lost(layers, directions):
    shares = []
    for cosine, share in directions:
        top, bottom = mirrors([layer.eta for layer in layers], cosine)
        tau = crossed(layers, cosine)
        through = torch.exp(-tau)
        gain = share / (1 - top * bottom * through**2)
        shares.append(gain * -torch.expm1(-tau) * (1 + bottom * through))
    return added(shares)


@no_type_check
def crossed(layers, cosine):
    """Optical depth of all layers, of a finite last one, along a ray at `cosine` in the first; (1, N)."""
    slant = [layer.sigma * layer.d / refracted(cosine, layers[0].eta, layer.eta) for layer in layers]
    return added(slant).clamp_max(FAR)


@no_type_check
def refracted(cosine, here, there):
    """Cosine at index `there` of light at `cosine` in one of index `here`; 0 if it cannot pass."""
    return max(1 - (1 - cosine**2) * (here / there) ** 2, 0.0) ** 0.5


@no_type_check
def added(terms):
    """The sum of at least one tensor."""
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total
