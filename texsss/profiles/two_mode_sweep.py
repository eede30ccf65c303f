"""Two coupled modes swept through N layers: what reaches the top of light that collimated beams scatter.

Everything is a vector of two per row and frequency. A stack is swept like scalar diffusion, with 2×2
admittances in the eigenvectors of each layer, which do not depend on the frequency:

    Γ = λ² th + sech (I + G th)⁻¹ G sech,   th = tanh(λd)/λ,   G the admittance below in this layer's modes.

Source: our own; the equations are those of Larsen et al. 2002 with free boundary coefficients.
"""

from typing import NamedTuple, no_type_check

import torch

from texsss.profiles.modes import Ray, crossed, decayed, lit, ray_of, received
from texsss.profiles.slab import TINY
from texsss.types import Tensor

# A face feels the extinction at depth z as e^-(3 σ + 8 s) z, so that a layer that vanishes is not felt.
# The rates hardly matter: on layered stacks the radial error is .065 with all that were tried, worst .10.
_NEAR_SIGMA, _NEAR_S = 3.0, 8.0
_FELT = 20.0  # e^-x beyond is nothing

Pair = tuple[Tensor, Tensor]
Matrix = tuple[Tensor, Tensor, Tensor, Tensor]  # row-major 2×2


class Level(NamedTuple):
    """One layer, whatever the frequency, (N,) each; matrices lead to it from the layer below."""

    d: Tensor | None
    rays: tuple[Ray, ...]
    rates: Pair  # λ² - s² of the coupled modes, whose eigenvectors are V = [[1, k1], [-k2, 1]]
    k1: Tensor
    k2: Tensor
    into: Matrix | None  # V⁻¹ V_below times the ratio of diffusion coefficients, and its inverse without
    back: Matrix | None
    alone: Pair  # λ² - s² of the modes that do not scatter on the way
    ratio: Tensor | None  # of diffusion coefficients


class Face(NamedTuple):
    """What a face loses and lets out of either mode: `scale` √(growth (s / σ)² + 1 / μ²), σ as felt there."""

    scale: Pair  # [1/mm] (N,)
    base: Pair  # 1 / μ², numbers
    loss: Pair  # growth of what is lost
    out: Pair  # growth of what comes out
    share: Pair  # weights of what comes out
    felt: tuple[tuple[Tensor, Tensor | None, Tensor | None], ...]  # per layer: σ, 3 σ d, 8 d


class Sweep(NamedTuple):
    """A stack seen from one side, whatever the frequency: layers from the near to the far face."""

    levels: tuple[Level, ...]
    near: Face
    far: Face | None


@no_type_check
def prepare(layers, lights, inner, top, bottom):
    """All of a stack that does not depend on the frequency.

    `inner`, `top`, `bottom`: parameters of the medium and of either boundary. Differentiable.
    """
    levels = []
    for layer, beams in zip(reversed(layers), reversed(lights)):
        rates, k1, k2 = _eigen(layer, inner)
        into = back = ratio = None
        if levels:
            below, under = levels[-1], layers[len(layers) - len(levels)]
            ratio = layer.sigma / under.sigma * (under.eta / layer.eta) ** 2  # D below over D here
            det, own = 1 + k1 * k2, 1 + below.k1 * below.k2
            a, b = 1 + k1 * below.k2, below.k1 - k1
            c, e = k2 - below.k2, 1 + below.k2 * k1
            scale = ratio / det
            into, back = (a * scale, b * scale, c * scale, e * scale), (e / own, -b / own, -c / own, a / own)
        alone = tuple((layer.sigma / mu) ** 2 for mu in inner.mu)
        rays = tuple(ray_of(light, layer.d) for light in beams)
        levels.append(Level(layer.d, rays, rates, k1, k2, into, back, (alone[0], alone[1]), ratio))
    far = None if layers[-1].d is None else _face(layers[::-1], bottom)
    return Sweep(tuple(reversed(levels)), _face(layers, top), far)


