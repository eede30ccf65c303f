"""Distance-field building blocks shared by the parts of the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

Array = NDArray[np.float64]


def smooth_min(a: Array, b: Array, k: float) -> Array:
    """Union of two fields whose crease is rounded over a width ``k`` (mm)."""
    h = np.maximum(k - np.abs(a - b), 0.0) / k
    return np.minimum(a, b) - h * h * k * 0.25


def smooth_max(a: Array, b: Array, k: float) -> Array:
    """Intersection of two fields with a rounded crease."""
    return -smooth_min(-a, -b, k)


def smoothstep(lo: float, hi: float, x: Array) -> Array:
    """Hermite ramp from 0 at ``lo`` to 1 at ``hi`` (``hi`` < ``lo`` ramps down)."""
    t = np.clip((x - lo) / (hi - lo), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def ellipsoid(p: Array, centre: tuple[float, ...], radii: tuple[float, ...]) -> Array:
    """First-order distance to an axis-aligned ellipsoid."""
    q = p - np.asarray(centre)
    r = np.asarray(radii)
    k0 = np.linalg.norm(q / r, axis=-1)
    k1 = np.linalg.norm(q / (r * r), axis=-1)
    return k0 * (k0 - 1.0) / np.maximum(k1, 1e-9)


def unit(v: Array) -> Array:
    """Vectors scaled to length one."""
    v = np.asarray(v, dtype=np.float64)
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)


def spline_points(points: Array, radii: Array, step: float) -> tuple[Array, Array]:
    """Resample a control polyline (and its radii) along a cubic spline."""
    points = np.asarray(points, dtype=np.float64)
    radii = np.asarray(radii, dtype=np.float64)
    knots = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    count = max(int(np.ceil(knots[-1] / step)), 2) + 1
    t = np.linspace(0.0, knots[-1], count)
    kind = "natural" if len(points) > 2 else "not-a-knot"
    return CubicSpline(knots, points, bc_type=kind)(t), np.interp(t, knots, radii)


class Tubes:
    """Union of round tubes of varying radius around sampled curves."""

    def __init__(self, curves: list[tuple[Array, Array]], step: float = 0.4) -> None:
        sampled = [spline_points(pts, rad, step) for pts, rad in curves]
        self.curves = sampled
        self.points = np.concatenate([c[0] for c in sampled])
        self.radii = np.concatenate([c[1] for c in sampled])
        self.owner = np.concatenate([np.full(len(c[0]), i) for i, c in enumerate(sampled)])
        self.along = np.concatenate([np.linspace(0.0, 1.0, len(c[0])) for c in sampled])
        self.tree = cKDTree(self.points)

    def query(self, p: Array, reach: float = 1e3) -> tuple[Array, NDArray[np.intp]]:
        """Distance to the union (at most ``reach``) and the nearest curve sample."""
        gap, near = self.tree.query(p, distance_upper_bound=reach)
        out = np.full(len(p), reach)
        hit = np.isfinite(gap)
        near = np.minimum(near, len(self.points) - 1)
        out[hit] = np.minimum(self._refine(p[hit], near[hit]), reach)
        return out, near

    def _refine(self, p: Array, near: NDArray[np.intp]) -> Array:
        """Distance to the two cones that meet at the nearest sample."""
        best = np.linalg.norm(p - self.points[near], axis=1) - self.radii[near]
        last = len(self.points) - 1
        for shift in (-1, 1):
            other = np.clip(near + shift, 0, last)
            same = (self.owner[other] == self.owner[near]) & (other != near)
            a, b = self.points[near], self.points[other]
            ab = b - a
            t = np.sum((p - a) * ab, axis=1) / np.maximum(np.sum(ab * ab, axis=1), 1e-12)
            t = np.clip(t, 0.0, 1.0)
            r = self.radii[near] + t * (self.radii[other] - self.radii[near])
            d = np.linalg.norm(p - a - t[:, None] * ab, axis=1) - r
            best = np.where(same, np.minimum(best, d), best)
        return best

    def __call__(self, p: Array, reach: float = 1e3) -> Array:
        """Distance to the union, at most ``reach``."""
        return self.query(p, reach)[0]


def hash_cells(cell: NDArray[np.int64], seed: int) -> Array:
    """Pseudo-random value in [0, 1) for every integer lattice cell."""
    x = cell.astype(np.uint64)
    h = x[..., 0] * np.uint64(0x9E3779B97F4A7C15) ^ x[..., 1] * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= x[..., 2] * np.uint64(0x165667B19E3779F9) + np.uint64(seed * 7919 + 1)
    h ^= h >> np.uint64(31)
    h *= np.uint64(0xD6E8FEB86659FD93)
    h ^= h >> np.uint64(32)
    h *= np.uint64(0xD6E8FEB86659FD93)
    return (h >> np.uint64(40)).astype(np.float64) / float(1 << 24)


def noise(p: Array, scale: float, seed: int = 0) -> Array:
    """Smooth value noise in [-1, 1]; ``scale`` is the lattice spacing in mm."""
    q = p / scale
    base = np.floor(q).astype(np.int64)
    f = q - base
    f = f * f * f * (f * (f * 6.0 - 15.0) + 10.0)
    total = np.zeros(p.shape[:-1])
    for corner in range(8):
        offset = np.array([corner & 1, corner >> 1 & 1, corner >> 2 & 1])
        weight = np.prod(np.where(offset == 1, f, 1.0 - f), axis=-1)
        total += weight * hash_cells(base + offset, seed)
    return total * 2.0 - 1.0


def fractal(p: Array, scale: float, octaves: int = 4, seed: int = 0) -> Array:
    """Sum of noise octaves, each half as large and half as strong."""
    total = np.zeros(p.shape[:-1])
    for i in range(octaves):
        total += 0.5**i * noise(p, scale * 0.5**i, seed + 17 * i)
    return total / (2.0 - 0.5 ** (octaves - 1))
