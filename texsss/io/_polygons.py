"""Polygons cut into triangles, concave ones too."""

import numpy as np

MAX_EAR_CORNERS = 4000  # ear clipping is quadratic; larger ones are cut into a fan


def triangulate(points: np.ndarray) -> np.ndarray:
    """Corner numbers (n − 2, 3) of triangles that fill the polygon `points` (n, 3), in its own orientation.

    Quads and larger polygons that are convex become fans; others lose one ear after the other in the
    plane across their mean normal (Meisters 1975).
    """
    count = len(points)
    fan = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], -1)
    if count == 3 or count > MAX_EAR_CORNERS or not np.isfinite(points).all():
        return fan
    flat = _in_plane(points)
    if flat is None:
        return fan
    a, b, c = (flat[fan[:, k]] for k in range(3))
    if (_cross(b - a, c - a) > 0).all():
        return fan
    return _ears(flat)


def _in_plane(points: np.ndarray) -> np.ndarray | None:
    """Coordinates (n, 2) across the polygon's mean normal, turning left; None without area."""
    centred = points - points.mean(0)
    normal = np.cross(centred, np.roll(centred, -1, 0)).sum(0)  # Newell
    length = np.linalg.norm(normal)
    if not length > 0:
        return None
    normal = normal / length
    along = np.eye(3)[np.argmin(np.abs(normal))]
    x = np.cross(along, normal)
    x /= np.linalg.norm(x)
    return centred @ np.stack([x, np.cross(normal, x)], -1)


def _ears(flat: np.ndarray) -> np.ndarray:
    left = list(range(len(flat)))
    ears = []
    at = 0
    tried = 0
    while len(left) > 3:
        at %= len(left)
        i, j, k = left[at - 1], left[at], left[(at + 1) % len(left)]
        # after a full round without an ear the polygon crosses itself: cut anywhere, and end
        if tried > len(left) or _is_ear(flat, i, j, k, left):
            ears.append((i, j, k))
            del left[at]
            at -= 1
            tried = 0
        else:
            at += 1
            tried += 1
    return np.array([*ears, tuple(left)])


def _is_ear(flat: np.ndarray, i: int, j: int, k: int, left: list[int]) -> bool:
    a, b, c = flat[i], flat[j], flat[k]
    if _cross(b - a, c - a) <= 0:
        return False
    others = flat[[n for n in left if n not in (i, j, k)]]
    inside = (
        (_cross(b - a, others - a) >= 0) & (_cross(c - b, others - b) >= 0) & (_cross(a - c, others - c) >= 0)
    )
    return not inside.any()


def _cross(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]
