"""What both marches do at one point M(t) = P - t ω_o of a view ray: look up depths, follow the light in.

Written per scalar on flat lists (P,). `fused.cpp` is the same for processors.
"""

import math
from typing import no_type_check

import torch

LEAST_LIGHT_COS = 0.03  # of the light to the plane it enters through
SERIES = 0.25  # below this exponent a power series beats the difference of exponentials
# (1 - e^-x) / x, the highest power first
POWERS = (-1 / 720, 1 / 120, -1 / 24, 1 / 6, -1 / 2, 1.0)
LEAST_REST = 1e-7  # of 1 - |g|: what float32 tells from 0
FRAME = 2  # texels that repeat beyond the right and the lower edge: neighbours need no wrapping


def framed(image):
    """(H, W, n) as n planes (n, H + FRAME, W + FRAME), tiled beyond the right and the lower edge."""
    height, width = image.shape[:2]
    rows, columns = (torch.arange(n + FRAME, device=image.device) % n for n in (height, width))
    return image.permute(2, 0, 1)[:, rows][:, :, columns].contiguous()


@no_type_check
def look_up(planes, size, x, y):
    """Values of each of `planes` at texel coordinates x, y: bilinear, tiled.

    `planes`: flat and framed; `size`: H, W without frame.
    """
    height, width = size
    left, top = torch.floor(x), torch.floor(y)
    fx, fy = x - left, y - top
    # rounding may end one texel beyond the edge, where the frame is; far more where texels are far too small
    x0 = (left - torch.floor(left * (1 / width)) * width).clamp(0, width)
    y0 = (top - torch.floor(top * (1 / height)) * height).clamp(0, height)
    row = width + FRAME
    a = y0.int() * row + x0.int()
    b, c, d = a + 1, a + row, a + (row + 1)
    found = []
    for plane in planes:
        above = torch.lerp(plane.index_select(0, a), plane.index_select(0, b), fx)
        below = torch.lerp(plane.index_select(0, c), plane.index_select(0, d), fx)
        found.append(torch.lerp(above, below, fy))
    return found


@no_type_check
def place(ray, planes, size, t):
    """M at t [mm] down the ray, and the plane its light enters through, whatever the light: t, the share
    of the ray, the rest, 1 / length of N_M, height of M below that plane, x and y, boundary depths.

    The plane turns from the tangent plane at P into the fitted plane as M moves from the start to the
    end of the ray.
    """
    x, y, dx, dy, length, view_n, view_s, offset, n_s = ray[:9].unbind(0)
    fraction = t / length
    rest = 1 - fraction
    # N_M = rest N_P + fraction NS, not of unit length
    shrink = torch.rsqrt(rest * rest + fraction * fraction + 2 * rest * fraction * n_s)
    height = (t * (rest * view_n + fraction * view_s) + fraction * offset * (rest + fraction * n_s)).abs()
    mx, my = x + t * dx, y + t * dy
    return t, fraction, rest, shrink, height * shrink, mx, my, look_up(planes, size, mx, my)


@no_type_check
def meet(ray, light, spot, planes, size, g, phase):
    """Boundary depths under M, the way KM the light came inside, the boundaries along it, the share
    scattered to the eye per layer and g (phase × irradiance, relative), and cosθ.

    `spot`: what `place` found; `g` (layers, 1 or channels), with points behind where it is a map; the
    share is a list alike.
    Source: François et al. 2006, Algorithm 2; Norberg 2010; weights of the planes as in their eq. 9.
    """
    dx, dy, view_n, view_s, nearer = (ray[i] for i in (2, 3, 5, 6, 9))
    light_n, light_s, aside_x, aside_y, light_view, nearness, first, second = light[:8].unbind(0)
    t, fraction, rest, shrink, height, mx, my, depth = spot
    # the light from M: L - P + (P - M), scaled to unit length
    near = nearness * t
    stretch = torch.rsqrt((1 + near * (2 * light_view + near)).clamp_min(1e-4))
    facing = (rest * (light_n + near * view_n) + fraction * (light_s + near * view_s)) * stretch * shrink
    cosine = facing.clamp_min(LEAST_LIGHT_COS)
    way = height / cosine  # ‖K'M‖
    reach = way * stretch
    entry = look_up(planes, size, mx + reach * (aside_x - near * dx), my + reach * (aside_y - near * dy))
    half = 0.5 / cosine
    boundary = [(m + k) * half for m, k in zip(depth, entry)]
    # a light half as far from M as from P is four times as bright
    arrives = (first + (second - first) * (fraction * nearer).clamp_max(1.0)) * stretch * stretch
    arrives = arrives * (facing > 0)
    straight = (light_view + near) * stretch  # ω_in · ω_o
    share = [[arrives * scattered(straight, k, phase) for k in layer.unbind(0)] for layer in g.unbind(0)]
    return depth, way, boundary, share, cosine


@no_type_check
def scattered(cosine, g, phase):
    """Phase function [1/sr]; `cosine` between light and eye, both seen from M: -1 is straight on.

    Sources: Henyey & Greenstein 1941; Blasi et al. 1993 (Schlick), where g is their k.
    """
    # |g| + g cosine, which rounding must not take below 0: denominators cancel where |g| is near 1
    aside, rest = (g.abs() + g * cosine).clamp_min(0), (1 - g.abs()).clamp_min(LEAST_REST)
    if phase == "schlick":
        base = rest + aside
        return (1 - g * g) / (4 * math.pi * base * base)
    base = rest * rest + 2 * aside
    return (1 - g * g) / (4 * math.pi * base * torch.sqrt(base))


@no_type_check
def optical(way, within, sigma_t):
    """Optical depth over the first `way` [mm] of a path, of which `within` lie above each boundary: 0 below
    the last one, unless there is a layer more than boundaries. `sigma_t`: per layer [1/mm]."""
    layers = len(sigma_t)
    total = None
    for i, length in enumerate(within):
        more = sigma_t[i] - sigma_t[i + 1] if i + 1 < layers else sigma_t[i]
        total = more * length if total is None else torch.addcmul(total, more, length)
    if layers > len(within):
        total = sigma_t[-1] * way if total is None else torch.addcmul(total, sigma_t[-1], way)
    return total


@no_type_check
def mean_transmission(start, end, at_start, at_end):
    """Mean of e^-T over a stretch on which T runs evenly from `start` to `end`; `at_…` are e^-T there."""
    x = end - start
    small = x.abs() < SERIES
    series, *rest = (x.new_full((), power) for power in POWERS)
    for power in rest:
        series = torch.addcmul(power, x, series)
    return torch.where(small, at_start * series, (at_start - at_end) / torch.where(small, 1.0, x))
