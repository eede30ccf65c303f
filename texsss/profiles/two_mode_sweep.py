"""Two coupled modes swept through N layers: what reaches the top of light that collimated beams scatter.

Everything is a vector of two per row and frequency. A stack is swept like scalar diffusion, with 2×2
admittances in the eigenvectors of each layer, which do not depend on the frequency:

    Γd = c - k (Gd + c)⁻¹ k,   c, k diagonal as in `modes`, G the admittance below in this layer's modes.

Source: our own; the equations are those of Larsen et al. 2002 with free boundary coefficients.
"""

from typing import NamedTuple, no_type_check

import torch

from texsss.profiles.films import Way, last_scattered, one_way, spread_aside, ways
from texsss.profiles.modes import LEAST, Ray, Sheet, crossed, crossing, lit, ray_of, received, sheet_of
from texsss.profiles.slab import THIN, TINY, added
from texsss.profiles.straight import Fading, leaving, returning
from texsss.types import Tensor

Pair = tuple[Tensor, Tensor]
Matrix = tuple[Tensor, Tensor, Tensor, Tensor]  # row-major 2×2


class Carried(NamedTuple):
    """One mode in one layer, whatever the frequency, (1, N) each."""

    rate: Tensor  # λ² - s² [1/mm²], times d² where the layer has a bottom
    sheet: Sheet | None  # None in a half-space
    rays: tuple[Ray, ...]


class Level(NamedTuple):
    """One layer, whatever the frequency, (1, N) each; matrices lead to it from the layer below."""

    coupled: tuple[Carried, Carried]  # eigenvectors V = [[1, k1], [-k2, 1]]
    k1: Tensor
    k2: Tensor
    into: Matrix | None  # V⁻¹ V_below times `ratio`, and its inverse without
    back: Matrix | None
    alone: tuple[Carried, Carried]  # modes that do not scatter on the way
    ratio: Tensor | None  # D/d below over D/d here, d of a half-space being 1


class Face(NamedTuple):
    """What a face loses and lets out of either mode, scale √(growth (s / σ)² + 1 / μ²), times d of its layer.

    A face that mirrors nothing loses of light that comes from σ what growth 1 and the scale `free` say.
    """

    base: Pair  # 1 / μ², numbers
    loss: tuple[Pair, Pair]  # growth and scale [1/mm] of what is lost
    out: tuple[Pair, Pair]  # ... of what comes out
    sigma: Tensor  # mean extinction where light last scattered
    free: Tensor
    ways: tuple[Way, ...]  # on which light crosses films straight
    fadings: tuple[Fading, Fading]  # of what leaves, and of what returns


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
    for layer, beams, aside in zip(reversed(layers), reversed(lights), reversed(spread_aside(layers))):
        rates, k1, k2 = _eigen(layer, inner)
        rays = tuple(ray_of(light, layer.d) for light in beams)
        coupled = tuple(_carried(layer, rate, aside, rays, y) for rate, y in zip(rates, (1 - k2, 1 + k1)))
        alone = tuple(_carried(layer, (layer.sigma / mu) ** 2, aside, rays) for mu in inner.mu)
        into = back = ratio = None
        if levels:
            below, under = levels[-1], layers[len(layers) - len(levels)]
            ratio = layer.sigma / under.sigma * (under.eta / layer.eta) ** 2 * coupled[0].sheet.d
            if under.d is not None:
                ratio = ratio / below.coupled[0].sheet.d
            det, own = 1 + k1 * k2, 1 + below.k1 * below.k2
            a, b = 1 + k1 * below.k2, below.k1 - k1
            c, e = k2 - below.k2, 1 + below.k2 * k1
            scale = ratio / det
            into, back = (a * scale, b * scale, c * scale, e * scale), (e / own, -b / own, -c / own, a / own)
        levels.append(Level(coupled, k1, k2, into, back, alone, ratio))
    far = None if layers[-1].d is None else _face(layers[::-1], bottom)
    return Sweep(tuple(reversed(levels)), _face(layers, top), far)


@no_type_check
def _carried(layer, rate, aside, rays, y=None):
    """A mode with what it takes of the light: `y` times all of it."""
    if y is not None:
        rays = tuple(
            ray._replace(down=ray.down * y, up=None if ray.up is None else ray.up * y) for ray in rays
        )
    if layer.d is None:
        return Carried(rate, None, rays)
    sheet = sheet_of(layer.d, rays, aside)
    return Carried(rate * sheet.d2 + LEAST, sheet, rays)


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
    first, origin = layers[0], last_scattered(layers)
    thick = first.sigma if first.d is None else first.sigma * (first.d + THIN)

    def numbers(a, b):
        return first.sigma.new_full((), a), first.sigma.new_full((), b)

    lost = (modes.b[0] * thick * origin.let_out, modes.b[1] * thick * origin.let_out)
    return Face(
        numbers(modes.mu[0] ** -2, modes.mu[1] ** -2),
        (numbers(*modes.gamma), lost),
        (numbers(*modes.delta), (modes.w[0] * lost[0], modes.w[1] * lost[1])),
        origin.sigma,
        thick * origin.squared,
        ways(layers),
        (leaving(first.eta), returning(first.eta)),
    )


