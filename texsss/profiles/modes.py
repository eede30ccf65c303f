"""One layer, one decaying mode: everything that solving a stack asks of it, per row and frequency.

In a layer of thickness d a mode obeys v'' = λ² v, so that it is fixed by its values at both faces,

    v(z) = P(z) v(0) + Q(z) v(d),   P = sinh λ(d - z) / sinh λd,   Q = sinh λz / sinh λd,

and its admittance -v'/v goes from G at the far face to λ² th + sech² G / (1 + G th) at the near one.
The light enters as e^-σz. Only e^-λd is exponentiated: nothing overflows. What cancels where λd or
(λ - σ)d is small is replaced by its limit there, to a few units of the precision's last third.

This is where all the time goes. A pass over memory costs more than an arithmetic operation, so every
pass counts; torch.compile makes one loop of it all, and cannot see through shape annotations.
"""

from typing import NamedTuple, no_type_check

import torch

from texsss.profiles.slab import FAR, TINY
from texsss.types import Tensor


class Ray(NamedTuple):
    """Light that scatters in one layer, in what its integrals need, (N,) each."""

    sigma: Tensor  # extinction per depth; times the thickness, where there is one
    beam: Tensor | None  # e^-σd
    down: Tensor  # scattered per depth [1/mm]; over the whole thickness, where there is one
    up: Tensor | None  # the same of light that the bottom mirrors; None where nothing mirrors


@no_type_check
def ray_of(light, d):
    """What the integrals over a layer of thickness `d` need of a light."""
    if d is None:
        return Ray(light.sigma, None, light.source * light.down, None)
    strength = light.source * d
    up = None if light.up is None else strength * light.up
    return Ray((light.sigma * d).clamp_min(TINY), light.beam, strength * light.down, up)


@no_type_check
def decayed(squared, d):
    """e^-λd and -λd of the mode of λ² = `squared` (S, N) across a layer of thickness `d` (N,)."""
    # below the least λd nothing changes but rounding; beyond FAR denormal numbers take ten times longer
    least = 1.8 * torch.finfo(squared.dtype).eps ** 0.4
    minus = torch.clamp(torch.sqrt(squared) * -d, max=-least)
    return torch.exp(torch.clamp(minus, min=-FAR)), minus


@no_type_check
def lit(E, minus, rays):
    """∫ e^-λz and ∫ e^-λ(d - z) over the layer with the source of all `rays`."""
    first = second = None
    for ray in rays:
        together = (1 - ray.beam * E) / (ray.sigma - minus)
        against = overlap(E, ray.beam, minus + ray.sigma)
        first, second = _plus(first, ray.down, together), _plus(second, ray.down, against)
        if ray.up is not None:
            first, second = _plus(first, ray.up, against), _plus(second, ray.up, together)
    return first, second


@no_type_check
def overlap(E, beam, apart):
    """∫ e^(-σz) e^(-λ(d - z)) dz / d by E = e^-λd, `beam` = e^-σd and `apart` = (σ - λ) d.

    A quotient of differences that blends, by fourth powers, into the trapezoidal rule where both vanish.
    """
    few = torch.finfo(E.dtype).eps ** 1.2
    squared = apart * apart
    fourth = torch.addcmul(torch.full((), few, dtype=E.dtype, device=E.device), squared, squared)
    return torch.addcmul(few * E, E - beam, apart * squared - few / 2) / fourth


@no_type_check
def received(rays, decay):
    """∫ e^-λz over a half-space with the source of all `rays`; `decay` is λ."""
    total = None
    for ray in rays:
        here = ray.down / (ray.sigma + decay)
        total = here if total is None else total + here
    return total


@no_type_check
def crossed(squared, d, rays, response, G):
    """What reaches the near face of a layer, and the admittance there, both times the third result.

    That is its own light and `response`, what reaches the far face (None: nothing). `G`: admittance
    below, over the layer's own diffusion coefficient, which the result is over, too.
    """
    E, minus = decayed(squared, d)
    first, second = lit(E, minus, rays)
    E2 = E * E
    g = (G * d) / minus  # G / λ, negative
    above, below = 1 - g, 1 + g
    reached = torch.addcmul(above * first, below, E * second)
    if response is not None:
        reached = torch.addcmul(reached, E, response, value=2)
    # λ (1 - E²) by λ², which may be below the least
    admittance = torch.addcmul(G * (1 + E2), squared * d / minus, E2 - 1)
    return reached, admittance, torch.addcmul(above, below, E2)


@no_type_check
def _plus(total, a, b):
    """total + a b"""
    return a * b if total is None else torch.addcmul(total, a, b)
