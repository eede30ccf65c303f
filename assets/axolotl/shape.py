"""The axolotl as a signed-distance field (mm, y up, head towards +z)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from fields import Array, ellipsoid, noise, smooth_max, smooth_min, smoothstep, unit
from limbs import build_gills, build_legs
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial import cKDTree

# Centre line from the neck to the tip of the tail. Seen from above it is an S whose tail
# sweeps towards +x, so that a three-quarter front view sees the flat of the tail fin.
SPINE = np.array(
    [
        [4.0, 22.0, 62.0],
        [1.0, 20.5, 46.0],
        [-4.0, 18.0, 26.0],
        [-8.0, 17.0, 4.0],
        [-8.5, 16.8, -18.0],
        [-4.0, 17.5, -40.0],
        [8.0, 18.0, -59.0],
        [26.0, 18.5, -73.0],
        [47.0, 18.5, -82.0],
        [67.0, 18.0, -92.0],
        [82.0, 18.0, -106.0],
    ]
)

# Profiles against arc length (mm): half width, height above and depth below the centre line.
STATION = [0.0, 15.0, 35.0, 60.0, 82.0, 104.0, 122.0, 145.0, 168.0, 192.0, 205.0, 214.0]
WIDTH = [14.0, 15.5, 18.5, 20.5, 19.0, 14.5, 10.0, 6.8, 4.3, 2.2, 1.5, 0.9]
ABOVE = [10.0, 11.5, 14.0, 15.5, 15.0, 13.0, 11.0, 8.4, 5.8, 3.2, 2.0, 0.9]
BELOW = [9.0, 12.0, 15.0, 16.0, 15.0, 13.0, 10.5, 8.2, 5.6, 3.2, 2.0, 0.9]
# Edge of the fin above and below the centre line.
FIN_TOP = [0.0, 4.0, 10.0, 15.5, 18.0, 20.5, 23.0, 24.0, 22.0, 15.5, 9.6, 1.5]
FIN_LOW = [0.0, 0.0, 0.0, 0.0, 3.0, 8.0, 13.5, 16.5, 16.0, 11.5, 7.4, 1.5]

HEAD_CENTRE = np.array([6.0, 25.0, 76.0])
HEAD_YAW = np.radians(11.0)
HEAD_PITCH = np.radians(9.0)


class Spine:
    """Maps points to (arc length, lateral offset, height, overshoot) along the body."""

    def __init__(self) -> None:
        knots = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(SPINE, axis=0), axis=1))]
        curve = CubicSpline(knots, SPINE)
        t = np.linspace(0.0, knots[-1], 1200)
        self.points = curve(t)
        step = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        self.arc = np.r_[0.0, np.cumsum(step)]
        self.length = float(self.arc[-1])
        flat = curve(t, 1)
        flat[:, 1] = 0.0
        self.tangent = unit(flat)
        self.side = np.stack([-self.tangent[:, 2], 0 * t, self.tangent[:, 0]], axis=1)
        # Projection in the horizontal plane keeps the tall fins single-valued.
        self.tree = cKDTree(self.points[:, [0, 2]])

    def locate(self, p: Array) -> tuple[Array, Array, Array, Array]:
        """Arc length, lateral offset (+ is the animal's left), height, distance past an end."""
        _, i = self.tree.query(p[:, [0, 2]])
        rel = p - self.points[i]
        along = np.sum(rel * self.tangent[i], axis=1)
        inner = (i > 0) & (i < len(self.arc) - 1)
        arc = self.arc[i] + np.where(inner, along, 0.0)
        slope = np.interp(arc, self.arc, np.gradient(self.points[:, 1], self.arc))
        height = rel[:, 1] - np.where(inner, along * slope, 0.0)
        return arc, np.sum(rel * self.side[i], axis=1), height, np.where(inner, 0.0, along)

    def frame(self, arc: float) -> tuple[Array, Array, Array]:
        """Point, tangent towards the tail, and lateral direction at an arc length."""
        i = int(np.argmin(np.abs(self.arc - arc)))
        return self.points[i], self.tangent[i], self.side[i]


@dataclass
class Parts:
    """Distances to the parts before the final union (used for charts and painting)."""

    body: Array
    legs: Array
    leg_id: Array
    stalks: Array
    stalk_id: Array
    stalk_t: Array
    filaments: Array
    filament_id: Array
    filament_t: Array
    total: Array


class Axolotl:
    """Signed-distance model; every method takes points of shape (n, 3)."""

    def __init__(self) -> None:
        self.spine = Spine()
        scale = self.spine.length / STATION[-1]
        station = np.array(STATION) * scale
        self.profile = {
            name: PchipInterpolator(station, values)
            for name, values in (
                ("width", WIDTH),
                ("above", ABOVE),
                ("below", BELOW),
                ("top", FIN_TOP),
                ("low", FIN_LOW),
            )
        }
        cy, sy = np.cos(HEAD_YAW), np.sin(HEAD_YAW)
        cp, sp = np.cos(HEAD_PITCH), np.sin(HEAD_PITCH)
        yaw = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        pitch = np.array([[1.0, 0.0, 0.0], [0.0, cp, sp], [0.0, -sp, cp]])
        self.head_axes = yaw @ pitch
        self.eyes = self._place_eyes()
        self.legs, self.toes = build_legs(self.spine)
        self.stalks, self.filaments, self.filament_stalk = build_gills(self.from_head, self._without_gills)

    def to_head(self, p: Array) -> Array:
        """World to head coordinates (x to the animal's left, y up, z forward)."""
        return (p - HEAD_CENTRE) @ self.head_axes

    def from_head(self, q: Array) -> Array:
        """Head to world coordinates."""
        return np.asarray(q) @ self.head_axes.T + HEAD_CENTRE

    def _skull(self, q: Array) -> Array:
        """Head without eyes and mouth, in head coordinates, mirrored in x."""
        q = np.abs(q * [1.0, 0.0, 0.0]) + q * [0.0, 1.0, 1.0]
        f = ellipsoid(q, (0.0, 0.0, -4.0), (24.0, 12.6, 23.0))
        f = smooth_min(f, ellipsoid(q, (0.0, -1.6, 14.5), (19.5, 8.8, 16.0)), 9.0)
        f = smooth_min(f, ellipsoid(q, (15.0, -2.5, -6.0), (13.0, 10.5, 15.0)), 9.0)
        f = smooth_min(f, ellipsoid(q, (0.0, -4.8, 7.0), (19.5, 8.2, 20.5)), 6.0)
        # Brow: a low swelling that carries the eye.
        f = smooth_min(f, ellipsoid(q, (15.0, 3.6, 11.0), (6.0, 5.2, 7.0)), 6.0)
        # Shallow trough between the brows, and the nostrils.
        f = f + 0.8 * np.exp(-((q[:, 0] / 6.5) ** 2) - ((q[:, 2] - 9.0) / 9.0) ** 2) * (q[:, 1] > 0)
        nostril = np.linalg.norm(q - [6.6, 2.6, 28.4], axis=1)
        return f + 1.1 * np.exp(-((nostril / 1.25) ** 2))

    def mouth_height(self, q: Array) -> tuple[Array, Array]:
        """Height of the lip line for the azimuth of ``q`` and how present the line is."""
        angle = np.abs(np.arctan2(q[:, 0], q[:, 2] - 2.0))
        # Lowest in front, rising steadily; then the corners turn up: the smile.
        line = -5.6 + 3.4 * smoothstep(0.0, 1.35, angle) + 3.8 * smoothstep(1.05, 1.8, angle)
        return line, smoothstep(1.78, 1.5, angle)

    def head(self, p: Array) -> Array:
        """Head with mouth and eyes."""
        q = self.to_head(p)
        f = self._skull(q)
        line, present = self.mouth_height(q)
        dy = q[:, 1] - line
        f = f + present * 1.35 * np.exp(-((dy / 0.8) ** 2))
        # A full upper lip over a slightly withdrawn jaw.
        f = f - present * 0.75 * np.exp(-(((dy - 2.0) / 1.6) ** 2))
        f = f + present * 0.35 * np.exp(-(((dy + 2.0) / 1.6) ** 2))
        for centre in self.eyes:
            d = np.linalg.norm(q - centre, axis=1)
            f = f + 0.45 * np.exp(-(((d - 3.7) / 0.7) ** 2))
            f = smooth_min(f, d - 3.2, 0.5)
        return f

    def _place_eyes(self) -> list[Array]:
        """Centres of the eyes, sunk a little below the skull surface."""
        start = np.array([11.5, 1.5, 10.5])
        direction = unit(np.array([0.76, 0.50, 0.42]))
        t = np.linspace(0.0, 25.0, 2000)
        f = self._skull(start + t[:, None] * direction)
        centre = start + direction * (t[int(np.argmax(f > 0.0))] - 1.35)
        return [centre, centre * [-1.0, 1.0, 1.0]]

    def trunk(self, p: Array) -> Array:
        """Trunk and tail with costal grooves and fins."""
        arc, u, v, over = self.spine.locate(p)
        get = {name: f(np.clip(arc, 0.0, self.spine.length)) for name, f in self.profile.items()}
        w = get["width"]
        h = np.where(v > 0.0, get["above"], get["below"])
        q = np.sqrt((u / w) ** 2 + (v / h) ** 2 + (over / w) ** 2)
        g = np.sqrt((u / w**2) ** 2 + (v / h**2) ** 2 + (over / w**2) ** 2)
        f = q * (q - 1.0) / np.maximum(g, 1e-6)
        f = np.where(q < 0.05, -np.minimum(w, h), f)
        # Costal grooves: soft vertical furrows on the flank between the legs.
        phase = (arc - 0.15 * v + 0.5 * noise(p, 9.0, 8)) / 6.6
        furrow = np.maximum(np.cos(2.0 * np.pi * phase), 0.0) ** 2
        flank = smoothstep(0.30, 0.75, np.abs(u) / w) * smoothstep(1.0, 0.55, np.abs(v) / h)
        span = smoothstep(28.0, 40.0, arc) * smoothstep(140.0, 112.0, arc)
        f = f + 0.6 * furrow * flank * span
        # Fins: a thin rippled sheet, thinner towards its edge.
        edge = np.where(v > 0.0, get["top"], get["low"])
        wave = noise(np.stack([arc, 40.0 * (v > 0), 0.0 * arc], axis=1), 11.0, 21)
        edge = edge + 0.9 * wave * smoothstep(80.0, 120.0, arc) * smoothstep(212.0, 195.0, arc)
        reach = np.clip(np.abs(v) / np.maximum(edge, 1.0), 0.0, 1.0)
        ripple = 1.1 * np.sin(arc * 0.17 + 0.06 * v) * reach**2 * smoothstep(90.0, 150.0, arc)
        thick = 1.35 - 0.45 * reach
        du = np.maximum(np.abs(u - ripple), 0.0)
        dv = np.maximum(np.abs(v) - (edge - thick), 0.0)
        fin = np.sqrt(du**2 + dv**2 + over**2) - thick
        return smooth_min(f, fin, 7.0)

    def _without_gills(self, p: Array) -> Array:
        """Distance to the animal before the gills are added."""
        body = np.minimum(self.trunk(p), self.head(p))
        return np.minimum(np.minimum(body, self.legs(p)), self.toes(p))

    def parts(self, p: Array) -> Parts:
        """All parts and their union."""
        body = smooth_min(self.trunk(p), self.head(p), 9.0)
        leg_d, leg_near = self.legs.query(p, 18.0)
        toes = self.toes(p, 9.0)
        limb = smooth_min(leg_d, toes, 1.8)
        stalk_d, stalk_near = self.stalks.query(p, 14.0)
        fil_d, fil_near = self.filaments.query(p, 6.0)
        total = smooth_min(body, limb, 5.0)
        # The belly and the soles settle on the floor.
        total = smooth_max(total, 0.6 - p[:, 1], 2.5)
        total = smooth_min(total, stalk_d, 3.0)
        bumps = noise(p, 7.0, 3) * 0.28 + noise(p, 3.2, 5) * 0.10
        calm = smoothstep(1.0, 4.0, np.minimum(fil_d, toes))
        for centre in self.eyes:
            calm = calm * smoothstep(4.0, 7.0, np.linalg.norm(self.to_head(p) - centre, axis=1))
        total = total + bumps * calm
        total = smooth_min(total, fil_d, 0.9)
        return Parts(
            body,
            limb,
            self.legs.owner[leg_near],
            stalk_d,
            self.stalks.owner[stalk_near],
            self.stalks.along[stalk_near],
            fil_d,
            self.filaments.owner[fil_near],
            self.filaments.along[fil_near],
            total,
        )

    def __call__(self, p: Array) -> Array:
        """Signed distance of the whole animal."""
        return self.parts(p).total

    def gradient(self, p: Array, eps: float = 0.05) -> Array:
        """Central-difference gradient."""
        out = np.empty_like(p)
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = eps
            out[:, axis] = (self(p + step) - self(p - step)) / (2.0 * eps)
        return out
