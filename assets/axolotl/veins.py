"""A branching vessel network grown over the surface."""

from __future__ import annotations

import numpy as np
from fields import Array, fractal, smoothstep
from mesh import Faces, vertex_normals
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from shape import Axolotl

SAMPLES = 60_000
TWIGS = 1500
REACH = 1.6


class Veins:
    """Vessels as short thick segments; ``mask`` paints them."""

    def __init__(self, animal: Axolotl, p: Array, faces: Faces) -> None:
        rng = np.random.default_rng(5)
        point, normal = _scatter(p, faces, rng)
        _, side, height, over = animal.spine.locate(point)
        # Vessels like to follow the lateral line of either flank and the axis of the tail.
        lateral = np.exp(-(((height - 2.0) / 1.6) ** 2)) * (over == 0.0) * (np.abs(side) > 0.5)
        resist = 1.0 + 0.9 * fractal(point, 5.0, 2, 31) - 0.45 * lateral
        _, near = cKDTree(point).query(point, 9)
        rows = np.repeat(np.arange(len(point)), 8)
        cols = near[:, 1:].reshape(-1)
        # No shortcuts through thin parts.
        facing = np.sum(normal[rows] * normal[cols], axis=1) > 0.0
        rows, cols = rows[facing], cols[facing]
        length = np.linalg.norm(point[rows] - point[cols], axis=1)
        cost = length**1.3 * np.maximum(0.5 * (resist[rows] + resist[cols]), 0.12)
        graph = csr_matrix((cost, (rows, cols)), shape=(len(point), len(point)))
        roots = [
            int(np.argmin(np.linalg.norm(point - animal.from_head(q), axis=1)))
            for q in ([24.0, 1.0, -18.0], [-24.0, 1.0, -18.0])
        ]
        dist, before, _ = dijkstra(
            graph, directed=False, indices=roots, return_predecessors=True, min_only=True
        )
        flow = np.zeros(len(point))
        ends = rng.choice(len(point), TWIGS, replace=False)
        flow[ends[np.isfinite(dist[ends])]] = 1.0
        order = np.argsort(-np.where(np.isfinite(dist), dist, -1.0))
        for i in order:
            if flow[i] > 0.0 and before[i] >= 0:
                flow[before[i]] += flow[i]
        child = np.flatnonzero((flow > 0.0) & (before >= 0))
        parent = before[child]
        smooth = point.copy()
        for _ in range(8):
            total, weight = smooth * 2.0, np.full(len(point), 2.0)
            np.add.at(total, child, smooth[parent])
            np.add.at(weight, child, 1.0)
            np.add.at(total, parent, smooth[child])
            np.add.at(weight, parent, 1.0)
            smooth = total / weight[:, None]
        width = np.clip(0.17 * flow**0.32, 0.17, 0.95)
        steps = np.linspace(0.0, 1.0, 5)[:, None, None]
        line = smooth[child] + steps * (smooth[parent] - smooth[child])
        thick = width[child] + steps[..., 0] * (width[parent] - width[child])
        self.points, self.width = line.reshape(-1, 3), thick.reshape(-1)
        self.tree = cKDTree(self.points)

    def mask(self, p: Array) -> Array:
        """1 inside a vessel, 0 away from it, soft at the walls; thin vessels are fainter."""
        gap, near = self.tree.query(p, 6, distance_upper_bound=REACH)
        width = np.append(self.width, 1e-3)[near]
        inside = smoothstep(1.25, 0.35, np.where(np.isfinite(gap), gap, 1e3) / width)
        return np.max(inside * (0.45 + 0.55 * smoothstep(0.17, 0.6, width)), axis=1)


def _scatter(p: Array, faces: Faces, rng: np.random.Generator) -> tuple[Array, Array]:
    """Even random points on the surface, with normals."""
    a, b, c = (p[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    pick = np.searchsorted(np.cumsum(area) / area.sum(), rng.random(SAMPLES))
    pick = np.minimum(pick, len(faces) - 1)
    u, v = rng.random(SAMPLES), rng.random(SAMPLES)
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    bary = np.stack([1.0 - u - v, u, v], axis=1)
    normal = vertex_normals(p, faces)
    return (
        np.einsum("nk,nkc->nc", bary, p[faces[pick]]),
        np.einsum("nk,nkc->nc", bary, normal[faces[pick]]),
    )
