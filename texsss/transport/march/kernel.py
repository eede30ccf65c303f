"""What both marches do at one point M(t) = P - t ω_o of a view ray: look up depths, follow the light in.

Written per scalar on flat lists (P,), so that torch.compile makes one loop of it; hence no shape
annotations, which the compiler cannot see through.
"""

import math
from typing import no_type_check

import torch

LEAST_LIGHT_COS = 0.03  # of the light to the plane it enters through
SERIES = 0.25  # below this exponent a power series beats the difference of exponentials


@no_type_check
def look_up(planes, size, x, y):
    """Values of each of `planes` (H·W,) at texel coordinates x, y: bilinear, tiled. `size` is H, W."""
    height, width = size
    left, top = torch.floor(x), torch.floor(y)
    fx, fy = x - left, y - top
    x0 = left - torch.floor(left / width) * width
    y0 = top - torch.floor(top / height) * height
    x0 = torch.where(x0 >= width, 0.0, x0)
    y0 = torch.where(y0 >= height, 0.0, y0)
    x1 = torch.where(x0 + 1 >= width, 0.0, x0 + 1).int()
    y1 = torch.where(y0 + 1 >= height, 0.0, y0 + 1).int()
    row = width.int()
    upper, lower = y0.int() * row, y1 * row
    x0 = x0.int()
    a, b, c, d = upper + x0, upper + x1, lower + x0, lower + x1
    found = []
    for plane in planes:
        above = plane.index_select(0, a) + fx * (plane.index_select(0, b) - plane.index_select(0, a))
        below = plane.index_select(0, c) + fx * (plane.index_select(0, d) - plane.index_select(0, c))
        found.append(above + fy * (below - above))
    return found


@no_type_check
def meet(ray, light, planes, size, g, t, phase):
    """At t [mm] down the ray: boundary depths under M, the way KM the light came inside, the boundaries
    along it, the share scattered to the eye per layer and g (phase × irradiance, relative), and cosθ.

    `g` (layers, 1 or channels), with points behind where it is a map; the share is a list alike.

    The plane the light enters through turns from the tangent plane at P into the fitted plane as
    M moves from the start to the end of the ray.
    Source: François et al. 2006, Algorithm 2; Norberg 2010; weights of the planes as in their eq. 9.
    """
    x, y, dx, dy, length, view_n, view_s, offset, n_s, nearer = ray.unbind(0)
    light_n, light_s, aside_x, aside_y, light_view, nearness, first, second = light[:8].unbind(0)
    fraction = t / length
    rest = 1 - fraction
    # N_M = rest N_P + fraction NS, not of unit length
    shrink = torch.rsqrt(rest * rest + fraction * fraction + 2 * rest * fraction * n_s)
    # the light from M: L - P + (P - M), scaled to unit length
    near = nearness * t
    stretch = torch.rsqrt((1 + near * (2 * light_view + near)).clamp_min(1e-4))
    facing = (rest * (light_n + near * view_n) + fraction * (light_s + near * view_s)) * stretch * shrink
    cosine = facing.clamp_min(LEAST_LIGHT_COS)
    height = (t * (rest * view_n + fraction * view_s) + fraction * offset * (rest + fraction * n_s)).abs()
    way = height * shrink / cosine  # ‖K'M‖
    mx, my = x + t * dx, y + t * dy
    depth = look_up(planes, size, mx, my)
    reach = way * stretch
    entry = look_up(planes, size, mx + reach * (aside_x - near * dx), my + reach * (aside_y - near * dy))
    boundary = [0.5 * (m + k) / cosine for m, k in zip(depth, entry)]
    # a light half as far from M as from P is four times as bright
    arrives = (first + (second - first) * (fraction * nearer).clamp_max(1.0)) * stretch * stretch
    arrives = torch.where(facing > 0, arrives, 0.0)
    straight = (light_view + near) * stretch  # ω_in · ω_o
    share = [[arrives * scattered(straight, k, phase) for k in layer.unbind(0)] for layer in g.unbind(0)]
    return depth, way, boundary, share, cosine


@no_type_check
def scattered(cosine, g, phase):
    """Phase function [1/sr]; `cosine` between light and eye, both seen from M: -1 is straight on.

    Sources: Henyey & Greenstein 1941; Blasi et al. 1993 (Schlick), where g is their k.
    """
    if phase == "schlick":
        base = 1 + g * cosine
        return (1 - g * g) / (4 * math.pi * base * base)
    base = 1 + g * g + 2 * g * cosine
    return (1 - g * g) / (4 * math.pi * base * torch.sqrt(base))


@no_type_check
def optical(way, boundary, sigma_t):
    """Optical depth over the first `way` [mm] of a path that crosses `boundary`s [mm]: 0 below the last
    one, unless there is a layer more than boundaries. `sigma_t`: per layer [1/mm]."""
    layers = len(sigma_t)
    total = 0.0
    for i in range(len(boundary)):
        below = sigma_t[i + 1] if i + 1 < layers else 0.0
        total = total + (sigma_t[i] - below) * torch.minimum(way, boundary[i])
    if layers > len(boundary):
        total = total + sigma_t[-1] * way
    return total


@no_type_check
def mean_transmission(start, end, at_start, at_end):
    """Mean of e^-T over a stretch on which T runs evenly from `start` to `end`; `at_…` are e^-T there."""
    x = end - start
    small = x.abs() < SERIES
    series = at_start * (1 - x / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5 * (1 - x / 6)))))
    return torch.where(small, series, (at_start - at_end) / torch.where(small, 1.0, x))