@no_type_check
def _eigen(layer, modes):
    sigma2 = layer.sigma**2
    (m1, m2), (w1, w2) = modes.mu, modes.w
    a, lost = layer.sigma_s / layer.sigma, layer.sigma_a / layer.sigma
    K1, K2 = sigma2 / m1**2, sigma2 / m2**2
    c1, c2 = w1 * a * K1, w2 * a * K2
    delta = (K1 - K2 - c1 + c2) / 2
    root = torch.sqrt(delta**2 + c1 * c2)
    fast = (K1 + K2 - c1 - c2) / 2 + root
    slow = K1 * K2 * lost / fast + TINY  # the determinant over the other one: nothing cancels
    # δ > 0 because m1 < m2, so nothing cancels here, at a = 0 neither
    p = delta + root
    return (fast, slow), c1 / p, c2 / p


@no_type_check
def _face(layers, modes):
    sigma = layers[0].sigma

    def numbers(a, b):
        return sigma.new_full((), a), sigma.new_full((), b)

    felt = tuple(
        (layer.sigma, None, None)
        if layer.d is None
        else (layer.sigma, _NEAR_SIGMA * layer.sigma * layer.d, _NEAR_S * layer.d)
        for layer in layers
    )
    return Face(
        (modes.b[0] * sigma, modes.b[1] * sigma),
        numbers(modes.mu[0] ** -2, modes.mu[1] ** -2),
        numbers(*modes.gamma),
        numbers(*modes.delta),
        numbers(*modes.w),
        felt,
    )


@no_type_check
def scattered_twice(sweep, s, s2):
    """Light that leaves by the near face after two or more scatterings (S, N), per unit of the lights.

    That is what the coupled modes carry there less what they carry without scattering on the way.
    `s`, `s2`: frequencies (S, 1) and their squares. Differentiable.
    """
    x = _felt(sweep.near, s, s2)
    b = _faces(sweep.near, sweep.near.loss, x)
    out = _faces(sweep.near, sweep.near.out, x)
    out = (sweep.near.share[0] * out[0], sweep.near.share[1] * out[1])
    lowest = None
    if sweep.far is not None:
        lowest = _faces(sweep.far, sweep.far.loss, _felt(sweep.far, s, s2))
    both = _coupled(sweep.levels, s2, b, out, lowest)
    for m in (0, 1):
        both = both - _uncoupled(sweep.levels, s2, m, b[m], out[m], None if lowest is None else lowest[m])
    return both


@no_type_check
def _coupled(levels, s2, b, out, lowest):
    """What the top receives of the source, by both modes with all scattering between them."""
    response, gamma = None, None  # admittance of all below over D, in the modes of the layer below
    for level in reversed(levels):
        y = (1 - level.k2, 1 + level.k1)
        squared = (s2 + level.rates[0], s2 + level.rates[1])
        if level.d is None:
            decay = (torch.sqrt(squared[0]), torch.sqrt(squared[1]))
            response = (received(level.rays, decay[0]) * y[0], received(level.rays, decay[1]) * y[1])
            gamma = (decay[0], None, None, decay[1])
            continue
        if response is None:  # V⁻¹ diag(lowest) V
            det = 1 + level.k1 * level.k2
            mixed, step = level.k1 * level.k2 / det, lowest[0] - lowest[1]
            G = (
                lowest[0] - mixed * step,
                level.k1 / det * step,
                level.k2 / det * step,
                lowest[1] + mixed * step,
            )
        else:
            G = _product(_product(level.into, gamma), level.back)
            response = _row_times(response, level.back)
        first, second = (_across(squared[m], level, y[m]) for m in (0, 1))
        (near1, l1, t1, sech1), (near2, l2, t2, sech2) = first, second
        if response is not None:
            l1, l2 = l1 + response[0], l2 + response[1]
        det = torch.addcmul(G[0] * G[3], G[1], G[2], value=-1)
        # (I + th G)⁻¹ over its determinant
        T1, T2 = torch.addcmul(G[3], t1, det), torch.addcmul(G[0], t2, det)
        D = torch.addcmul(1 + t1 * G[0], t2, T1)
        e1, e2 = sech1 / D, sech2 / D
        cross1 = torch.addcmul(l1 * G[3], l2, G[2], value=-1)
        cross2 = torch.addcmul(l2 * G[0], l1, G[1], value=-1)
        response = (
            torch.addcmul(near1, e1, torch.addcmul(l1, t2, cross1)),
            torch.addcmul(near2, e2, torch.addcmul(l2, t1, cross2)),
        )
        gamma = (
            torch.addcmul(squared[0] * t1, sech1 * e1, T2),
            sech1 * e2 * G[1],
            sech2 * e1 * G[2],
            torch.addcmul(squared[1] * t2, sech2 * e2, T1),
        )
    # (V Γ + diag(b) V) c = out
    k1, k2 = levels[0].k1, levels[0].k2
    if gamma[1] is None:
        M = (gamma[0] + b[0], k1 * (gamma[3] + b[0]), -k2 * (gamma[0] + b[1]), gamma[3] + b[1])
    else:
        M = (
            torch.addcmul(gamma[0] + b[0], k1, gamma[2]),
            torch.addcmul(gamma[1], k1, gamma[3] + b[0]),
            torch.addcmul(gamma[2], k2, gamma[0] + b[1], value=-1),
            torch.addcmul(gamma[3] + b[1], k2, gamma[1], value=-1),
        )
    c1 = torch.addcmul(M[3] * out[0], M[1], out[1], value=-1)
    c2 = torch.addcmul(M[0] * out[1], M[2], out[0], value=-1)
    reached = torch.addcmul(response[0] * c1, response[1], c2)
    return reached / torch.addcmul(M[0] * M[3], M[1], M[2], value=-1)


