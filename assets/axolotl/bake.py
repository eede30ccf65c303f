"""Texture-space rasterising, filling of the gutters, and writing of the maps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fields import Array
from mesh import Faces
from numpy.typing import NDArray
from pack import scan
from paint import paint
from PIL import Image
from scipy.ndimage import distance_transform_edt
from shape import Axolotl


@dataclass
class Texels:
    """Face and barycentric coordinates under every texel centre; face -1 off the charts."""

    face: NDArray[np.int64]
    bary: Array

    def interpolate(self, faces: Faces, values: Array) -> Array:
        """Vertex values at the covered texels, in row order."""
        inside = self.face >= 0
        return np.einsum("nk,nkc->nc", self.bary[inside], values[faces[self.face[inside]]])


def rasterise(uv: Array, uv_faces: Faces, size: int) -> Texels:
    """Faces and barycentric coordinates for all texels touched by a chart."""
    face = np.full(size * size, -1, dtype=np.int64)
    weights = np.zeros((size * size, 3))
    # A first pass a little beyond the borders, a second, exact one over it.
    for grow in (0.75, 0.0):
        for i, (where, bary) in enumerate(scan(uv, uv_faces, size, grow)):
            bary = np.clip(bary, 0.0, 1.0)
            face[where] = i
            weights[where] = bary / np.maximum(bary.sum(axis=1, keepdims=True), 1e-9)
    return Texels(face.reshape(size, size), weights.reshape(size, size, 3))


def coverage(uv: Array, uv_faces: Faces, size: int) -> tuple[float, int]:
    """Covered share of the square, and texel centres lying in two or more triangles."""
    hits = np.zeros(size * size, dtype=np.int64)
    for where, bary in scan(uv, uv_faces, size, 0.0):
        hits[where[np.all(bary > 1e-6, axis=1)]] += 1
    area = uv[uv_faces]
    d, e = area[:, 1] - area[:, 0], area[:, 2] - area[:, 0]
    return float(np.abs(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]).sum() / 2), int((hits > 1).sum())


def spread(image: Array, inside: NDArray[np.bool_]) -> Array:
    """Continue each chart into the gutter with the nearest covered texel."""
    index = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    return image[tuple(index)]


def save_maps(folder: Path, animal: Axolotl, p: Array, faces: Faces, texels: Texels) -> None:
    """Paint and write the four maps."""

    def interpolate(values: Array) -> Array:
        return texels.interpolate(faces, values)

    inside = texels.face >= 0
    for name, values in paint(animal, p, faces, interpolate(p), interpolate).items():
        image = np.zeros((*inside.shape, *values.shape[1:]))
        image[inside] = values
        data = (np.clip(spread(image, inside), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        Image.fromarray(data).save(folder / f"{name}.png", optimize=True)
