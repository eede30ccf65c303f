"""Directions spread evenly over the solid angle of a parallelogram, as two spherical triangles."""

import math

import torch

from texsss.types import Float, Tensor, unit

LEAST_SR = 1e-9  # below it directions differ by less than float64 tells


def towards(
    corner: Float[Tensor, "P 3"],
    width: Float[Tensor, "3"],
    height: Float[Tensor, "3"],
    square: Float[Tensor, "P 2"],
) -> tuple[Float[Tensor, "P 3"], Float[Tensor, " P"]]:
    """Unit directions into the panel, uniform in solid angle, and that solid angle [sr].

    `corner` (P, 3): one corner of the panel seen from each point; `width`, `height`: its edges, all in one
    unit. `square` (P, 2) in 0..1² is mapped without tearing strata apart, but for the diagonal. float64.
    Source: Arvo 1995.
    """
    corner, width, height, square = (x.double() for x in (corner, width, height, square))
    a, b, c, d = (unit(x) for x in (corner, corner + width, corner + width + height, corner + height))
    first, second = _excess(a, b, c), _excess(a, c, d)
    total = first + second
    share = first / total.clamp_min(1e-300)
    u = square[:, 0]
    in_first = u < share
    within = torch.where(in_first, u / share.clamp_min(1e-300), (u - share) / (1 - share).clamp_min(1e-300))
    near = torch.where(in_first[:, None], b, c)
    far = torch.where(in_first[:, None], c, d)
    return _within(a, near, far, within.clamp(0, 1), square[:, 1]), total


def _excess(a: Tensor, b: Tensor, c: Tensor) -> Float[Tensor, " P"]:
    """Solid angle of spherical triangles [sr]. Source: van Oosterom & Strackee 1983."""
    triple = (a * torch.linalg.cross(b, c)).sum(-1).abs()
    return 2 * torch.atan2(triple, 1 + _dot(a, b) + _dot(b, c) + _dot(c, a)).clamp(0, 2 * math.pi)


def _within(a: Tensor, b: Tensor, c: Tensor, u: Tensor, v: Tensor) -> Float[Tensor, "P 3"]:
    """Unit directions in spherical triangles: the part `u` of the area, then the part `v` of a great arc."""
    ab, bc, ca = (unit(torch.linalg.cross(x, y)) for x, y in ((a, b), (b, c), (c, a)))
    alpha, beta, gamma = _angle(ab, -ca), _angle(bc, -ab), _angle(ca, -bc)
    phi = u * (alpha + beta + gamma - math.pi) - alpha
    sine, cosine = torch.sin(phi), torch.cos(phi)
    # the side from a to c is cut where the triangle a b c' has the area asked for
    p, q = cosine - torch.cos(alpha), sine + torch.sin(alpha) * _dot(a, b)
    over = (q * cosine - p * sine) * torch.cos(alpha) - q
    below = (q * sine + p * cosine) * torch.sin(alpha)
    cut = (over / torch.where(below == 0, 1e-300, below)).clamp(-1, 1)
    aside = torch.sqrt((1 - cut * cut).clamp_min(1e-30))
    at = cut[:, None] * a + aside[:, None] * unit(c - _dot(c, a)[:, None] * a)
    drop = v * (1 - _dot(at, b))
    sine = torch.sqrt((drop * (2 - drop)).clamp_min(1e-30))
    return unit((1 - drop)[:, None] * b + sine[:, None] * unit(at - _dot(at, b)[:, None] * b))


def _angle(a: Tensor, b: Tensor) -> Float[Tensor, " P"]:
    return torch.atan2(torch.linalg.vector_norm(torch.linalg.cross(a, b), dim=-1), _dot(a, b))


def _dot(a: Tensor, b: Tensor) -> Float[Tensor, " P"]:
    return (a * b).sum(-1)