@no_type_check
def _across(squared, level, y):
    """∫ P and ∫ Q of one mode with all light, weighted by `y`, and its th = tanh(λd)/λ and sech(λd)."""
    E, minus = decayed(squared, level.d)
    first, second = lit(E, minus, level.rays)
    E2 = E * E
    lost, half = 1 - E2, 1 / (1 + E2)
    wide = y / lost
    near = torch.addcmul(first, E, second, value=-1) * wide
    far = torch.addcmul(second, E, first, value=-1) * wide
    return near, far, (lost * half) / minus * -level.d, E * half * 2


@no_type_check
def _uncoupled(levels, s2, m, b, out, lowest):
    """The same in mode m without scattering on the way: what it makes of light that scattered once."""
    response, admittance, whole = None, lowest, None  # the first two over the third
    for level in reversed(levels):
        squared = s2 + level.alone[m]
        if level.d is None:
            admittance = torch.sqrt(squared)
            response = received(level.rays, admittance)
            continue
        G = admittance if level.ratio is None else level.ratio * admittance
        if whole is not None:
            G, response = G / whole, response / whole
        response, admittance, whole = crossed(squared, level.d, level.rays, response, G)
    if whole is None:
        return out * response / (admittance + b)
    return out * response / torch.addcmul(admittance, b, whole)


@no_type_check
def _felt(face, s, s2):
    """(s / σ)², σ the extinction near a face: a mean that weighs what is near."""
    if len(face.felt) == 1:
        return s2 / face.felt[0][0] ** 2
    near, left, weight = 0.0, None, None
    for sigma, tau, depth in face.felt:
        if tau is None:
            near, weight = torch.addcmul(near, sigma, left), 1.0
            break
        rest = torch.exp(-torch.clamp(torch.addcmul(tau, s, depth), max=_FELT))
        rest = rest if left is None else left * rest
        share = 1 - rest if left is None else left - rest
        near, left = near + sigma * share, rest
    if weight is None:  # of a thin slab only what is there counts
        near, weight = near + TINY * face.felt[0][0], 1 - left + TINY
    inverse = weight / near
    return s2 * inverse * inverse


@no_type_check
def _faces(face, growth, x):
    first, second = (face.scale[m] * torch.sqrt(torch.addcmul(face.base[m], growth[m], x)) for m in (0, 1))
    return first, second


@no_type_check
def _product(a, b):
    if b[1] is None:  # diagonal
        return a[0] * b[0], a[1] * b[3], a[2] * b[0], a[3] * b[3]
    return (
        torch.addcmul(a[0] * b[0], a[1], b[2]),
        torch.addcmul(a[0] * b[1], a[1], b[3]),
        torch.addcmul(a[2] * b[0], a[3], b[2]),
        torch.addcmul(a[2] * b[1], a[3], b[3]),
    )


@no_type_check
def _row_times(r, a):
    return torch.addcmul(r[0] * a[0], r[1], a[2]), torch.addcmul(r[0] * a[1], r[1], a[3])
