"""Legs with toes, and gills with their fringe, as tubes around curves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from fields import Array, Tubes, spline_points, unit
from scipy.spatial import cKDTree


class SpineLike(Protocol):
    """What the legs need to know of the body's centre line."""

    def frame(self, arc: float) -> tuple[Array, Array, Array]: ...


# Per leg: arc length of the joint, side (+1 is the animal's left), then joint positions as
# (outward, height above the floor, forward) in mm, the heading of the foot in degrees
# outward from straight ahead, and the toes as (spread in degrees, length).
LEGS = [
    (
        30.0,
        1,
        [(9, 15, 0), (20, 13.5, -3), (28, 9, 1), (32, 4.2, 8), (33.5, 2.6, 12)],
        20.0,
        "front",
    ),
    (
        30.0,
        -1,
        [(9, 15, 0), (20, 13.5, -4), (28, 9, -6), (33, 4.2, -2), (35.5, 2.6, 1)],
        38.0,
        "front",
    ),
    (
        106.0,
        1,
        [(6, 15, 0), (16, 14.5, 4), (25, 11, 6), (31, 5.0, -1), (34, 2.8, -1)],
        52.0,
        "hind",
    ),
    (
        106.0,
        -1,
        [(6, 15, 0), (16, 14.0, 4), (26, 10.5, 9), (32, 5.0, 5), (35, 2.8, 6)],
        42.0,
        "hind",
    ),
]
TOES = {
    "front": [(-48, 9.0), (-17, 11.8), (14, 11.5), (46, 8.5)],
    "hind": [(-62, 8.5), (-32, 11.4), (-4, 12.6), (24, 11.8), (52, 8.8)],
}
LEG_RADII = {"front": [6.2, 5.4, 4.4, 3.4, 2.6], "hind": [7.4, 6.4, 5.0, 3.7, 2.8]}


def build_legs(spine: SpineLike) -> tuple[Tubes, Tubes]:
    """Tubes of the four legs (palms included in the toes) and of all toes."""
    legs, toes = [], []
    for arc, side, joints, heading, kind in LEGS:
        origin, tangent, lateral = spine.frame(arc)
        forward, outward = -tangent, lateral * side
        place = np.array([[origin[0], h, origin[2]] + outward * o + forward * f for o, h, f in joints])
        legs.append((place, np.array(LEG_RADII[kind])))
        palm = place[-1]
        for spread, length in TOES[kind]:
            a = np.radians(heading + spread)
            d = forward * np.cos(a) + outward * np.sin(a)
            bend = np.radians(heading + spread * 0.75)
            d2 = forward * np.cos(bend) + outward * np.sin(bend)
            up = np.array([0.0, 1.0, 0.0])
            pts = np.array(
                [
                    palm - d * 0.5,
                    palm + d * (length * 0.4) - up * 0.3,
                    palm + d * (length * 0.55) + d2 * (length * 0.25) - up * 0.9,
                    palm + d * (length * 0.55) + d2 * (length * 0.62) - up * 1.35,
                ]
            )
            toes.append((pts, np.array([2.5, 1.9, 1.6, 1.1])))
    return Tubes(legs), Tubes(toes)


# Stalks of the animal's left side in head coordinates: control points.
STALKS = [
    [(12, 6, -14), (16, 16, -19), (20, 28, -22), (26, 39, -25), (35, 47, -31)],
    [(17, 2, -16), (27, 9, -21), (38, 16, -25), (49, 19, -32), (58, 18, -42)],
    [(18, -4, -13), (27, -5.5, -18), (36, -6.5, -23), (45, -6.5, -30), (53, -9, -38)],
]
STALK_RADII = np.array([4.0, 3.0, 2.3, 1.6, 0.9])
FRINGE_PER_ROW = 23
LONGEST = 13.0


