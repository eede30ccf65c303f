"""Polygons cut into triangles, concave ones too."""

import numpy as np

MAX_EAR_CORNERS = 4000  # ear clipping takes the square of them, or worse; larger ones are cut into a fan


def triangulate(points: np.ndarray) -> np.ndarray:
    """Corner numbers (N, n − 2, 3) of triangles that fill N polygons `points` (N, n, 3), turning as they do.

    Convex ones become fans; others lose one ear after the other in the plane across their mean normal
    (Meisters 1975).
    """
    many, count = points.shape[:2]
    fan = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], -1)
    result = np.broadcast_to(fan, (many, *fan.shape)).copy()
    if count == 3 or count > MAX_EAR_CORNERS:
        return result
    with np.errstate(invalid="ignore", over="ignore"):
        centred = points - points.mean(1, keepdims=True)
        normal = np.cross(centred, np.roll(centred, -1, 1)).sum(1)  # Newell's
        a, b, c = (points[:, fan[:, k]] for k in range(3))
        turn = (np.cross(b - a, c - a) * normal[:, None]).sum(-1)
        # without a normal, or not finite, there is nothing to improve on
        concave = (turn <= 0).any(1) & (np.linalg.norm(normal, axis=-1) > 0)
    for n in np.flatnonzero(concave):
        result[n] = _ears(_in_plane(centred[n], normal[n]))
    return result


def _in_plane(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Coordinates (n, 2) across `normal`, turning left."""
    normal = normal / np.linalg.norm(normal)
    x = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    x /= np.linalg.norm(x)
    return points @ np.stack([x, np.cross(normal, x)], -1)


def _ears(flat: np.ndarray) -> np.ndarray:
    left = list(range(len(flat)))
    ears = []
    at = 0
    tried = 0
    while len(left) > 3:
        at %= len(left)
        i, j, k = left[at - 1], left[at], left[(at + 1) % len(left)]
        if tried > len(left):
            # a full round without an ear: the polygon crosses itself, and no cut of the rest is right
            rest = np.array(left)
            fan = np.stack([np.full(len(rest) - 2, rest[0]), rest[1:-1], rest[2:]], -1)
            return np.concatenate([np.array(ears, int).reshape(-1, 3), fan])
        if _is_ear(flat, i, j, k, left):
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


def _cross(p: np.ndarray, q: np.ndarray) -> np.ndarray | np.floating:
    return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]
