"""A coarser mesh with the same texture: edges collapse where that moves the surface least.

A vertex moves onto a neighbour and takes its texture coordinates, in every chart that it belongs to; where
it has none there, it stays. So maps that were painted for the fine mesh lie as they did. Quadric errors:
Garland & Heckbert 1997.
"""

import heapq
from collections import defaultdict

import torch

from texsss.surface.mesh import Mesh

SEAM_WEIGHT = 4.0  # how much more than the surface the outlines of charts resist
MOST_DRIFT = 7e-3  # of outlines, in uv: beyond, maps hold what belongs to another chart
LEAST_TURN = 0.3  # cosine between the normals of a triangle before and after
Vector = tuple[float, float, float]


def decimated(mesh: Mesh, count: int) -> Mesh:
    """The mesh with about `count` faces, or as few as its charts allow."""
    assert mesh.source_uv is not None
    work = _Collapse(mesh)
    while work.alive > count and work.heap:
        work.step()
    faces = sorted(work.corners)
    kept = sorted({v for f in faces for v in work.corners[f]})
    place = {v: i for i, v in enumerate(kept)}
    corners = torch.tensor([[place[v] for v in work.corners[f]] for f in faces])
    uv = torch.tensor([work.uv[f] for f in faces])
    return Mesh(mesh.vertices[kept], corners, uv)


