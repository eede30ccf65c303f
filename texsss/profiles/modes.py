"""One layer, one decaying mode: everything that solving a stack asks of it, per row and frequency.

In a layer of thickness d a mode obeys v'' = λ² v, so that it is fixed by its values at both faces,

    v(z) = P(z) v(0) + Q(z) v(d),   P = sinh λ(d - z) / sinh λd,   Q = sinh λz / sinh λd,

and by m = λd alone: with c = m coth m and k = m / sinh m, both even and 1 at 0, the slopes there are

    -v'(0) d = c v(0) - k v(d),     -v'(d) d = k v(0) - c v(d).

Where v leaves by the far face with an admittance -v'/v of G, that of the near face is then
(c Gd + m²) / (c + Gd) / d: nothing cancels. With e^-m and 1 - e^-m nothing overflows, and thin layers
keep their digits. The light enters as e^-σz; its quotient of differences, which vanish where (λ - σ)d does,
blends into its limit there.

This is where all the time goes. A pass over memory costs as much as an arithmetic operation, and e^-m, let
alone tanh m, as ten, so every pass counts; fused.cpp makes one loop of it all.
"""

from typing import NamedTuple, no_type_check

import torch

from texsss.profiles.slab import FAR, THIN
from texsss.types import Tensor

LEAST = 1e-30  # m²
SMALL = 1e-3  # m² below which series are exact


class Ray(NamedTuple):
    """Light that scatters in one layer, in what its integrals need, (1, N) each."""

    tau: Tensor  # extinction over the layer; per depth where it has no bottom
    beam: Tensor | None  # e^-τ
    down: Tensor  # scattered over the thickness; per depth [1/mm] where there is none
    up: Tensor | None  # the same of light that the bottom mirrors; None where nothing mirrors


class Sheet(NamedTuple):
    """A layer with a bottom, whatever mode crosses it."""

    d: Tensor  # [mm] (1, N)
    d2: Tensor
    aside: Tensor  # d² times the share of D by which light spreads along the layer
    rays: tuple[Ray, ...]
    one: Tensor  # numbers, as tensors: addcmul takes no others
    two: Tensor


class Crossing(NamedTuple):
    """A mode in a sheet (S, N)."""

    decay: Tensor  # e^-m
    m: Tensor
    c: Tensor  # m coth m
    h: Tensor  # ½ k = ½ m / sinh m


@no_type_check
def ray_of(light, d):
    """What the integrals over a layer of thickness `d` need of a light."""
    if d is None:
        return Ray(light.sigma, None, light.source * light.down, None)
    strength = light.source * d
    up = None if light.up is None else strength * light.up
    return Ray(light.sigma * d, light.beam, strength * light.down, up)


@no_type_check
def sheet_of(d, rays, aside=1.0):
    """A layer of thickness `d` (1, N) with the light in it, which spreads along it by `aside` of D."""
    d = d + THIN
    d2 = d * d
    return Sheet(d, d2, d2 * aside, rays, d.new_full((), 1.0), d.new_full((), 2.0))


@no_type_check
def crossing(squared, sheet):
    """The mode of m² = `squared` (S, N) in a sheet.

    Whatever is made of it is even in m. But derivatives by m cancel to rounding errors only, which 1 / m
    multiplies on the way to m²: where they are asked for, m stays off 0, and those of c and h are a series'.
    """
    if squared.requires_grad:
        squared = squared + near_zero(squared.dtype)
    m = torch.sqrt(squared)
    fall = -m
    less = torch.expm1(fall)
    decay = torch.clamp(fall, min=-FAR).exp_()  # denormal numbers beyond would take ten times longer
    over = fall / (less + 2).mul_(less)  # m / (1 - e^-2m)
    h = over * decay
    c = torch.addcmul(over, h, decay)
    if squared.requires_grad:
        c = torch.where(squared < SMALL, _series(squared, 1, 1 / 3, -1 / 45, 2 / 945), c)
        h = torch.where(squared < SMALL, _series(squared, 1 / 2, -1 / 12, 7 / 720, -31 / 30240), h)
    return Crossing(decay, m, c, h)


def near_zero(dtype: torch.dtype) -> float:
    """m² that is as good as 0, and at which derivatives by m² of what is even in m still have digits."""
    return torch.finfo(dtype).eps ** 0.85


@no_type_check
def _series(x, *terms):
    """Σ of terms xⁿ."""
    total = terms[-1]
    for term in reversed(terms[:-1]):
        total = total * x + term
    return total


@no_type_check
def lit(mode, sheet):
    """∫ P and ∫ Q over the sheet with the source of all its rays."""
    near = far = None
    for ray in sheet.rays:
        q = overlap(mode.decay, ray.beam, ray.tau - mode.m, sheet.two)
        p = torch.addcmul(sheet.one, mode.h, q, value=-2).div_(mode.m + ray.tau)
        near = _plus(near, ray.down, p)
        if ray.up is None:
            far = _plus(far, ray.down, q)
            continue
        q = torch.addcmul(q, mode.decay, p, value=-1)
        near = torch.addcmul(near, ray.up, q)  # the mirror image of what comes down
        far = torch.addcmul(_plus(far, ray.down, q), ray.up, p)
    if sheet.rays[0].up is None:  # of all rays at once
        far = torch.addcmul(far, mode.decay, near, value=-1)
    return near, far


@no_type_check
def overlap(decay, beam, apart, two):
    """∫ e^(-σz) e^(-λ(d - z)) dz / d by `decay` = e^-λd, `beam` = e^-σd and `apart` = (σ - λ) d.

    That is (decay - beam) / apart, which blends into ½ (decay + beam) / (1 + apart² / 12), right to fourth
    order, where it is 0 / 0: in float32 both are good to 3e-7.
    """
    sharp, squared = 2 / few(decay.dtype), apart * apart
    total = torch.addcmul(decay + beam, (decay - beam) * apart, squared, value=sharp)
    return total.div_(torch.addcmul(torch.add(two, squared, alpha=1 / 6), squared, squared, value=sharp))


@no_type_check
def few(dtype):
    """apart⁴ where a difference loses as much to rounding as its limit to what it leaves out."""
    return 30 * torch.finfo(dtype).eps ** 0.8


@no_type_check
def received(rays, decay):
    """∫ e^-λz over a half-space with the source of all `rays`; `decay` is λ."""
    total = None
    for ray in rays:
        extinction = ray.tau + decay
        total = ray.down / extinction if total is None else torch.addcdiv(total, ray.down, extinction)
    return total


@no_type_check
def crossed(mode, squared, sheet, response, Gd):
    """What reaches the near face of a sheet, and its admittance there times d, both times the third result.

    That is its own light and `response`, what reaches the far face (None: nothing). `Gd`: admittance
    below, over the layer's own diffusion coefficient, times d; the result is over that, too.
    """
    near, far = lit(mode, sheet)
    whole = mode.c + Gd
    if response is not None:
        far = far + response
    reached = torch.addcmul(near * whole, mode.h, far, value=2)
    return reached, torch.addcmul(squared, Gd, mode.c), whole


@no_type_check
def _plus(total, a, b):
    """total + a b"""
    return a * b if total is None else torch.addcmul(total, a, b)
