"""Draws the rims of flat charts apart where one lies over another by a sliver."""

from __future__ import annotations

import numpy as np
from fields import Array
from mesh import Faces
from numpy.typing import NDArray
from scipy.spatial import KDTree

STEP = 0.25  # of the way towards the middle of its neighbours that a corner goes at a time
ROUNDS = 60
CLEAR = 0.02  # barycentric: how far a corner stays out of the faces of others


def drawn_apart(uv: Array, faces: Faces) -> Array:
    """`uv` (V, 2) with the corners of rims that lie in other faces drawn back into their own.

    Raises RuntimeError where that does not end.
    """
    uv = uv.copy()
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, used = np.unique(edges, axis=0, return_counts=True)
    rim = np.unique(edges[used == 1])
    both = np.concatenate([edges, edges[:, ::-1]])
    count = np.bincount(both[:, 0], minlength=len(uv))[:, None]
    for _ in range(ROUNDS):
        corner, face = _inside(uv, faces, rim)
        if not len(corner):
            return uv
        # both give way: what lies in the other, and the rim of what it lies in
        moved = np.unique(np.concatenate([corner, np.intersect1d(faces[face], rim)]))
        middle = np.zeros_like(uv)
        np.add.at(middle, both[:, 0], uv[both[:, 1]])
        uv[moved] += STEP * (middle / np.maximum(count, 1) - uv)[moved]
    raise RuntimeError("charts still lie over themselves")


def _inside(uv: Array, faces: Faces, rim: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Corners of rims, and the faces of others that each lies in."""
    triangle = uv[faces]
    centre = triangle.mean(axis=1)
    reach = np.linalg.norm(triangle - centre[:, None], axis=2).max(axis=1)
    near = KDTree(uv[rim]).query_ball_point(centre, reach)
    face = np.repeat(np.arange(len(faces)), [len(found) for found in near])
    corner = rim[np.concatenate([np.asarray(found, dtype=np.intp) for found in near])]
    others = (faces[face] != corner[:, None]).all(axis=1)
    corner, face = corner[others], face[others]
    a, b, c = np.moveaxis(triangle[face], 1, 0)
    p = uv[corner]

    def area(x: Array, y: Array, z: Array) -> Array:
        u, v = y - x, z - x
        return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]

    whole = area(a, b, c)
    hit = np.min([area(p, b, c) / whole, area(a, p, c) / whole, area(a, b, p) / whole], axis=0) > -CLEAR
    return corner[hit], face[hit]
