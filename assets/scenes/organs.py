"""Organs, vessels and scales of the animal, painted as functions of the position on its surface.

What lies near the surface is painted bright; the scenes turn that into thicknesses of layers.
"""

from __future__ import annotations

import numpy as np
from fields import Array, fractal, hash_cells, smoothstep
from shape import Axolotl

VERTEBRA = 4.6  # from one to the next, mm


def ellipse(
    x: Array, y: Array, centre: tuple[float, float], radii: tuple[float, float], soft: float
) -> Array:
    """1 inside an ellipse, 0 outside, over a wall `soft` wide relative to its size."""
    r = np.hypot((x - centre[0]) / radii[0], (y - centre[1]) / radii[1])
    return smoothstep(1.0 + soft, 1.0 - soft, r)


def skeleton(arc: Array, height: Array, length: float) -> Array:
    """The column with spines above and below it in the tail, and short ribs in the trunk."""
    taper = smoothstep(length, 0.35 * length, arc)
    above = height - 2.2
    phase = (arc / VERTEBRA + 0.5) % 1.0 - 0.5
    body = np.hypot(phase / 0.40, above / (0.9 + 1.1 * taper))
    column = smoothstep(1.25, 0.75, body)
    # spines lean towards the tail
    lean = ((arc - 0.45 * np.abs(above)) / VERTEBRA + 0.5) % 1.0 - 0.5
    reach = np.where(above > 0, 5.0 + 5.0 * smoothstep(80.0, 130.0, arc), 9.0 * smoothstep(92.0, 125.0, arc))
    reach = np.maximum(reach * taper**0.5, 0.1)
    spine = smoothstep(0.26, 0.10, np.abs(lean)) * smoothstep(1.0, 0.6, np.abs(above) / reach)
    rib = ((arc - 0.8 * np.abs(above)) / VERTEBRA + 0.5) % 1.0 - 0.5
    trunk = smoothstep(16.0, 24.0, arc) * smoothstep(96.0, 84.0, arc) * (above < 0)
    ribs = smoothstep(0.20, 0.08, np.abs(rib)) * smoothstep(8.5, 5.5, -above) * trunk
    present = smoothstep(4.0, 9.0, arc) * smoothstep(length - 4.0, length - 16.0, arc)
    return np.maximum(np.maximum(column, 0.85 * spine), 0.7 * ribs) * present


def entrails(arc: Array, height: Array, at: Array) -> tuple[Array, Array]:
    """What is full of blood (heart, liver), and what is not (stomach, gut)."""
    wobble = 1.4 * fractal(at, 9.0, 2, 210)
    h = height + wobble
    red = np.maximum(
        ellipse(arc, h, (13.0, -6.0), (5.0, 3.6), 0.25), ellipse(arc, h, (34.0, -6.0), (13.0, 5.0), 0.22)
    )
    stomach = ellipse(arc, h + 0.12 * (arc - 58.0), (58.0, -5.5), (11.0, 4.4), 0.22)
    coil = np.abs(h + 6.0 - 4.2 * np.sin((arc - 68.0) * 0.62))
    gut = smoothstep(2.0, 1.0, coil) * smoothstep(66.0, 70.0, arc) * smoothstep(96.0, 88.0, arc)
    return red, np.maximum(stomach, gut)


def organs(animal: Axolotl, at: Array, veins: Array) -> dict[str, Array]:
    """`fish-organs`, 1 where something dark lies beneath, and `fish-blood`, 1 where blood is deepest."""
    parts = animal.parts(at)
    on_body = smoothstep(1.2, 0.0, parts.body)
    arc, _, height, _ = animal.spine.locate(at)
    head = animal.to_head(at)
    behind = smoothstep(-14.0, -20.0, head[:, 2])
    bone = skeleton(arc, height, animal.spine.length) * behind * on_body
    red, pale = (x * behind * on_body for x in entrails(arc, height, at))
    mirrored = np.abs(head[:, 0])
    roof = smoothstep(0.0, 4.0, head[:, 1])
    brain = np.maximum(
        ellipse(mirrored, head[:, 2], (2.6, 2.0), (3.0, 5.5), 0.3),
        ellipse(mirrored, head[:, 2], (0.0, -7.0), (3.4, 5.0), 0.3),
    )
    ear = ellipse(mirrored, head[:, 2], (10.5, -9.0), (2.6, 3.6), 0.3)
    skull = np.maximum(brain, 0.7 * ear) * roof
    eyes = np.max([smoothstep(4.7, 4.2, np.linalg.norm(head - c, axis=1)) for c in animal.eyes], axis=0)
    gills = smoothstep(0.3, 1.2, parts.body - np.minimum(parts.stalks, parts.filaments)) * 0.45
    # folds of muscle, as faint chevrons along the tail
    fold = np.abs((((arc - 0.6 * np.abs(height - 2.0)) / 6.6) % 1.0) - 0.5)
    muscle = 0.22 * smoothstep(0.16, 0.02, fold) * smoothstep(60.0, 90.0, arc) * on_body * behind
    dark = np.max([bone, 0.9 * red, pale, skull, eyes, muscle], axis=0)
    dark = np.clip(dark + 0.12 * fractal(at, 7.0, 3, 220) * (1 - dark), 0.0, 1.0)
    # flesh full of blood, but for what displaces it; vessels in front of all
    flesh = np.maximum(0.22 + 0.08 * fractal(at, 5.0, 3, 230), gills) * (1 - np.clip(dark, 0, 1))
    blood = np.max([0.9 * veins * (1 - eyes), flesh, 0.35 * red], axis=0)
    return {"fish-organs": dark, "fish-blood": blood}


def scales(at: Array, cell: float) -> tuple[Array, Array]:
    """Round scales: 1 in the middle of each, 0 in the furrows between; and a random value per scale."""
    base = np.floor(at / cell)
    nearest, second = np.full(len(at), 1e9), np.full(len(at), 1e9)
    owner = np.zeros(len(at))
    for i in range(27):
        corner = base + (np.array([i % 3, i // 3 % 3, i // 9]) - 1.0)
        cell_id = corner.astype(np.int64)
        jitter = np.stack([hash_cells(cell_id, 300 + k) for k in range(3)], axis=1)
        gap = np.linalg.norm(at - (corner + 0.15 + 0.7 * jitter) * cell, axis=1)
        owner = np.where(gap < nearest, hash_cells(cell_id, 310), owner)
        second = np.minimum(np.maximum(nearest, gap), second)
        nearest = np.minimum(nearest, gap)
    # how far within its cell a place lies: 0 at the border
    inside = np.clip((second - nearest) / (0.55 * cell), 0.0, 1.0)
    return np.sqrt(1.0 - (1.0 - inside) ** 2), owner


def gecko(animal: Axolotl, at: Array) -> dict[str, Array]:
    """`gecko-scales`, 1 on top of a scale, and `gecko-spots`, 1 where there is dark pigment below."""
    bump, rank = scales(at, 4.0)
    large, _ = scales(at + 0.8 * fractal(at, 8.0, 2, 320)[:, None], 11.0)
    back = smoothstep(-0.1, 0.5, fractal(at, 30.0, 2, 330) + 0.25)
    spots = smoothstep(0.45, 0.75, large) * back
    return {"gecko-scales": bump * (0.75 + 0.25 * rank), "gecko-spots": spots}
