"""Light scattered more than once in slabs that are thin between faces which mirror it.

What a face mirrors totally crosses a thin slab again and again, so that it is everywhere alike, and flies
as far along as it would in an endless medium: two modes, whose cosines must do for all depths, know neither.
Of light that starts evenly in all depths and directions the share

    K = arctan(s/σ) / (s/σ) - Σ_m W_m σ/(μ_m Λ_m) (1 - ε) / (Λ_m d (1 - F ε)), Λ = √(σ²/μ² + s² ν²), ε = e^-Λd

collides again, and E = ½ Σ_m W_m (1 - ε) / (Λ_m d (1 - F ε)) leaves by either face, with the nodes of
`single`. Then what scattered twice and more is X a² K E / (1 - a K), X being what the beam lost. Layers of
one index count as one, of their mean coefficients: all light crosses them all, if they are thin enough or of
much the same albedo.
Source: our own; the escape probabilities of reactor physics, in Hankel space.
"""

import math
from typing import NamedTuple, no_type_check

import torch

from texsss.profiles.single import LEAST, exits
from texsss.profiles.slab import FAR, THIN, added, extinguished
from texsss.types import Tensor

# Optical depth up to which this is better than two modes, per share mirrored totally over share let out:
# fitted to the Monte Carlo of slabs of index 1.1 to 1.6, the same for all
REACH = 0.45
UNLIKE = 40.0  # ... less by this times the variance of the albedo, for what goes on there is not even
LEFT = 1e-6  # of light that must leave, so that nothing overflows in slabs which are not thin at all


class Even(NamedTuple):
    """A slab whatever the frequency, (1, N) each."""

    rest: Tensor  # share of multiple scattering that is left to two modes
    strength: Tensor  # what the beam lost, times albedo² and the other share
    albedo: Tensor
    sigma: Tensor
    ways: tuple[tuple[Tensor, float, float, float], ...]  # σd / μ, 1 - μ², weight, and what a face mirrors


@no_type_check
def prepare(layers, directions):
    """All of a slab that does not depend on the frequency.

    None where faces mirror nothing totally, where there is but one of them, or where indices differ inside.
    """
    eta = layers[0].eta
    if layers[-1].d is None or eta == 1 or any(layer.eta != eta for layer in layers):
        return None
    mirrored = math.sqrt(1 - 1 / eta**2)
    depths = [layer.d + THIN for layer in layers]
    d, tau = added(depths), added([layer.sigma * x for layer, x in zip(layers, depths)])
    albedo = added([layer.sigma_s * x for layer, x in zip(layers, depths)]) / tau
    beyond = (tau * ((1 - mirrored) / (REACH * mirrored))).pow(1.5)
    apart = [
        (layer.sigma_s / layer.sigma - albedo) ** 2 * layer.sigma * x for layer, x in zip(layers, depths)
    ]
    beyond = (beyond * (1 + UNLIKE * added(apart) / tau)).clamp_max(FAR)
    strength = extinguished(layers, directions) * albedo**2 * torch.exp(-beyond)
    ways = tuple((tau / mu, 1 - mu**2, weight, mirror) for mu, weight, mirror, _ in exits(eta, eta))
    return Even(-torch.expm1(-beyond), strength, albedo, tau / d, ways)


@no_type_check
def scattered_evenly(even, s):
    """What leaves by either face after two or more scatterings (S, N). `s`: frequencies (S, 1)."""
    x = s.clamp_min(LEAST) / even.sigma
    again, out, x2 = torch.atan(x) / x, 0.0, x * x
    for tau, sine2, weight, mirror in even.ways:
        root = (x2 * sine2).add_(1).sqrt_()
        m = root * tau
        less = torch.expm1(-m)
        leaves = less / (less * mirror).sub_(1 - mirror).mul_(m)
        again = torch.addcdiv(again, leaves, root, value=-weight)
        out = out + leaves * (weight / 2)
    return even.strength * again * out / (1 - even.albedo * again).clamp_min_(LEFT)
