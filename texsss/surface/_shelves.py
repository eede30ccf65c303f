"""Rectangles on shelves: charts laid into the square in rows of falling height."""

import numpy as np

STEPS = 24  # of the bisection for the scale
FILL = 0.5  # share of the square that padding alone may take


def pack(flat: np.ndarray, chart: np.ndarray, size: int, padding: float) -> tuple[np.ndarray, float]:
    """Corners (F, 3, 2) in the unit square and the padding [texels] kept.

    `flat` (F, 3, 2) has every chart in its own plane, all in one unit; `chart` (F,) counts from 0.
    All charts get the same scale, the largest at which they fit at `size` [texels].
    """
    count = int(chart.max()) + 1
    low, high = _boxes(flat, chart, count)
    extent = high - low
    lying = extent[:, 1] > extent[:, 0]  # tall charts are laid down
    extent[lying] = extent[lying, ::-1]
    room = size * np.sqrt(FILL / count) - 1
    padding = float(np.clip(room, 0.0, padding))
    order = np.argsort(-extent[:, 1], kind="stable")
    scale = _largest_scale(extent[order], size, padding)
    place = np.empty_like(extent)
    place[order] = _placed(_cells(extent[order], scale, padding), size)[0]
    local = flat - low[chart][:, None]
    local = np.where(lying[chart][:, None, None], local[..., ::-1], local)
    # turning a chart by swapping its axes would mirror it: count one of them from the other end
    across = extent[chart][:, None, 1] - local[..., 1]
    local = np.stack([local[..., 0], np.where(lying[chart][:, None], across, local[..., 1])], -1)
    texels = local * scale + place[chart][:, None] + (padding + 1) / 2
    return np.clip(texels / size, 0, 1), padding


def _boxes(flat: np.ndarray, chart: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, flat.min(1))
    np.maximum.at(high, chart, flat.max(1))
    return low, high


def _cells(extent: np.ndarray, scale: float, padding: float) -> np.ndarray:
    """Width and height [texels] that each chart takes, a margin of (padding + 1)/2 all around."""
    return extent * scale + padding + 1


def _largest_scale(extent: np.ndarray, size: int, padding: float) -> float:
    low, high = 0.0, size / float(extent.max())
    for _ in range(STEPS):
        scale = (low + high) / 2
        cells = _cells(extent, scale, padding)
        fits = cells.max() <= size and _placed(cells, size)[1] <= size
        low, high = (scale, high) if fits else (low, scale)
    return low


def _placed(cells: np.ndarray, size: int) -> tuple[np.ndarray, float]:
    """Left top corners of cells by falling height, and the height that they take together."""
    ends = np.cumsum(cells[:, 0])
    place = np.empty_like(cells)
    start, top = 0, 0.0
    while start < len(cells):
        before = ends[start - 1] if start else 0.0
        stop = max(int(np.searchsorted(ends, before + size, side="right")), start + 1)
        place[start:stop, 0] = ends[start:stop] - cells[start:stop, 0] - before
        place[start:stop, 1] = top
        top += cells[start, 1]
        start = stop
    return place, top
