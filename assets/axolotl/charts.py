"""Seam placement: splits the mesh into charts and opens each of them to a disc."""

from __future__ import annotations

import numpy as np
from fields import Array
from mesh import Faces, vertex_normals
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from shape import Axolotl

Labels = NDArray[np.int64]

BACK, BELLY, TAIL_LEFT, TAIL_RIGHT = 0, 1, 2, 3
EYE, LEG, STALK, FILAMENT = 4, 10, 20, 100
TAIL_START = 112.0


def face_pairs(faces: Faces) -> NDArray[np.int64]:
    """Pairs of faces across each edge, with the edge: columns face, face, vertex, vertex."""
    n = len(faces)
    edge = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(n), 3)
    order = np.lexsort((edge[:, 1], edge[:, 0]))
    edge, owner = edge[order], owner[order]
    twin = np.flatnonzero(np.all(edge[1:] == edge[:-1], axis=1))
    return np.column_stack([owner[twin], owner[twin + 1], edge[twin]])


def label_faces(animal: Axolotl, p: Array, faces: Faces) -> Labels:
    """One label per chart, from the part of the model each face belongs to."""
    centre = p[faces].mean(axis=1)
    normal = vertex_normals(p, faces)[faces].mean(axis=1)
    parts = animal.parts(centre)
    arc, side, height, _ = animal.spine.locate(centre)
    below = animal.profile["below"](np.clip(arc, 0.0, animal.spine.length))
    head = animal.to_head(centre)
    in_head = head[:, 2] > -14.0
    line, _ = animal.mouth_height(head)
    under = np.where(in_head, head[:, 1] < line - 5.0, height < -0.55 * below)
    label = np.where(under, BELLY, BACK)
    tail = (arc > TAIL_START) & ~in_head
    label = np.where(tail, np.where(side > 0.0, TAIL_LEFT, TAIL_RIGHT), label)
    for i, eye in enumerate(animal.eyes):
        label = np.where(np.linalg.norm(head - eye, axis=1) < 3.6, EYE + i, label)
    limb = parts.legs < parts.body - 0.5
    label = np.where(limb, LEG + 2 * parts.leg_id + (normal[:, 1] < -0.15), label)
    stalk = parts.stalks < np.minimum(parts.body, parts.legs) - 0.8
    stalk &= parts.stalks < 2.5
    front = normal @ (animal.from_head([0.0, 0.0, 1.0]) - animal.from_head([0.0, 0.0, 0.0])) > 0.0
    label = np.where(stalk, STALK + 2 * parts.stalk_id + front, label)
    fringe = parts.filaments < np.minimum(parts.stalks, parts.body) - 0.45
    fringe &= parts.filaments < 0.7
    label = np.where(fringe, FILAMENT + parts.filament_id, label)
    return _tidy(label.astype(np.int64), face_pairs(faces))


def _tidy(label: Labels, pairs: NDArray[np.int64]) -> Labels:
    """Smooth ragged borders, then keep only the largest piece of every label."""
    n = len(label)
    a, b = pairs[:, 0], pairs[:, 1]
    for _ in range(6):
        # A face whose two or three neighbours agree on another label takes it.
        votes: list[list[int]] = [[] for _ in range(n)]
        for i in np.flatnonzero(label[a] != label[b]):
            votes[a[i]].append(int(label[b[i]]))
            votes[b[i]].append(int(label[a[i]]))
        new = label.copy()
        for i, v in enumerate(votes):
            if len(v) >= 2 and v.count(max(set(v), key=v.count)) >= 2:
                new[i] = max(sorted(set(v)), key=v.count)
        label = new
    for _ in range(8):
        same = label[a] == label[b]
        graph = coo_matrix((np.ones(same.sum()), (a[same], b[same])), shape=(n, n))
        count, piece = connected_components(graph, directed=False)
        size = np.bincount(piece, minlength=count)
        owner = np.zeros(count, dtype=np.int64)
        owner[piece] = label
        keep = np.zeros(count, dtype=bool)
        for value in np.unique(owner):
            mine = np.flatnonzero(owner == value)
            keep[mine[np.argmax(size[mine])]] = True
        keep &= size >= 12
        if keep.all():
            break
        for i in np.flatnonzero(~same):
            for x, y in ((a[i], b[i]), (b[i], a[i])):
                if not keep[piece[x]] and keep[piece[y]]:
                    label[piece == piece[x]] = label[y]
                    keep[piece[x]] = True
    return label


def split_pieces(label: Labels, faces: Faces, old: int, new: int) -> list[int]:
    """Give every piece of ``old`` and ``new`` beyond the largest of ``old`` its own number."""
    extra = []
    for value in (old, new):
        mine = np.flatnonzero(label == value)
        pairs = face_pairs(faces[mine])
        graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(mine),) * 2)
        count, piece = connected_components(graph, directed=False)
        largest = int(np.argmax(np.bincount(piece)))
        for i in range(count):
            if value == old and i == largest:
                continue
            label[mine[piece == i]] = new + 1_000_000 + len(extra)
            extra.append(len(extra))
    out = []
    for i in extra:
        label[label == new + 1_000_000 + i] = new + i
        out.append(new + i)
    return out


def open_corners(faces: Faces, cuts: set[tuple[int, int]]) -> tuple[Faces, NDArray[np.int64]]:
    """Split the vertices of one chart along cut edges.

    Returns the faces in new vertex numbers and, per new vertex, the original one.
    """
    pairs = face_pairs(faces)
    rows, cols = [], []
    for f, g, u, v in pairs:
        if (int(u), int(v)) in cuts:
            continue
        for vertex in (u, v):
            rows.append(3 * f + int(np.flatnonzero(faces[f] == vertex)[0]))
            cols.append(3 * g + int(np.flatnonzero(faces[g] == vertex)[0]))
    m = 3 * len(faces)
    graph = coo_matrix((np.ones(len(rows)), (rows, cols)), shape=(m, m))
    count, group = connected_components(graph, directed=False)
    origin = np.zeros(count, dtype=np.int64)
    origin[group] = faces.reshape(-1)
    return group.reshape(-1, 3).astype(np.int64), origin


def tube_cut(p: Array, normal: Array, faces: Faces, away: Array, tip: Array) -> set[tuple[int, int]]:
    """Edge path from the vertex nearest ``tip`` to the open end, along the side ``away``."""
    used, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    edge = np.concatenate([local[:, [0, 1]], local[:, [1, 2]], local[:, [2, 0]]])
    key = np.sort(edge, axis=1)
    unique, count = np.unique(key, axis=0, return_counts=True)
    # The mouth of the tube: border vertices far from the tip (holes of side branches are not).
    border = np.unique(unique[count == 1])
    q = p[used]
    start = int(np.argmin(np.linalg.norm(q - tip, axis=1)))
    reach = np.linalg.norm(q[border] - q[start], axis=1)
    goal = border[reach > 0.90 * reach.max()]
    length = np.linalg.norm(q[unique[:, 0]] - q[unique[:, 1]], axis=1)
    facing = (normal[used][unique].mean(axis=1) @ away + 1.0) * 0.5
    on_border = np.isin(unique, border).any(axis=1)
    cost = length * (1.0 + 6.0 * (1.0 - facing)) * np.where(on_border, 4.0, 1.0)
    graph = csr_matrix((cost, (unique[:, 0], unique[:, 1])), shape=(len(used), len(used)))
    dist, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    at = int(goal[np.argmin(dist[goal])])
    cuts = set()
    while at != start:
        prev = int(before[at])
        u, v = sorted((int(used[at]), int(used[prev])))
        cuts.add((u, v))
        at = prev
    return cuts