@no_type_check
def scattered_twice(sweep, s, s2):
    """Light that leaves by the near face after two or more scatterings, and after one (S, N each), per unit.

    The latter is what the modes carry there without scattering on the way; the former, what they carry in all
    less that. `s`, `s2`: frequencies (S, 1) and their squares. Differentiable.
    """
    b, out = _at_face(sweep.near, s)
    lowest = None if sweep.far is None else _at_face(sweep.far, s)[0]
    once = added([_uncoupled(sweep.levels, s2, m, b[m], out[m], lowest and lowest[m]) for m in (0, 1)])
    return _coupled(sweep.levels, s2, b, out, lowest) - once, once


@no_type_check
def _coupled(levels, s2, b, out, lowest):
    """What the top receives of the source, by both modes with all scattering between them."""
    response, gamma = None, None  # admittance of all below over D/d, in the modes of the layer below
    for level in reversed(levels):
        squared = tuple(_squared(carried, s2) for carried in level.coupled)
        if level.coupled[0].sheet is None:
            decay = [x.sqrt_() for x in squared]
            response = tuple(received(carried.rays, x) for carried, x in zip(level.coupled, decay))
            gamma = (decay[0], None, None, decay[1])
            continue
        if response is None:  # V⁻¹ diag(lowest) V
            det = 1 + level.k1 * level.k2
            mixed, step = level.k1 * level.k2 / det, lowest[0] - lowest[1]
            G = (
                torch.addcmul(lowest[0], mixed, step, value=-1),
                level.k1 / det * step,
                level.k2 / det * step,
                torch.addcmul(lowest[1], mixed, step),
            )
        else:
            G = _product(_product(level.into, gamma), level.back)
            response = _row_times(response, level.back)
        first, second = (crossing(x, carried.sheet) for carried, x in zip(level.coupled, squared))
        near1, l1 = lit(first, level.coupled[0].sheet)
        near2, l2 = lit(second, level.coupled[1].sheet)
        if response is not None:
            l1, l2 = l1 + response[0], l2 + response[1]
        # (Gd + c)⁻¹ = [[B2, -G12], [-G21, B1]] / det
        B1, B2 = G[0] + first.c, G[3] + second.c
        cross = (G[1] * G[2]).neg_()
        q1, q2 = torch.addcmul(cross, G[0], B2), torch.addcmul(cross, G[3], B1)
        inverse = torch.addcmul(q1, first.c, B2).reciprocal_()
        e1, e2 = first.h * inverse, second.h * inverse
        response = (
            torch.addcmul(near1, e1, torch.addcmul(l1 * B2, l2, G[2], value=-1), value=2),
            torch.addcmul(near2, e2, torch.addcmul(l2 * B1, l1, G[1], value=-1), value=2),
        )
        both = (first.h * e2).mul_(4)
        gamma = (
            torch.addcmul(squared[0] * B2, first.c, q1).mul_(inverse),
            both * G[1],
            both * G[2],
            torch.addcmul(squared[1] * B1, second.c, q2).mul_(inverse),
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
    # over M₂₂: if the first layer is absent all of M is so small that products vanish
    M0, M1, M2 = (x / M[3] for x in M[:3])
    p0, p1 = (x / M[3] for x in out)
    c1 = torch.addcmul(p0, M1, p1, value=-1)
    c2 = torch.addcmul(M0 * p1, M2, p0, value=-1)
    reached = torch.addcmul(response[0] * c1, response[1], c2)
    return reached / torch.addcmul(M0, M1, M2, value=-1)


@no_type_check
def _uncoupled(levels, s2, m, b, out, lowest):
    """The same in mode m without scattering on the way: what it makes of light that scattered once."""
    response, admittance, whole = None, lowest, None  # the first two over the third
    for level in reversed(levels):
        carried = level.alone[m]
        squared = _squared(carried, s2)
        if carried.sheet is None:
            admittance = squared.sqrt_()
            response = received(carried.rays, admittance)
            continue
        Gd = admittance if level.ratio is None else level.ratio * admittance
        if whole is not None:
            Gd, response = Gd / whole, response / whole
        mode = crossing(squared, carried.sheet)
        response, admittance, whole = crossed(mode, squared, carried.sheet, response, Gd)
    if whole is None:
        return out * response / (admittance + b)
    return out * response / torch.addcmul(admittance, b, whole)


@no_type_check
def _squared(carried, s2):
    """λ² of a mode, times d² where its layer has a bottom."""
    if carried.sheet is None:
        return carried.rate + s2
    return torch.addcmul(carried.rate, s2, carried.sheet.aside)


@no_type_check
def _at_face(face, s):
    """What a face loses and lets out of either mode.

    A mode that loses b where it would lose B by a face that mirrors nothing comes back by
    ρ = (B - b) / (B + b). Where it goes to the face and back straight, ρ fades, and so does what leaves on
    its way there.
    """
    u = s / face.sigma
    x = u * u
    b, out = (
        [torch.addcmul(face.base[m], growth[m], x).sqrt_() * scale[m] for m in (0, 1)]
        for growth, scale in (face.loss, face.out)
    )
    if not face.ways:
        return b, out
    left = one_way(face.ways, face.fadings[0], s)
    lost = (1 - one_way(face.ways, face.fadings[1], 2 * s)) / 2
    for m in (0, 1):
        free = torch.sqrt(face.base[m] + x) * face.free
        step = (free - b[m]) * lost
        share = free / (free - step)  # φ at the face if ρ did not fade, over what it is
        b[m], out[m] = (b[m] + step) * share, out[m] * left * share
    return b, out


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
