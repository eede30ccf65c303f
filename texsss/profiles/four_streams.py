"""What similarity lacks where light scatters forwards, by four streams in truth less four when reduced.

The reduced medium, σs' = σs (1 - g), turns light at once that in truth keeps its direction for a while. Two
cosines per hemisphere know enough of that, crude as they are, for the difference. Each stands for the light
within or beyond the cone that can leave. The phase function is δ-peaked so that its moments are g, g², g³;
of intensities i = e ± o up and down, e = e0 + e2 p, o = o1 μ + o3 h with orthogonal p (of P2) and h (of P3),

    (M o1)' = -σ s0 e0,  (⅔ o1 + β o3)' = -σ s2 e2,  (e0 + a e2)' = -σ s1 o1,  (b e2)' = -σ o3,

which are two coupled equations of diffusion in u = e0 + a e2 and v = e2, solved as in `two_mode_sweep`.
Source: our own; δ-peaks of Wiscombe 1977, streams of Chandrasekhar 1960.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple, no_type_check

import numpy as np
import torch

from texsss.media import fresnel
from texsss.profiles.incidence import finer
from texsss.profiles.modes import LEAST, crossing, lit, ray_of, received, sheet_of
from texsss.profiles.slab import FAR, TINY, from_side, light_in, mirrors, refracted

CONE = (0.5, 0.75)  # least and most cosine at which the hemisphere is cut ...
OPEN = 0.1  # and how much less than that where all leaves: at .5 thin slabs of index 1 are 3 % brighter
SPREAD = 0.03  # of the second moment that cosines lack where indices differ ...
SPREAD_AT = 1.33  # ... from this one on: without it R at normal incidence is 8 % higher
QUADRATURE = 64
SERIES = 1e-6  # optical depth below which 1 - e^-x is x


class Streams(NamedTuple):
    """Moments of two cosines, as above."""

    mu: tuple[float, float]
    w: tuple[float, float]
    cut: float
    p: tuple[float, float]
    h: tuple[float, float]
    M: float  # Σ w μ²
    a: float
    r: float  # ⅔ / M
    n: float  # β b
    beta: float
    p2: float  # Σ w p²
    h2: float
    mean: float  # of P2


@cache
def streams(eta: float) -> Streams:
    """The two cosines of a stack whose greatest index is `eta`."""
    least = CONE[0] - max(OPEN - (eta - 1), 0.0)
    cut = min(max(math.sqrt(1 - 1 / eta**2), least), CONE[1])
    w = np.array([cut, 1 - cut])
    width = math.sqrt(1 / 12 - SPREAD * min((eta - 1) / (SPREAD_AT - 1), 1.0))
    mu = 0.5 + width * np.array([-math.sqrt(w[1] / w[0]), math.sqrt(w[0] / w[1])])
    P2, P3 = (3 * mu**2 - 1) / 2, (5 * mu**3 - 3 * mu) / 2
    M = float(w @ mu**2)
    p = P2 - w @ P2
    h = P3 - float(w @ (mu * P3)) / M * mu
    (mu1, mu2), (w1, w2), (p1, p2), (h1, h2) = (map(float, pair) for pair in (mu, w, p, h))
    pp, hh, m = float(w @ p**2), float(w @ h**2), float(w @ (mu * p * h))
    return Streams(
        mu=(mu1, mu2),
        w=(w1, w2),
        cut=cut,
        p=(p1, p2),
        h=(h1, h2),
        M=M,
        a=2 / 3 * pp / M,
        r=2 / 3 / M,
        n=m * m / (pp * hh),
        beta=m / pp,
        p2=pp,
        h2=hh,
        mean=float(w @ P2),
    )


@cache
def face(eta: float, greatest: float) -> tuple[float, float, float, float]:
    """Flux (M o1, ⅔ o1 + β o3 less its first part) out of a face per (u, v), row-major 2×2.

    Of either stream as much leaves as Fresnel lets out of its part of the hemisphere.
    """
    k = streams(greatest)
    x, weight = np.polynomial.legendre.leggauss(QUADRATURE)
    lost = []
    for low, high, mu, w in ((0, k.cut, k.mu[0], k.w[0]), (k.cut, 1, k.mu[1], k.w[1])):
        # cosines crowd where light begins to get out
        edge = min(max(math.sqrt(1 - 1 / eta**2), low), high)
        out = 0.0
        for start, end in ((low, edge), (edge, high)):
            cosine = start + (end - start) * ((x + 1) / 2) ** 2
            sine2 = (1 - cosine**2) * eta**2
            outside = torch.from_numpy(np.sqrt(np.clip(1 - sine2, 0, None)))
            passed = fresnel.transmittance(outside, eta).numpy() * (sine2 < 1)
            out += float((weight * (x + 1) / 2 * (end - start)) @ (cosine * passed))
        share = min(out / (w * mu), 1.0)
        lost.append(share / (2 - share))
    made = []
    for u, v in ((1.0, 0.0), (0.0, 1.0)):
        o = [b * (u - k.a * v + v * p) for b, p in zip(lost, k.p, strict=True)]
        first = sum(w * mu * x for w, mu, x in zip(k.w, k.mu, o, strict=True))
        third = sum(w * h * x for w, h, x in zip(k.w, k.h, o, strict=True)) * k.beta / k.h2
        made.append((first, third))
    return made[0][0], made[1][0], made[0][1], made[1][1]


def moments(etas: Sequence[float], below: bool) -> list[float]:
    """What the loop in C++ reads of the streams, of the near and of the far face of layers of `etas`."""
    k, ends = streams(max(etas)), [face(etas[i], max(etas)) for i in (0, -1)]
    near, far = reversed(ends) if below else ends
    return [k.M, k.a, k.r, k.n, k.p2, k.mean, *near, *far]


@no_type_check
def lacking(layers, directions, side):
    """What reaches this side in truth less what does when reduced, of all light at s = 0, (1, N).

    `layers` have reduced coefficients. Differentiable; 0 where g is.
    """
    peaked, level = [], []
    for layer in layers:
        more = layer.sigma_s * (layer.g + layer.g**2)
        peaked.append(layer._replace(sigma_s=layer.sigma_s + more, sigma=layer.sigma + more))
        level.append(layer._replace(g=torch.zeros_like(layer.g)))
    total = _unscattered(peaked, layers, directions, side)
    for sign, media in ((1, peaked), (-1, level)):
        total = total + sign * _scattered(*from_side(side, media, light_in(media, directions)))
    return total


@no_type_check
def _unscattered(peaked, layers, directions, side):
    """What leaves by this side unscattered in the one less what does in the other, as a product."""
    total = torch.zeros_like(layers[0].sigma)
    if layers[-1].d is None:
        return total
    for cosine, share in finer(directions, [layer.eta for layer in layers]):
        top, bottom = mirrors([layer.eta for layer in layers], cosine)
        tau = more = 0.0
        for layer, other in zip(layers, peaked):
            d = layer.d / refracted(cosine, layers[0].eta, layer.eta)
            tau, more = tau + layer.sigma * d, more + (other.sigma - layer.sigma) * d
        # more is below 0 where light is scattered backwards
        apart = more.abs().clamp_min(SERIES)
        least = torch.minimum(tau, tau + more).clamp_max(FAR)
        less = more * torch.exp(-least) * torch.expm1(-apart) / apart
        here, there = torch.exp(-tau.clamp_max(FAR)), torch.exp(-(tau + more).clamp_max(FAR))
        both = (1 - top * bottom * here * here) * (1 - top * bottom * there * there)
        if side == "reflectance":
            out = bottom * (1 - top) * (here + there)
        else:
            out = (1 - bottom) * (1 + top * bottom * here * there)
        total = total + share * out * less / both
    return total


@no_type_check
def _scattered(layers, lights):
    """Light that leaves by the first of `layers` after one or more scatterings."""
    greatest = max(layer.eta for layer in layers)
    k = streams(greatest)
    Y, f, below = face(layers[-1].eta, greatest), (0.0, 0.0), None
    for layer, beams in zip(reversed(layers), reversed(lights)):
        onwards = 1 + layer.g + layer.g**2
        lost, kept = layer.sigma_a / layer.sigma, layer.sigma_s / layer.sigma
        back = (kept + (1 - lost - kept).clamp_min(0)) / onwards  # a clear layer's σ is as if it scattered
        s1, s2 = lost + back, lost + back * (1 + layer.g)
        g1, g2 = (layer.g + layer.g**2) / onwards, layer.g**2 / onwards
        D = k.M / (layer.sigma * s1), k.n / layer.sigma
        # eigenvectors (1, x), slow, and (y, 1), fast
        sigma2 = layer.sigma**2
        A11, A22 = sigma2 * lost * s1 / k.M, sigma2 * (s2 + k.r * k.a * lost) / k.n
        A12, A21 = -k.a * A11, -k.r / k.n * sigma2 * lost
        delta = (A22 - A11) / 2
        root = torch.sqrt(delta**2 + A12 * A21)
        p = delta + root
        fast = A11 + p
        slow = sigma2**2 * lost * s1 * s2 / (k.M * k.n) / fast + TINY
        x, y = -A21 / p, A12 / p
        det = 1 - x * y
        # what of the flux is not a slope: at the bottom, and how much less that is than at the top
        rays, jump, change = [], 0.0, 0.0
        for light in beams:
            ray = ray_of(light, layer.d)
            q1 = 0.5 * (1 + g1 / s1) / D[0]
            q2 = 0.5 * (g2 / k.p2 * ((3 * light.cosine**2 - 1) / 2 - k.mean) - k.r) / D[1]
            rays.append((ray, (q1 - y * q2) / det, (q2 - x * q1) / det))
            along = 0.5 * light.source * light.cosine * g1 / (layer.sigma * s1)
            if layer.d is None:
                change = change - along * light.down
                continue
            up = 0.0 if light.up is None else light.up
            jump = jump + along * (light.down * light.beam - up)
            change = change + along * (light.down + up) * torch.expm1(-ray.tau.clamp_max(FAR))
        modes = [_lit_by([(ray, pair[m]) for ray, *pair in rays]) for m in (0, 1)]
        if layer.d is None:
            decay = torch.sqrt(slow), torch.sqrt(fast)
            made = [received(mode, rate) for mode, rate in zip(modes, decay)]
            gamma, over = (decay[0], 0.0, 0.0, decay[1]), 1.0
        else:
            sheets = [sheet_of(layer.d, mode) for mode in modes]
            over = sheets[0].d
            if below is not None:
                ratio = (below / layer.eta) ** 2
                Y = tuple(z * ratio for z in Y)
            G = _within(Y, D, x, y, det, over)
            squared = tuple(rate * sheet.d2 + LEAST for rate, sheet in zip((slow, fast), sheets))
            first, second = (crossing(x, sheet) for x, sheet in zip(squared, sheets))
            (near1, far1), (near2, far2) = lit(first, sheets[0]), lit(second, sheets[1])
            z1, z2 = (f[0] + jump) / D[0], f[1] / D[1]
            z1, z2 = (z1 - y * z2) / det, (z2 - x * z1) / det
            k1, k2 = 2 * first.h, 2 * second.h
            B1, B2, cross = G[0] + first.c, G[3] + second.c, G[1] * G[2]
            h1, h2 = G[0] * B2 - cross, G[3] * B1 - cross
            part = 1 / (h1 + first.c * B2)
            both = k1 * k2 * part
            # what comes from below passes, less a little
            made = (
                near1 + part * (k1 * (far1 * B2 - (far2 + z2) * G[1]) - z1 * (_turned(first) * B2 + h1)),
                near2 + part * (k2 * (far2 * B1 - (far1 + z1) * G[2]) - z2 * (_turned(second) * B1 + h2)),
            )
            gamma = (
                (squared[0] * B2 + first.c * h1) * part,
                both * G[1],
                both * G[2],
                (squared[1] * B1 + second.c * h2) * part,
            )
        # back to (u, v): D V γ V⁻¹ / d
        a, b = gamma[0] + y * gamma[2], gamma[1] + y * gamma[3]
        c, e = x * gamma[0] + gamma[2], x * gamma[1] + gamma[3]
        one, two = D[0] / (det * over), D[1] / (det * over)
        Y = (a - b * x) * one, (b - a * y) * one, (c - e * x) * two, (e - c * y) * two
        f = (
            D[0] * (made[0] + y * made[1]) + f[0] + change,
            D[1] * (x * made[0] + made[1]) + f[1],
        )
        below = layer.eta
    B = face(layers[0].eta, greatest)
    a, b, c, e = (z + own for z, own in zip(Y, B))
    u, v = e * f[0] - b * f[1], a * f[1] - c * f[0]
    return 2 * (B[0] * u + B[1] * v) / (a * e - b * c)


@no_type_check
def _lit_by(rays):
    return tuple(
        ray._replace(down=ray.down * by, up=None if ray.up is None else ray.up * by) for ray, by in rays
    )


@no_type_check
def _turned(mode):
    """m coth m - m / sinh m."""
    return -mode.m * torch.expm1(-mode.m) / (1 + mode.decay)


@no_type_check
def _within(Y, D, x, y, det, d):
    """V⁻¹ D⁻¹ Y V d of an admittance in (u, v)."""
    one, two = d / (D[0] * det), d / (D[1] * det)
    a, b = (Y[0] + Y[1] * x) * one, (Y[0] * y + Y[1]) * one
    c, e = (Y[2] + Y[3] * x) * two, (Y[2] * y + Y[3]) * two
    return a - y * c, b - y * e, c - x * a, e - x * b
