"""Slabs as rows of mirrored sources, and stacks of them: `multipole`; half-spaces: `better-dipole`.

A slab of thickness d under a source at depth l = 1 / sigma_t' needs poles at z_r,i = 2i(d + z_b0 + z_bd) + l
and z_v,i = z_r,i - 2l - 2 z_b0. For d ≥ l their sum over all i has a closed form in Hankel space. A
thinner slab, for which the model is not made (Mayorga drops those below 1.5 l), gets its source at the
bottom and of only d / l of the light; the rest passes straight on and counts as transmitted. So energy
is kept, and a slab that vanishes is not there; nor is what its surface would mirror, where the index differs.
Source: Donner & Jensen 2005, with the transmittance as corrected by Mayorga 2008; d'Eon 2012.
"""

from typing import NamedTuple

import torch

from texsss.media import fresnel
from texsss.media.stack import LayerTable
from texsss.numerics.exponentials import relexp
from texsss.profiles.dipole import egan_A
from texsss.profiles.modes import near_zero
from texsss.profiles.slab import TINY, Coefficients, layers_of
from texsss.types import Float, Tensor

PAIRS = 2  # mirrored pairs on either side in explicit sums; their error is 3.5e-7 at d = 1.5 mm
ROUNDING = 1e-6  # of the thickness: what a source on the bottom, at d = l, may lie beyond it


class Slab(NamedTuple):
    """Profiles of a slab for light from above (+) and from below (-), (S, N) each."""

    R_plus: Tensor
    T_plus: Tensor
    R_minus: Tensor
    T_minus: Tensor

    def over(self, other: "Slab") -> "Slab":
        """This slab on top of `other`: all bounces between them, a geometric series."""
        bounces = 1 / (1 - other.R_plus * self.R_minus)
        return Slab(
            self.R_plus + self.T_plus * other.R_plus * self.T_minus * bounces,
            self.T_plus * other.T_plus * bounces,
            other.R_minus + other.T_minus * self.R_minus * other.T_plus * bounces,
            other.T_minus * self.T_minus * bounces,
        )


class Poles(NamedTuple):
    """What a slab is made of: depths of sources (positive) and sinks (negative weight) [mm]."""

    reflected: list[tuple[Tensor, float]]
    transmitted: list[tuple[Tensor, float]]


def stacked(table: LayerTable, s: Float[Tensor, " S"], pairs: int | None = None) -> Slab:
    """Hankel profiles of the whole stack, rows and channels flattened to N.

    `pairs`: the explicit sum of that many pairs on either side; None takes the closed form. The
    refractive indices at inner interfaces are relative. Differentiable.
    """
    layers = layers_of(table)
    whole: Slab | None = None
    for k in reversed(range(len(layers))):
        above, below = neighbours(table.eta, k)
        slab = slab_profile(layers[k], s, above, below, pairs)
        whole = slab if whole is None else slab.over(whole)
    assert whole is not None
    return whole


def neighbours(eta: tuple[float, ...], k: int) -> tuple[float, float]:
    """Index of layer k over that of what lies above and below it."""
    above = eta[k] / (eta[k - 1] if k else 1.0)
    below = eta[k] / (eta[k + 1] if k + 1 < len(eta) else 1.0)
    return above, below


def poles_of(l: Tensor, d: Tensor, z_b0: Tensor, z_bd: Tensor, pairs: int) -> Poles:
    """Depths and signs of the poles of a slab with a source at depth `l`."""
    reflected, transmitted = [], []
    for i in range(-pairs, pairs + 1):
        real = 2 * i * (d + z_b0 + z_bd) + l
        mirrored = real - 2 * l - 2 * z_b0
        reflected += [(real, 1.0), (mirrored, -1.0)]
        transmitted += [(d - real, 1.0), (d - mirrored, -1.0)]
    return Poles(reflected, transmitted)


def lengths(sigma: Tensor, above: float, below: float) -> tuple[Tensor, Tensor, Tensor]:
    """Depth of the source, and how far beyond the top and the bottom the fluence vanishes [mm].

    `sigma` [1/mm]: reduced extinction, of a layer whose index is `above` and `below` times its neighbours'.
    """
    l = 1 / sigma
    return l, 2 / 3 * egan_A(above) * l, 2 / 3 * egan_A(below) * l


