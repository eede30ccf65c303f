"""Flattens the charts with little distortion."""

from __future__ import annotations

import numpy as np
from charts import EYE, FILAMENT, face_pairs, label_faces, open_corners, split_pieces, tube_cut
from fields import Array, unit
from mesh import Faces, vertex_normals
from numpy.typing import NDArray
from pack import scan
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from shape import Axolotl


def local_triangles(p: Array, faces: Faces) -> Array:
    """Every triangle laid isometrically into the plane: (faces, 3 corners, 2)."""
    a, b, c = (p[faces[:, i]] for i in range(3))
    x = unit(b - a)
    y = unit(np.cross(unit(np.cross(b - a, c - a)), x))
    flat = np.zeros((len(faces), 3, 2))
    flat[:, 1, 0] = np.linalg.norm(b - a, axis=1)
    flat[:, 2, 0] = np.sum((c - a) * x, axis=1)
    flat[:, 2, 1] = np.sum((c - a) * y, axis=1)
    return flat


def conformal(p: Array, faces: Faces, flat: Array) -> Array:
    """Least-squares conformal map with two far-apart vertices pinned."""
    n = len(p)
    first = int(np.argmax(np.linalg.norm(p - p.mean(axis=0), axis=1)))
    second = int(np.argmax(np.linalg.norm(p - p[first], axis=1)))
    area = np.maximum(flat[:, 1, 0] * flat[:, 2, 1], 1e-6)
    rows, cols, vals = [], [], []
    for k in range(3):
        e = (flat[:, (k + 2) % 3] - flat[:, (k + 1) % 3]) / np.sqrt(area)[:, None]
        t = np.arange(len(faces))
        v = faces[:, k]
        rows += [2 * t, 2 * t, 2 * t + 1, 2 * t + 1]
        cols += [2 * v, 2 * v + 1, 2 * v, 2 * v + 1]
        vals += [e[:, 0], -e[:, 1], e[:, 1], e[:, 0]]
    system = coo_matrix(
        (np.concatenate(vals), (np.concatenate(rows), np.concatenate(cols))),
        shape=(2 * len(faces), 2 * n),
    ).tocsc()
    pinned = np.array([2 * first, 2 * first + 1, 2 * second, 2 * second + 1])
    value = np.array([0.0, 0.0, float(np.linalg.norm(p[first] - p[second])), 0.0])
    free = np.setdiff1d(np.arange(2 * n), pinned)
    lhs, rhs = system[:, free], -(system[:, pinned] @ value)
    out = np.zeros(2 * n)
    out[pinned] = value
    normal = (lhs.T @ lhs).tocsc()
    normal.setdiag(normal.diagonal() + 1e-10)
    out[free] = splu(normal).solve(lhs.T @ rhs)
    return out.reshape(n, 2)


def rigid(p: Array, faces: Faces, uv: Array, flat: Array, rounds: int) -> Array:
    """As-rigid-as-possible refinement: keeps lengths and areas of the surface."""
    n = len(p)
    rows, cols, vals, cots = [], [], [], []
    for k in range(3):
        i, j, o = k, (k + 1) % 3, (k + 2) % 3
        a, b = flat[:, i] - flat[:, o], flat[:, j] - flat[:, o]
        cross = np.maximum(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), 1e-6)
        cot = np.clip(np.sum(a * b, axis=1) / cross, 0.02, 20.0)
        cots.append(cot)
        fi, fj = faces[:, i], faces[:, j]
        rows += [fi, fj, fi, fj]
        cols += [fj, fi, fi, fj]
        vals += [-cot, -cot, cot, cot]
    laplace = coo_matrix(
        (np.concatenate(vals), (np.concatenate(rows), np.concatenate(cols))), shape=(n, n)
    ).tocsc()
    laplace.setdiag(laplace.diagonal() + 1e-9)
    solver = splu(laplace)
    for _ in range(rounds):
        cov = np.zeros((len(faces), 2, 2))
        for k in range(3):
            j = (k + 1) % 3
            e = uv[faces[:, j]] - uv[faces[:, k]]
            x = flat[:, j] - flat[:, k]
            cov += cots[k][:, None, None] * e[:, :, None] * x[:, None, :]
        # Closest rotation of a 2x2 matrix, without reflection.
        cos, sin = cov[:, 0, 0] + cov[:, 1, 1], cov[:, 1, 0] - cov[:, 0, 1]
        norm = np.maximum(np.hypot(cos, sin), 1e-12)
        cos, sin = cos / norm, sin / norm
        rot = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
        rhs = np.zeros((n, 2))
        for k in range(3):
            j = (k + 1) % 3
            pull = cots[k][:, None] * np.einsum("fij,fj->fi", rot, flat[:, j] - flat[:, k])
            np.add.at(rhs, faces[:, j], pull)
            np.add.at(rhs, faces[:, k], -pull)
        uv = solver.solve(rhs)
    return uv


def signed_area(uv: Array, faces: Faces) -> Array:
    """Signed area of every triangle in the plane."""
    a, b, c = (uv[faces[:, i]] for i in range(3))
    d, e = b - a, c - a
    return 0.5 * (d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])


