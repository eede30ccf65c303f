"""Single scattering by exact integration over straight pieces of every layer."""

from typing import no_type_check

import torch

from texsss.transport.march.kernel import mean_transmission, meet, optical, split


@no_type_check
def exact_start(ray, light, planes, size, g, phase):
    """State at the surface: boundary depths, KM, boundaries along it, shares per layer."""
    depth, way, boundary, share, _ = meet(
        ray, light, planes, size, split(g), torch.zeros_like(ray[0]), phase, on_surface=True
    )
    return depth, way, boundary, share


@no_type_check
def exact_step(ray, light, planes, size, sigma_s, sigma_t, g, t0, t1, state, optical0, total, phase):
    """One step from t0 to t1 [mm]: the state at t1, the optical depth of the view ray there and the
    light gathered so far, per channel.

    Depths, KM and the boundaries along it are taken as straight lines in t. Then M crosses every
    boundary at most once, all in the same direction, and between crossings the total optical depth
    T is a straight line: each piece adds σs p ℓ (e^-T0 - e^-T1) / (T1 - T0).
    """
    sigma_s, sigma_t = split(sigma_s), split(sigma_t)
    depth0, way0, boundary0, share0 = state
    depth1, way1, boundary1, share1, _ = meet(ray, light, planes, size, split(g), t1, phase)
    layers, channels = len(sigma_t), len(sigma_t[0])
    view_s = ray[6]
    length = t1 - t0

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

    # where in the step each boundary is crossed; rising rays meet the deepest first
    place = [torch.where(rising, 1 - a, a) for a in above]
    way = [way0 + p * (way1 - way0) for p in place]
    inward = [[b0 + p * (b1 - b0) for b0, b1 in zip(boundary0, boundary1)] for p in place]
    stretch = [(above[i + 1] - above[i]) * length for i in range(layers)]
    share = [[0.5 * (a + b) for a, b in zip(s0, s1)] for s0, s1 in zip(share0, share1)]

    gathered, passed = [], []
    for c in range(channels):
        so_far = [torch.zeros_like(t0)]
        for i in range(layers):
            so_far.append(so_far[-1] + sigma_t[i][c] * stretch[i])
        depths = [
            optical0[c] + torch.where(rising, so_far[-1] - s, s) + optical(w, b, sigma_t, c)
            for s, w, b in zip(so_far, way, inward)
        ]
        left = [torch.exp(-d) for d in depths]
        gain = total[c]
        for i in range(layers):
            mean = mean_transmission(depths[i], depths[i + 1], left[i], left[i + 1])
            gain = gain + sigma_s[i][c] * share[i][min(c, len(share[i]) - 1)] * stretch[i] * mean
        gathered.append(gain)
        passed.append(optical0[c] + so_far[-1])
    return (depth1, way1, boundary1, share1), passed, gathered


@no_type_check
def tail(ray, light, planes, size, sigma_s, sigma_t, g, optical0, total, phase):
    """`total` with what an infinite last layer adds beyond the end of the ray, in closed form."""
    sigma_s, sigma_t = split(sigma_s), split(sigma_t)
    _, way, boundary, share, cosine = meet(ray, light, planes, size, split(g), ray[4], phase)
    gathered = []
    for c in range(len(sigma_t[0])):
        # KM grows by ω_o·NS / cosθ per mm
        slope = sigma_t[-1][c] * (1 + ray[6] / cosine)
        left = torch.exp(-optical0[c] - optical(way, boundary, sigma_t, c))
        gain = sigma_s[-1][c] * share[-1][min(c, len(share[-1]) - 1)] * left / slope.clamp_min(1e-30)
        gathered.append(total[c] + gain)
    return gathered