def slab_profile(layer: Coefficients, s: Tensor, above: float, below: float, pairs: int | None) -> Slab:
    """Hankel profiles of one layer between media over whose index its own is `above` and `below`."""
    l, z_b0, z_bd = lengths(layer.sigma, above, below)
    albedo = layer.sigma_s * l
    squared = 3 * layer.sigma_a * layer.sigma + s[:, None] ** 2 + TINY
    if layer.d is None:
        kappa = torch.sqrt(squared)
        R = albedo / 2 * torch.exp(-kappa * l) * (1 + torch.exp(-2 * kappa * z_b0))
        return Slab(R, torch.zeros_like(R), torch.zeros_like(R), torch.zeros_like(R))
    if squared.requires_grad:  # even in kappa: see modes.crossing
        squared = squared + near_zero(squared.dtype) / (layer.d + z_b0 + z_bd) ** 2
    kappa = torch.sqrt(squared)
    if pairs is not None:
        both = (_explicit(albedo, kappa, l, layer.d, *z, pairs) for z in ((z_b0, z_bd), (z_bd, z_b0)))
    else:
        share = (layer.d / l).clamp_max(1)
        closed = (_closed(albedo * share, kappa, l, layer.d, *z) for z in ((z_b0, z_bd), (z_bd, z_b0)))
        both = ((R, T + (1 - share)) for R, T in closed)
    plus, minus = both
    return Slab(*plus, *minus)


def _closed(albedo, kappa, l, d, z_b0, z_bd) -> tuple[Tensor, Tensor]:
    """R̂ and T̂ of infinitely many pairs, with exponentials of negative arguments only.

    The source must lie within the slab: at depth l, or at the bottom of thinner ones.
    """
    l = torch.minimum(l, d)
    whole = d + z_b0 + z_bd

    def sinh_ratio(a: Tensor) -> Tensor:  # e^(κ(whole - a)) sinh κa / sinh κ whole
        return a * relexp(2 * kappa * a) / (whole * relexp(2 * kappa * whole))

    R = albedo / 2 * torch.exp(-kappa * l) * (1 + torch.exp(-2 * kappa * z_b0)) * sinh_ratio(d + z_bd - l)
    T = albedo / 2 * torch.exp(-kappa * (d - l)) * (1 + torch.exp(-2 * kappa * z_bd)) * sinh_ratio(l + z_b0)
    return R, T


def _explicit(albedo, kappa, l, d, z_b0, z_bd, pairs: int) -> tuple[Tensor, Tensor]:
    """R̂ and T̂ of a finite number of pairs; a pole at depth z is sign(z) e^-κ|z|, within the slab at 0."""
    sides = poles_of(l, d, z_b0, z_bd, pairs)
    least = -ROUNDING * d
    R, T = (
        sum(torch.where(z < least, -sign, sign) * torch.exp(-kappa * z.abs()) for z, sign in side)
        for side in sides
    )
    return albedo / 2 * R, albedo / 2 * T


def better_dipole(table: LayerTable, s: Float[Tensor, " S"]) -> Float[Tensor, "S N"]:
    """Multiple scattering of the first layer as a half-space, flattened to N; layers beneath are ignored.

    Grosjean's D, exact moments of the boundary, exitance from fluence and flux, albedo'² because what
    scattered once is counted apart. Source: d'Eon 2012, A better dipole.
    """
    layer = layers_of(table.first)[0]
    c1, c2 = fresnel.moments(table.eta[0])
    albedo, l = layer.sigma_s / layer.sigma, 1 / layer.sigma
    D = (2 - albedo) / (3 * layer.sigma)
    kappa = torch.sqrt(layer.sigma_a / D + s[:, None] ** 2 + TINY)
    mirrored = 4 * fresnel.A(table.eta[0]) * D  # the sink lies l + 2 z_b above
    real = torch.exp(-kappa * l)
    # (1 - e^-κ·2z_b) / κ without cancellation
    fluence = real * mirrored * relexp(kappa * mirrored) / (2 * D)
    flux = real * (1 + torch.exp(-kappa * mirrored)) / 2
    return albedo**2 * ((1 - 2 * c1) / 4 * fluence + (1 - 3 * c2) / 2 * flux)