def flatten(p: Array, faces: Faces, cuts: set[tuple[int, int]]) -> tuple[Array, Faces, Array]:
    """Open one chart along its cuts and lay it flat.

    Returns coordinates in mm, the faces, and which faces still have to leave the chart.
    """
    local, origin = open_corners(faces, cuts)
    q = p[origin]
    flat = local_triangles(q, local)
    area = np.sum(flat[:, 1, 0] * flat[:, 2, 1]) / 2
    start = conformal(q, local, flat)
    start *= np.sqrt(area / max(np.abs(signed_area(start, local)).sum(), 1e-9))
    best: tuple[Array, Array] | None = None
    # From least stretch to least risk of folding, down to a plain projection. Large charts
    # stay at the first: they rather give up a few faces than be stretched.
    for rounds in (40, 8, 2, 0, -1) if len(faces) < 60 else (40,):
        if rounds > 0:
            trial = rigid(q, local, start, flat, rounds)
        elif rounds == 0:
            trial = start
        else:
            facing = unit(vertex_normals(q, local).sum(axis=0))
            x = unit(np.cross(facing, [0.3, 0.5, -0.8]))
            trial = np.stack([q @ x, q @ np.cross(facing, x)], axis=1)
            stretched = np.abs(signed_area(trial, local)).sum()
            trial *= np.sqrt(area / max(stretched, 0.25 * area))
        if not np.ptp(trial, axis=0).max() < 4.0 * np.ptp(q, axis=0).max() + 1.0:
            continue
        bad = folded(trial, local)
        if best is None or bad.sum() < best[1].sum():
            best = (trial, bad)
        if not bad.any():
            break
    assert best is not None
    return best[0], local, best[1]


def folded(uv: Array, faces: Faces) -> NDArray[np.bool_]:
    """Faces to move to a chart of their own so that nothing overlaps or is flipped."""
    low = uv.min(axis=0)
    extent = float(np.ptp(uv, axis=0).max()) * 1.02
    size = int(extent * 5.0) + 2
    texel, face = [], []
    for i, (where, bary) in enumerate(scan((uv - low) / extent, faces, size, 0.0)):
        where = where[np.all(bary > 1e-6, axis=1)]
        texel.append(where)
        face.append(np.full(len(where), i))
    texels, owner = np.concatenate(texel), np.concatenate(face)
    crowded = np.bincount(texels, minlength=size * size) > 1
    guilty = signed_area(uv, faces) <= 0
    guilty[owner[crowded[texels]]] = True
    if not guilty.any():
        return guilty
    # One ring of neighbours joins what touches; of two sheets only the smaller one moves.
    touched = np.zeros(len(uv), dtype=bool)
    touched[faces[guilty]] = True
    ring = touched[faces].any(axis=1)
    pairs = face_pairs(faces)
    both = ring[pairs[:, 0]] & ring[pairs[:, 1]]
    graph = coo_matrix(
        (np.ones(both.sum()), (pairs[both, 0], pairs[both, 1])), shape=(len(faces), len(faces))
    )
    _, piece = connected_components(graph, directed=False)
    pieces, sizes = np.unique(piece[ring], return_counts=True)
    if len(pieces) > 1:
        ring &= piece != pieces[np.argmax(sizes)]
    return ring


def unwrap(animal: Axolotl, p: Array, faces: Faces) -> tuple[Array, Faces, NDArray[np.int64]]:
    """Flat charts in millimetres, not yet packed: uv, uv faces, and each face's chart."""
    label = label_faces(animal, p, faces)
    normal = vertex_normals(p, faces)
    away = unit(animal.from_head([0.0, -0.5, -1.0]) - animal.from_head([0.0, 0.0, 0.0]))
    uvs, uv_faces, offset = [], np.zeros_like(faces), 0
    queue = [(int(value), 0) for value in np.unique(label)]
    spare = int(label.max()) + 1
    while queue:
        value, tries = queue.pop()
        mine = np.flatnonzero(label == value)
        cuts: set[tuple[int, int]] = set()
        tube = value - FILAMENT
        if 0 <= tube < len(animal.filaments.curves):
            tip = animal.filaments.curves[tube][0][-1]
            cuts = tube_cut(p, normal, faces[mine], away, tip)
        uv, local, bad = flatten(p, faces[mine], cuts)
        if bad.all() and len(mine) > 1:
            # A small knot: undo it face by face.
            bad[1:] = False
        if bad.any() and len(mine) > 1 and tries < 12:
            label[mine[bad]] = spare
            pieces = split_pieces(label, faces, value, spare)
            spare += len(pieces)
            queue += [(piece, tries + 1) for piece in [value, *pieces]]
            continue
        # The rings of the eyes are finer than anything else: they get more texels.
        uvs.append(uv * (2.2 if value in (EYE, EYE + 1) else 1.0))
        uv_faces[mine] = local + offset
        offset += len(uv)
    return np.concatenate(uvs), uv_faces, label