def build_gills(
    from_head: Callable[[Array], Array], clearance: Callable[[Array], Array]
) -> tuple[Tubes, Tubes, Array]:
    """Tubes of the six stalks, of the fringe filaments, and each filament's stalk."""
    rng = np.random.default_rng(11)
    stalks, stalks_local, candidates = [], [], []
    for side in (1.0, -1.0):
        for rank, control in enumerate(STALKS):
            pts = np.array(control, dtype=np.float64)
            # Left and right differ a little, as in a living animal.
            grow = 1.0 + rng.uniform(-0.05, 0.05)
            pts = pts[0] + (pts - pts[0]) * grow
            pts[2:] += rng.normal(0.0, 0.8, (len(pts) - 2, 3))
            pts[:, 0] *= side
            curve, radius = spline_points(pts, STALK_RADII, 0.4)
            index = len(stalks)
            stalks.append((from_head(pts), STALK_RADII))
            stalks_local.append((pts, STALK_RADII))
            candidates += _fringe(curve, radius, index, rank, side, rng)
    trunks = [spline_points(from_head(c[0]), STALK_RADII, 0.4) for c in stalks_local]
    fringe = _without_collisions(candidates, from_head, clearance, trunks)
    curves = [(from_head(pts), rad) for pts, rad, _ in fringe]
    return Tubes(stalks), Tubes(curves, 0.3), np.array([owner for _, _, owner in fringe])


def _fringe(
    curve: Array, radius: Array, index: int, rank: int, side: float, rng: np.random.Generator
) -> list[tuple[Array, Array, int]]:
    """Two rows of filaments along one stalk, in head coordinates."""
    tangent = unit(np.gradient(curve, axis=0))
    out = []
    for row in (-1.0, 1.0):
        for j in range(FRINGE_PER_ROW):
            t = 0.20 + 0.78 * (j + 0.5 * (row > 0)) / (FRINGE_PER_ROW - 0.5)
            i = int(t * (len(curve) - 1))
            along = tangent[i]
            facing = unit(np.array([0.25 * side, 0.15, 1.0]))
            facing = unit(facing - along * (facing @ along))
            across = np.cross(along, facing) * row
            profile = np.sin(np.pi * min(t * 0.84 + 0.04, 1.0)) ** 0.8
            length = LONGEST * profile * rng.uniform(0.88, 1.08)
            lean = 0.45 + 0.75 * t**3 + rng.normal(0.0, 0.05)
            # Alternate filaments lie in two planes, which makes room for a dense fringe.
            back = (0.05 if j % 2 else 0.75) + rng.normal(0.0, 0.08)
            first = unit(across + along * lean - facing * back)
            # Tips curl towards the end of the stalk and sag a little.
            last = unit(first + along * 0.55 - np.array([0.0, 0.30, 0.0]) - facing * 0.1)
            root = curve[i] + (across * 0.45 - facing * back * 0.6) * radius[i]
            reach = length + radius[i] * 0.7
            pts = np.array(
                [
                    root,
                    root + first * reach * 0.35,
                    root + first * reach * 0.60 + last * reach * 0.08,
                    root + first * reach * 0.68 + last * reach * 0.32,
                ]
            )
            out.append((pts, np.array([1.0, 0.88, 0.8, 0.68]), index))
    return out


def _without_collisions(
    fringe: list[tuple[Array, Array, int]],
    from_head: Callable[[Array], Array],
    clearance: Callable[[Array], Array],
    stalks: list[tuple[Array, Array]],
    gap: float = 0.8,
) -> list[tuple[Array, Array, int]]:
    """Shorten filaments until they keep ``gap`` mm from everything and clear the floor."""
    kept: list[tuple[Array, Array, int]] = []
    cloud: list[Array] = []
    for pts, rad, owner in fringe:
        root = pts[0]
        others = np.concatenate([c for i, (c, _) in enumerate(stalks) if i != owner])
        widths = np.concatenate([r for i, (_, r) in enumerate(stalks) if i != owner])
        trees = cKDTree(others)
        for scale in (1.0, 0.85, 0.7, 0.55):
            trial = root + (pts - root) * scale
            dense, thick = spline_points(trial, rad, 0.3)
            world = from_head(dense)
            free = world[int(0.24 * len(dense)) :]
            thick = thick[int(0.24 * len(dense)) :]
            if world[:, 1].min() < 1.6 or (clearance(free) - thick).min() < gap + 0.5:
                continue
            d, near = trees.query(free)
            if (d - widths[near] - thick).min() < gap + 0.3:
                continue
            if cloud:
                d, _ = cKDTree(np.concatenate(cloud)).query(free)
                if (d - 0.85 - thick).min() < gap:
                    continue
            kept.append((trial, rad, owner))
            cloud.append(free)
            break
    return kept
