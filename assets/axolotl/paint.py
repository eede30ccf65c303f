"""Colours and layer maps as functions of the position on the surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from fields import Array, fractal, hash_cells, smoothstep, unit
from mesh import Faces, evaluate, vertex_normals
from shape import Axolotl
from veins import Veins

# Diffuse reflectances, sRGB-encoded.
CREAM = (0.945, 0.815, 0.770)
ROSE = (0.925, 0.690, 0.665)
FIN_PINK = (0.930, 0.650, 0.640)
STALK_RED = (0.840, 0.440, 0.450)
FRINGE_RED = (0.640, 0.130, 0.215)
FRINGE_TIP = (0.760, 0.250, 0.310)
FLUSH = (0.925, 0.560, 0.560)
FRECKLE = (0.700, 0.520, 0.450)
VIOLET = (0.690, 0.560, 0.690)
PUPIL = (0.060, 0.045, 0.055)
RING = (0.860, 0.740, 0.560)
LIP = (0.820, 0.540, 0.530)


def linear(colour: tuple[float, ...]) -> Array:
    """Decode an sRGB colour."""
    c = np.asarray(colour)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def encode(c: Array) -> Array:
    """Encode linear light as sRGB."""
    c = np.clip(c, 0.0, 1.0)
    return np.where(c <= 0.0031308, c * 12.92, 1.055 * np.maximum(c, 1e-9) ** (1 / 2.4) - 0.055)


def mix(a: Array, colour: tuple[float, ...], weight: Array) -> Array:
    """Blend towards an sRGB colour, in linear light."""
    w = np.clip(weight, 0.0, 1.0)[:, None]
    return a * (1.0 - w) + linear(colour) * w


def vertex_features(animal: Axolotl, p: Array, faces: Faces) -> dict[str, Array]:
    """Slowly varying features, evaluated at the vertices and interpolated to the texels."""
    parts = animal.parts(p)
    normal = vertex_normals(p, faces)
    arc, _, height, over = animal.spine.locate(p)
    arc = np.clip(arc, 0.0, animal.spine.length)
    get = {name: f(arc) for name, f in animal.profile.items()}
    edge = np.where(height > 0.0, get["top"], get["low"])
    muscle = np.where(height > 0.0, get["above"], get["below"])
    on_trunk = smoothstep(2.0, 0.5, parts.body) * (over == 0.0)
    fin = smoothstep(0.0, 1.0, (np.abs(height) - muscle) / np.maximum(edge - muscle, 1.5))
    fringe = smoothstep(-0.2, 0.8, np.minimum(parts.stalks, parts.body) - parts.filaments)
    fringe = fringe * (parts.filaments < 0.8)
    stalk = smoothstep(-1.0, 6.0, parts.body - parts.stalks) * smoothstep(4.0, 1.5, parts.stalks)
    # How much tissue lies behind the surface, in units of 3 mm.
    depth = np.clip(-evaluate(animal, p - normal * 3.0) / 3.0, 0.0, 1.0)
    return {
        "fin": fin * on_trunk * (edge > muscle + 0.5) * (1.0 - stalk) * (1.0 - fringe),
        "fringe": fringe,
        "fringe_t": parts.filament_t * fringe,
        "stalk": np.maximum(stalk, fringe),
        "stalk_t": parts.stalk_t * np.maximum(stalk, fringe),
        "limb": smoothstep(0.0, 5.0, parts.body - parts.legs) * (1.0 - np.maximum(stalk, fringe)),
        "toe": smoothstep(3.0, 0.3, animal.toes(p, 9.0)) * (1.0 - fringe),
        "depth": depth,
        "down": smoothstep(0.25, -0.8, normal[:, 1]),
    }


def freckles(p: Array) -> Array:
    """Sparse soft spots: jittered lattice points with random size and presence."""
    cell = 3.4
    base = np.floor(p / cell)
    out = np.zeros(len(p))
    for i in range(27):
        offset = np.array([i % 3, i // 3 % 3, i // 9]) - 1.0
        corner = (base + offset) * cell + 0.5 * cell
        cell_id = (base + offset).astype(np.int64)
        jitter = np.stack([hash_cells(cell_id, 40 + k) for k in range(3)], axis=1) * 2.0 - 1.0
        rank = hash_cells(cell_id, 50) * 2.0 - 1.0
        centre = corner + jitter * cell * 0.45
        radius = 0.25 + 0.45 * smoothstep(-0.2, 0.9, rank)
        d = np.linalg.norm(p - centre, axis=1)
        out = np.maximum(out, smoothstep(1.5, 0.4, d / radius) * (rank > -0.15))
    return out


def paint(
    animal: Axolotl,
    p: Array,
    faces: Faces,
    at: Array,
    interpolate: Callable[[Array], Array],
) -> dict[str, Array]:
    """The maps at surface points ``at``; ``interpolate`` spreads vertex values to them."""
    features = vertex_features(animal, p, faces)
    f = dict(zip(features, interpolate(np.stack(list(features.values()), axis=1)).T, strict=True))
    head = animal.to_head(at)
    mirrored = np.abs(head * [1.0, 0.0, 0.0]) + head * [0.0, 1.0, 1.0]
    vein = Veins(animal, p, faces).mask(at)
    in_head = smoothstep(-22.0, -10.0, head[:, 2]) * (1.0 - f["stalk"])
    trunk = (1.0 - f["stalk"]) * (1.0 - f["limb"])
    cloud = fractal(at, 16.0, 4, 2)
    fine = fractal(at, 2.2, 3, 9)

    colour = np.broadcast_to(linear(CREAM), at.shape)
    colour = mix(colour, ROSE, 0.22 + 0.25 * cloud + 0.55 * f["down"])
    thin = (1.0 - f["depth"]) * (1.0 - f["fringe"])
    colour = mix(colour, FIN_PINK, 0.55 * f["fin"] ** 1.3 + 0.25 * thin)
    colour = mix(colour, FLUSH, 0.50 * f["toe"] * (0.7 + 0.3 * fine))
    blush = np.exp(-np.sum(((mirrored - [20.0, -2.0, 6.0]) / [9.0, 6.5, 8.0]) ** 2, axis=1))
    gill_root = np.exp(-np.sum(((mirrored - [19.0, 1.0, -18.0]) / [9.0, 10.0, 7.0]) ** 2, axis=1))
    nose = np.exp(-np.sum(((head - [0.0, 0.0, 29.0]) / [9.0, 5.0, 7.0]) ** 2, axis=1))
    colour = mix(colour, FLUSH, 0.60 * blush + 0.35 * gill_root * in_head + 0.22 * nose)
    line, present = animal.mouth_height(head)
    lip = np.exp(-(((head[:, 1] - line) / 0.8) ** 2)) * present * in_head * (head[:, 2] > -8.0)
    colour = mix(colour, LIP, 0.70 * lip)

    upper = smoothstep(-0.2, -0.9, f["down"] - 1.0)
    patchy = smoothstep(-0.1, 0.5, fractal(at, 24.0, 2, 70))
    colour = mix(colour, FRECKLE, 0.30 * freckles(at) * upper * patchy * trunk * (1.0 - f["fin"]))
    colour = mix(colour, VIOLET, 0.34 * vein * (1.0 - f["stalk"]))

    # Gills: red deepens along the stalk and in the fringe, tips a little lighter.
    colour = mix(colour, STALK_RED, f["stalk"] * (0.55 + 0.45 * f["stalk_t"]))
    colour = mix(colour, FRINGE_RED, f["fringe"] * (0.92 + 0.15 * fine))
    colour = mix(colour, FRINGE_TIP, f["fringe"] * smoothstep(0.55, 1.0, f["fringe_t"]) * 0.6)
    colour = colour * (1.0 + 0.035 * fine + 0.03 * cloud)[:, None]

    eye = np.zeros(len(at))
    for centre in animal.eyes:
        gaze = unit(np.array([0.74 * np.sign(centre[0]), 0.40, 0.54]))
        rel = head - centre
        near = np.linalg.norm(rel, axis=1) < 4.6
        angle = np.degrees(np.arccos(np.clip(unit(rel) @ gaze, -1.0, 1.0)))
        on_eye = near * smoothstep(80.0, 72.0, angle)
        colour = mix(colour, (0.30, 0.20, 0.20), on_eye)
        ring = smoothstep(40.0, 42.5, angle) * smoothstep(51.0, 47.0, angle)
        colour = mix(colour, PUPIL, near * smoothstep(68.0, 60.0, angle))
        colour = mix(colour, RING, near * ring * 0.85)
        eye = np.maximum(eye, on_eye)

    thickness = 0.80 + 0.10 * cloud + 0.05 * fine - 0.22 * f["down"] - 0.30 * thin
    thickness -= 0.25 * f["fin"] + 0.25 * f["toe"] + 0.25 * lip + 0.45 * f["stalk"]
    thickness -= 0.12 * f["fringe"]
    rough = 0.36 + 0.035 * fine + 0.03 * cloud - 0.05 * f["down"] - 0.06 * f["stalk"]
    rough = rough - 0.03 * f["fin"] - 0.04 * nose - 0.15 * eye
    vessel = np.maximum(vein * (1.0 - f["fringe"]), 0.75 * f["fringe"]) * (1.0 - eye)
    return {
        "albedo": encode(colour),
        "veins": vessel,
        "thickness": np.clip(np.where(eye > 0.5, 0.15, thickness), 0.08, 1.0),
        "roughness": np.clip(rough, 0.25, 0.45),
    }