class _Collapse:
    """Triangles and what collapsing each edge would cost, cheapest first."""

    def __init__(self, mesh: Mesh):
        assert mesh.source_uv is not None
        self.at: list[Vector] = [tuple(p) for p in mesh.vertices.double().tolist()]
        self.corners = {f: list(v) for f, v in enumerate(mesh.faces.tolist())}
        self.uv = {f: [tuple(c) for c in uv] for f, uv in enumerate(mesh.source_uv.tolist())}
        self.faces_of: dict[int, set[int]] = defaultdict(set)
        self.quadric = [[0.0] * 10 for _ in self.at]
        self.stamp = [0] * len(self.at)
        # places in uv that the outlines of charts went through between their ends of now
        self.outline: dict[tuple, list] = defaultdict(list)
        self.alive = len(self.corners)
        self.heap: list[tuple] = []
        for f, corners in self.corners.items():
            for v in corners:
                self.faces_of[v].add(f)
        self._weigh()
        for v in list(self.faces_of):
            for u in self._around(v):
                self._offer(v, u)

    def step(self) -> None:
        """Collapses the cheapest edge that may be."""
        _, v, u, stamp_v, stamp_u = heapq.heappop(self.heap)
        if (self.stamp[v], self.stamp[u]) != (stamp_v, stamp_u):
            return
        moved = self._moved(v, u)
        if moved is None:
            return
        outlines = self._outlines(v, moved)
        if outlines is None:
            return
        self.outline.update(outlines)
        for f in list(self.faces_of[v]):
            corners = self.corners[f]
            if u in corners:
                for w in corners:
                    self.faces_of[w].discard(f)
                del self.corners[f], self.uv[f]
                self.alive -= 1
            else:
                k = corners.index(v)
                self.uv[f][k] = moved[self.uv[f][k]]
                corners[k] = u
                self.faces_of[u].add(f)
        del self.faces_of[v]
        self.stamp[v] = -1
        self.stamp[u] += 1
        self.quadric[u] = [a + b for a, b in zip(self.quadric[u], self.quadric[v], strict=True)]
        for w in self._around(u):
            self._offer(u, w)
            self._offer(w, u)

    def _moved(self, v: int, u: int) -> dict | None:
        """Texture coordinates of u by those of v in the same chart; None where v has to stay."""
        if len(self._around(v) & self._around(u)) != 2:
            return None
        moved: dict = {}
        for f in self.faces_of[v] & self.faces_of[u]:
            corners, uv = self.corners[f], self.uv[f]
            old, new = uv[corners.index(v)], uv[corners.index(u)]
            if moved.setdefault(old, new) != new:
                return None
        for f in self.faces_of[v] - self.faces_of[u]:
            corners = self.corners[f]
            k = corners.index(v)
            if self.uv[f][k] not in moved:
                return None
            before = _normal(*(self.at[w] for w in corners))
            after = _normal(*(self.at[u if w == v else w] for w in corners))
            lengths = (_dot(before, before) * _dot(after, after)) ** 0.5
            if _dot(before, after) <= LEAST_TURN * lengths:
                return None
            was = _area(*self.uv[f])
            if was * _area(*(moved[uv] if w == v else uv for w, uv in zip(corners, self.uv[f]))) <= 0:
                return None
        return moved

    def _outlines(self, v: int, moved: dict) -> dict | None:
        """The outlines of charts that v takes with it, by their ends in uv; None where they go astray."""
        drawn: dict = {}
        for old, new in moved.items():
            times: dict = defaultdict(int)
            for f in self.faces_of[v]:
                uv = self.uv[f]
                if uv[self.corners[f].index(v)] == old:
                    for other in uv:
                        times[other] += other != old
            # edges of one face alone are of the outline
            ends = [uv for uv, n in times.items() if n == 1]
            passed = [old, *(uv for end in ends for uv in self.outline[_pair(old, end)])]
            for end in ends:
                if end != new:
                    drawn[_pair(new, end)] = passed
                    if any(_apart(uv, new, end) > MOST_DRIFT for uv in passed):
                        return None
        return drawn

    def _around(self, v: int) -> set[int]:
        return {w for f in self.faces_of[v] for w in self.corners[f]} - {v}

    def _offer(self, v: int, u: int) -> None:
        cost = _error(self.quadric[v], self.at[u]) + 1e-9 * _length2(self.at[v], self.at[u])
        heapq.heappush(self.heap, (cost, v, u, self.stamp[v], self.stamp[u]))

    def _weigh(self) -> None:
        """Planes of the triangles, and upright ones along the outlines of charts."""
        seen: dict[tuple[int, int], tuple] = {}
        for f, corners in self.corners.items():
            normal = _normal(*(self.at[v] for v in corners))
            area = max(_dot(normal, normal) ** 0.5, 1e-30)
            unit = (normal[0] / area, normal[1] / area, normal[2] / area)
            for v in corners:
                self._add(v, unit, self.at[v], area)
            for k in range(3):
                a, b = corners[k], corners[k - 2]
                mine = self.uv[f][k], self.uv[f][k - 2]
                other = seen.pop((b, a), None)
                if other is None:
                    seen[a, b] = mine
                elif other != mine[::-1]:
                    along = tuple(q - p for p, q in zip(self.at[a], self.at[b], strict=True))
                    wall = _cross(along, unit)
                    size = max(_dot(wall, wall) ** 0.5, 1e-30)
                    upright = (wall[0] / size, wall[1] / size, wall[2] / size)
                    for v in (a, b):
                        self._add(v, upright, self.at[a], SEAM_WEIGHT * size * size)

    def _add(self, v: int, n: Vector, point: Vector, weight: float) -> None:
        d = -_dot(n, point)
        x, y, z = n
        plane = (x * x, x * y, x * z, x * d, y * y, y * z, y * d, z * z, z * d, d * d)
        self.quadric[v] = [a + weight * b for a, b in zip(self.quadric[v], plane, strict=True)]


def _error(q: list[float], p: Vector) -> float:
    x, y, z = p
    return (
        q[0] * x * x + q[4] * y * y + q[7] * z * z + q[9]
        + 2 * (q[1] * x * y + q[2] * x * z + q[5] * y * z + q[3] * x + q[6] * y + q[8] * z)
    )  # fmt: skip


def _cross(a, b) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _length2(a: Vector, b: Vector) -> float:
    return sum((p - q) ** 2 for p, q in zip(a, b, strict=True))


def _pair(a, b) -> tuple:
    return (a, b) if a < b else (b, a)


def _apart(p, a, b) -> float:
    """Distance of p from the line between a and b, in uv."""
    d = b[0] - a[0], b[1] - a[1]
    along = ((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / max(d[0] ** 2 + d[1] ** 2, 1e-30)
    share = min(max(along, 0.0), 1.0)
    return ((p[0] - a[0] - share * d[0]) ** 2 + (p[1] - a[1] - share * d[1]) ** 2) ** 0.5


def _area(a, b, c) -> float:
    """Twice the signed area of a triangle in uv."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _normal(a: Vector, b: Vector, c: Vector) -> Vector:
    """Normal of a triangle, as long as twice its area."""
    return _cross((b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]))
