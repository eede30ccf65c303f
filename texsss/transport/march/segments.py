"""Single scattering by exact integration over straight pieces of every layer.

Within a step, depths, KM and the boundaries along it are taken as straight lines in t. Then M crosses
every boundary at most once, all of them in the same direction, and between crossings the optical
depth T from light to eye is a straight line: each piece adds σs p ℓ (e^-T0 - e^-T1) / (T1 - T0).
"""

from typing import no_type_check

import torch

from texsss.transport.march.kernel import mean_transmission, optical


@no_type_check
def pieces(view_s, t0, t1, depth0, depth1, layers):
    """The step from t0 to t1 [mm], cut where M crosses boundaries, which are `depth0`, `depth1` deep there.

    Comes back: length within each layer [mm]; whether the ray rises towards the surface; the share of
    the step at which each boundary is crossed, the surface first.
    """
    # share of the step above each boundary, starting with the surface
    above = [torch.zeros_like(t0)]
    rising = torch.zeros_like(t0, dtype=torch.bool)
    for d0, d1 in zip(depth0, depth1):
        left0, left1 = d0 - t0 * view_s, d1 - t1 * view_s
        most, least = torch.maximum(left0, left1).clamp_min(0), (-torch.minimum(left0, left1)).clamp_min(0)
        part = most / (most + least).clamp_min(1e-30)
        above.append(torch.maximum(part, above[-1]))
        rising = rising | ((left1 > 0) & (left0 <= 0))
    if layers > len(depth0):
        above.append(torch.ones_like(t0))
    # rising rays meet the deepest boundary first
    place = [torch.where(rising, 1 - a, a) for a in above]
    stretch = [(above[i + 1] - above[i]) * (t1 - t0) for i in range(layers)]
    return stretch, rising, place


@no_type_check
def passage(sigma_t, stretch, rising):
    """Optical depth of one channel from the start of the step to each boundary, and to its end."""
    so_far = [torch.zeros_like(stretch[0])]
    for extinction, length in zip(sigma_t.unbind(0), stretch):
        so_far.append(torch.addcmul(so_far[-1], extinction, length))
    return [torch.where(rising, so_far[-1] - s, s) for s in so_far], so_far[-1]


@no_type_check
def along(place, start, end, stretch):
    """KM, and boundaries along it, where each boundary is crossed; the mean share of each layer × its length.

    `start`, `end`: what `meet` found there.
    """
    _, way0, boundary0, share0, _ = start
    _, way1, boundary1, share1, _ = end
    way = [torch.lerp(way0, way1, p) for p in place]
    inward = [[torch.lerp(b0, b1, p) for b0, b1 in zip(boundary0, boundary1)] for p in place]
    within = [[torch.minimum(w, b) for b in inner] for w, inner in zip(way, inward)]
    halves = [0.5 * length for length in stretch]
    share = [[h * (a + b) for a, b in zip(s0, s1)] for h, s0, s1 in zip(halves, share0, share1)]
    return way, within, share


@no_type_check
def gather(sigma_s, sigma_t, view_depth, way, within, share, total):
    """The light of one channel so far, with that of a step.

    Sums are joined with products where they can be: passes over memory are what takes time.
    `sigma_s`, `sigma_t` (layers) [1/mm], with points behind where they are maps; `view_depth`: optical
    depth of the view ray to each boundary; `share` per layer, times length; `total`: before the step.
    """
    sigma_s, sigma_t = sigma_s.unbind(0), sigma_t.unbind(0)
    depth = [v + optical(w, b, sigma_t) for v, w, b in zip(view_depth, way, within)]
    left = [torch.exp(-d) for d in depth]
    for i, scattering in enumerate(sigma_s):
        mean = mean_transmission(depth[i], depth[i + 1], left[i], left[i + 1])
        total = torch.addcmul(total, scattering, share[i] * mean)
    return total


@no_type_check
def tail(sigma_s, sigma_t, view_s, end, share, passed, total):
    """One channel: `total` with what an infinite last layer adds beyond the end of the ray.

    `end`: what `meet` found there; `share` of the last layer. In closed form.
    """
    _, way, boundary, _, cosine = end
    sigma_t = sigma_t.unbind(0)
    # KM grows by ω_o·NS / cosθ per mm
    slope = sigma_t[-1] * (1 + view_s / cosine)
    within = [torch.minimum(way, b) for b in boundary]
    left = torch.exp(-passed - optical(way, within, sigma_t))
    return total + sigma_s[-1] * share * left / slope.clamp_min(1e-30)
