"""Polygonises the distance field and reduces the result to a light, even mesh."""

from __future__ import annotations

from collections.abc import Callable

import fast_simplification
import numpy as np
from fields import Array
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse import csr_matrix
from skimage.measure import marching_cubes

Field = Callable[[Array], Array]
Faces = NDArray[np.int64]

LOWER = np.array([-72.0, -2.0, -122.0])
UPPER = np.array([96.0, 84.0, 114.0])
CHUNK = 200_000


def evaluate(field: Field, p: Array) -> Array:
    """Field values, computed in chunks to bound the memory."""
    return np.concatenate([field(p[i : i + CHUNK]) for i in range(0, len(p), CHUNK)])


def polygonise(field: Field, h: float) -> tuple[Array, Faces]:
    """Marching cubes at spacing ``h``, evaluating the field only near the surface."""
    coarse = 2.4
    axes = [np.arange(lo, hi + coarse, coarse) for lo, hi in zip(LOWER, UPPER, strict=True)]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    rough = evaluate(field, lattice.reshape(-1, 3)).reshape(lattice.shape[:3])
    shape = tuple(round((len(a) - 1) * coarse / h) + 1 for a in axes)
    volume = np.empty(shape, dtype=np.float32)
    ratio = h / coarse
    grid_yz = np.meshgrid(np.arange(shape[1]), np.arange(shape[2]), indexing="ij")
    for i in range(shape[0]):
        where = np.stack([np.full(grid_yz[0].shape, i), *grid_yz]) * ratio
        slab = map_coordinates(rough, where, order=1, mode="nearest")
        # The coarse field misses thin tubes by at most its own cell diagonal.
        near = np.abs(slab) < 2.6
        index = np.argwhere(near)
        if len(index):
            p = LOWER + h * np.column_stack([np.full(len(index), i), index])
            slab[near] = field(p)
        volume[i] = slab
    vertices, faces, _, _ = marching_cubes(volume, 0.0)
    return vertices.astype(np.float64) * h + LOWER, faces.astype(np.int64)


def project(field: Field, p: Array, rounds: int = 2, reach: float = 0.4) -> Array:
    """Newton steps that bring points onto the zero level."""
    for _ in range(rounds):
        eps = 0.08
        # Forward differences along a tetrahedron: four evaluations give value and gradient.
        corners = np.array([[1, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]]) * eps
        values = [evaluate(field, p + c) for c in corners]
        grad = sum(v[:, None] * c for v, c in zip(values, corners, strict=True)) / (4 * eps * eps)
        mean = sum(values) / 4.0
        square = np.maximum(np.sum(grad * grad, axis=1, keepdims=True), 0.15)
        step = mean[:, None] * grad / square
        length = np.linalg.norm(step, axis=1, keepdims=True)
        p = p - step * np.minimum(1.0, reach / np.maximum(length, 1e-9))
    return p


def vertex_normals(p: Array, faces: Faces) -> Array:
    """Area-weighted vertex normals."""
    a, b, c = (p[faces[:, i]] for i in range(3))
    n = np.cross(b - a, c - a)
    out = np.zeros_like(p)
    for i in range(3):
        np.add.at(out, faces[:, i], n)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)


def relax(p: Array, faces: Faces, amount: float) -> Array:
    """Move vertices towards their neighbours' mean, along the surface only."""
    n = len(p)
    rows = np.concatenate([faces[:, i] for i in (0, 1, 2, 1, 2, 0)])
    cols = np.concatenate([faces[:, i] for i in (1, 2, 0, 0, 1, 2)])
    w = csr_matrix((np.ones(len(rows)), (rows, cols)), shape=(n, n))
    mean = (w @ p) / np.asarray(w.sum(axis=1))
    move = mean - p
    normal = vertex_normals(p, faces)
    move -= normal * np.sum(move * normal, axis=1, keepdims=True)
    return p + amount * move


def repair(p: Array, faces: Faces) -> tuple[Array, Faces]:
    """Make the few edges that decimation left with four faces manifold again."""
    # Two faces on the same three vertices are a collapsed flap: both go.
    key = np.sort(faces, axis=1)
    _, inverse, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    faces = faces[count[inverse.reshape(-1)] == 1]
    users: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for i, f in enumerate(faces.tolist()):
        for k in range(3):
            u, v = f[k], f[(k + 1) % 3]
            users.setdefault((min(u, v), max(u, v)), []).append((i, k))
    points, removed, added = list(p), set(), []
    for (u, v), uses in users.items():
        if len(uses) == 2 or any(i in removed for i, _ in uses):
            continue
        ahead = [i for i, k in uses if faces[i, k] == u]
        astern = [i for i, k in uses if faces[i, k] == v]
        if len(uses) != 4 or len(ahead) != 2:
            raise RuntimeError("unexpected edge")
        far = {i: int(next(w for w in faces[i] if w not in (u, v))) for i, _ in uses}
        span = [[np.linalg.norm(p[far[i]] - p[far[j]]) for j in astern] for i in ahead]
        # Each sheet gets a midpoint of its own; wide pairs are the flattest sheets.
        if span[0][0] + span[1][1] < span[0][1] + span[1][0]:
            astern.reverse()
        for i, j in zip(ahead, astern, strict=True):
            middle = len(points)
            points.append(0.4 * (p[u] + p[v]) + 0.1 * (p[far[i]] + p[far[j]]))
            added += [[u, middle, far[i]], [middle, v, far[i]]]
            added += [[v, middle, far[j]], [middle, u, far[j]]]
            removed |= {i, j}
    keep = np.ones(len(faces), dtype=bool)
    keep[list(removed)] = False
    faces = np.concatenate([faces[keep], np.array(added, dtype=np.int64).reshape(-1, 3)])
    return np.array(points), faces


def compact(p: Array, faces: Faces) -> tuple[Array, Faces]:
    """Drop unused vertices."""
    used, index = np.unique(faces, return_inverse=True)
    return p[used], index.reshape(-1, 3).astype(np.int64)


def reduce(field: Field, p: Array, faces: Faces, target: int) -> tuple[Array, Faces]:
    """Decimate to ``target`` triangles, then even the mesh out on the exact surface."""
    p = project(field, p, 1)
    p, faces = fast_simplification.simplify(
        p.astype(np.float32), faces.astype(np.int32), target_count=target, agg=6.0
    )
    p, faces = p.astype(np.float64), faces.astype(np.int64)
    for _ in range(3):
        p, faces = repair(p, faces)
    p, faces = compact(p, faces)
    for _ in range(3):
        p = project(field, relax(p, faces, 0.35), 1, 0.2)
    return p, faces
