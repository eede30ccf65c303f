"""Packs flat charts into a square by their exact outlines."""

from __future__ import annotations

import numpy as np
from fields import Array
from mesh import Faces
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.fft import irfft2, rfft2
from scipy.ndimage import binary_dilation

SIZE = 1024  # texels, the reference resolution of the padding
CELL = 2  # texels per cell of the occupancy grid
BIG_CHART = 300.0  # mm²; larger ones are tried at more angles


def scan(uv: Array, faces: Faces, size: int, grow: float) -> list[tuple[NDArray[np.intp], Array]]:
    """For each triangle, the texels it covers (row * size + column) and their barycentrics."""
    pixel = np.stack([uv[:, 0] * size - 0.5, (1.0 - uv[:, 1]) * size - 0.5], axis=1)
    out = []
    for tri in pixel[faces]:
        lo = np.maximum(np.floor(tri.min(axis=0) - grow).astype(int), 0)
        hi = np.minimum(np.ceil(tri.max(axis=0) + grow).astype(int), size - 1)
        x, y = np.meshgrid(np.arange(lo[0], hi[0] + 1), np.arange(lo[1], hi[1] + 1))
        e1, e2 = tri[1] - tri[0], tri[2] - tri[0]
        area = e1[0] * e2[1] - e1[1] * e2[0]
        if abs(area) < 1e-9:
            out.append((np.zeros(0, dtype=np.intp), np.zeros((0, 3))))
            continue
        dx, dy = x.ravel() - tri[0, 0], y.ravel() - tri[0, 1]
        b1 = (dx * e2[1] - dy * e2[0]) / area
        b2 = (e1[0] * dy - e1[1] * dx) / area
        bary = np.stack([1.0 - b1 - b2, b1, b2], axis=1)
        # A tolerance in texels is a barycentric slack over the height of the triangle.
        lengths = np.linalg.norm(np.roll(tri, -1, axis=0) - np.roll(tri, 1, axis=0), axis=1)
        hit = np.all(bary >= -grow * lengths / abs(area) - 1e-9, axis=1)
        out.append(((y.ravel() * size + x.ravel())[hit], bary[hit]))
    return out


def _upright(uv: Array) -> Array:
    """Rotate a chart so that its bounding box is smallest."""
    best, area = uv, np.inf
    for angle in np.radians(np.arange(0.0, 90.0, 3.0)):
        turned = uv @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        extent = np.ptp(turned, axis=0)
        if extent[0] * extent[1] < area:
            best, area = turned, extent[0] * extent[1]
    return best


def _footprint(uv: Array, faces: Faces, padding: int) -> NDArray[np.bool_]:
    """Occupied cells of a chart given in texels from its lower corner, with its gutter."""
    gutter = padding // 2 + 1
    side = int(np.ceil(np.ptp(uv, axis=0).max())) + 2 * gutter + 2
    side += -side % CELL
    image = Image.new("1", (side, side))
    draw = ImageDraw.Draw(image)
    # The outline makes the drawn triangle cover every texel it touches.
    for corners in (uv + gutter)[faces].reshape(-1, 6).tolist():
        draw.polygon(corners, fill=1, outline=1)
    mask = np.asarray(image)
    mask = binary_dilation(mask, iterations=padding // 2)
    cells = mask.reshape(side // CELL, CELL, side // CELL, CELL).any(axis=(1, 3))
    rows, cols = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    return cells[: rows[-1] + 1, : cols[-1] + 1]


def _try(charts: list[tuple[Array, Faces, float]], scale: float, padding: int) -> list[Array] | None:
    """Positions in texels of all charts at one scale, or nothing if they do not fit."""
    n = SIZE // CELL
    taken = np.zeros((n, n), dtype=np.float32)
    placed: list[Array] = []
    for uv, faces, area in charts:
        spectrum = rfft2(taken)
        best: tuple[float, int, int, Array, NDArray[np.bool_]] | None = None
        angles = np.arange(0, 360, 45) if area > BIG_CHART else np.array([0, 90])
        for angle in np.radians(angles):
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            turned = (uv @ turn) * scale
            turned -= turned.min(axis=0)
            shape = _footprint(turned, faces, padding)
            h, w = shape.shape
            if h > n or w > n:
                continue
            kernel = np.zeros((n, n), dtype=np.float32)
            kernel[:h, :w] = shape
            clash = irfft2(spectrum * np.conj(rfft2(kernel)), s=(n, n))
            free = clash[: n - h + 1, : n - w + 1] < 0.5
            if not free.any():
                continue
            y, x = np.nonzero(free)
            # Fill from the bottom up; ties to the left.
            score = (y + 0.6 * h) * 4.0 + x
            k = int(np.argmin(score))
            if best is None or score[k] < best[0]:
                best = (float(score[k]), int(y[k]), int(x[k]), turned, shape)
        if best is None:
            return None
        _, y, x, turned, shape = best
        taken[y : y + shape.shape[0], x : x + shape.shape[1]] += shape
        placed.append(turned + padding // 2 + 1 + CELL * np.array([x, y]))
    return placed


def pack(uv: Array, faces: Faces, label: NDArray[np.int64], padding: int) -> Array:
    """Coordinates in the unit square at the largest common scale that fits."""
    charts, members = [], []
    for value in np.unique(label):
        used, local = np.unique(faces[label == value], return_inverse=True)
        chart, local = _upright(uv[used]), local.reshape(-1, 3)
        d, e = chart[local[:, 1]] - chart[local[:, 0]], chart[local[:, 2]] - chart[local[:, 0]]
        area = float(np.abs(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]).sum() / 2)
        charts.append((chart, local, area))
        members.append(used)
    order = sorted(range(len(charts)), key=lambda i: -charts[i][2])
    total = sum(c[2] for c in charts)
    best, filled = None, 0.68
    # Try a full square first and loosen until everything fits.
    while best is None and filled > 0.4:
        scale = float(np.sqrt(filled * SIZE**2 / total))
        best = _try([charts[i] for i in order], scale, padding)
        filled -= 0.02
    if best is None:
        raise RuntimeError("the charts do not fit")
    print(f"packed at {scale:.2f} texels per mm, {len(charts)} charts")
    out = np.zeros_like(uv)
    for i, coords in zip(order, best, strict=True):
        out[members[i]] = coords / SIZE
    return out
