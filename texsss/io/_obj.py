"""Wavefront OBJ: faces in file order, texture coordinates per corner.

Read here rather than by trimesh, which regroups faces by material, drops texture coordinates
without a word when some faces lack them, and takes relative indices as counted from the end of the file.
"""

import numpy as np

from texsss.io._polygons import triangulate
from texsss.io._raw import Fault, RawMesh, check_counts, check_indices

Corner = tuple[int, int]  # vertex and texture coordinate, from 0; −1 where there is none


def read_obj(data: bytes) -> RawMesh:
    """The triangles of an OBJ file; materials, normals, lines and points are left out.

    v of texture coordinates runs up in OBJ and is turned. Raises Fault: when lines cannot be understood,
    indices lead nowhere, or only some of the faces have texture coordinates.
    """
    text = data.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    vertices, coordinates, polygons = _parse(text)
    if not polygons:
        what = f"{len(vertices)} vertices but no faces" if vertices else "no vertices and no faces"
        raise Fault(f"expected triangles, found {what}", "give a mesh with a surface")
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    check_counts(len(points), sum(len(p) - 2 for p in polygons))
    corners = _triangles(points, polygons)
    faces, places = corners[..., 0], corners[..., 1]
    return RawMesh(points, faces, _uv(places, coordinates))


def _parse(text: str) -> tuple[list, list, list[list[Corner]]]:
    vertices: list[tuple[float, ...]] = []
    coordinates: list[tuple[float, ...]] = []
    polygons: list[list[Corner]] = []
    known: dict[str, Corner] = {}  # corners come back in every face around them
    for number, line in enumerate(text.splitlines(), 1):
        key, _, rest = line.lstrip().partition(" ") if "\t" not in line else _partition_tabs(line)
        try:
            if key == "v":
                vertices.append(_floats(rest, 3))
            elif key == "vt":
                coordinates.append((*_floats(rest, 1), 0.0)[:2])
            elif key == "f":
                polygons.append(_corners(rest, len(vertices), len(coordinates), known))
        except ValueError as error:
            raise Fault(f"line {number} is not understood ({line[:40].strip()!r}: {error})") from None
    return vertices, coordinates, polygons


def _partition_tabs(line: str) -> tuple[str, str, str]:
    return line.replace("\t", " ").lstrip().partition(" ")


def _floats(rest: str, least: int) -> tuple[float, ...]:
    words = rest.split(None, 3)[:3]
    if len(words) < least:
        raise ValueError(f"expected {least} numbers, got {len(words)}")
    if least == 3:
        return float(words[0]), float(words[1]), float(words[2])
    return tuple(float(word) for word in words[:2])


def _corners(rest: str, vertices: int, coordinates: int, known: dict[str, Corner]) -> list[Corner]:
    """The corners of a face; those that do not count back from the latest vertex go into `known`."""
    words = rest.split("#", 1)[0].split()
    if len(words) < 3:
        raise ValueError(f"expected 3 corners or more, got {len(words)}")
    corners = []
    for word in words:
        corner = known.get(word)
        if corner is None:
            parts = word.split("/")
            vertex = _from_zero(int(parts[0]), vertices)
            place = _from_zero(int(parts[1]), coordinates) if len(parts) > 1 and parts[1] else -1
            corner = vertex, place
            if "-" not in word:
                known[word] = corner
        corners.append(corner)
    return corners


def _from_zero(index: int, seen: int) -> int:
    """An index counted from 1, or back from the latest, as one from 0."""
    if index == 0:
        raise ValueError("indices start at 1")
    if index < 0:
        index += seen + 1
        if index <= 0:
            raise ValueError(f"goes {1 - index} before the first of {seen}")
    if index > 2**31:
        raise ValueError("an index beyond any mesh")
    return index - 1


def _triangles(points: np.ndarray, polygons: list[list[Corner]]) -> np.ndarray:
    """Corners (F, 3, 2) of all triangles in file order."""
    sizes = np.fromiter((len(p) for p in polygons), dtype=np.int64, count=len(polygons))
    first = np.cumsum(sizes - 2) - (sizes - 2)
    result = np.empty((int((sizes - 2).sum()), 3, 2), dtype=np.int64)
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        corners = np.array([polygons[row] for row in rows], dtype=np.int64)  # (N, n, 2)
        check_indices(corners[..., 0], len(points))
        cut = triangulate(points[corners[..., 0]])  # (N, n − 2, 3)
        result[first[rows, None] + np.arange(size - 2)] = corners[np.arange(len(rows))[:, None, None], cut]
    return result


def _uv(places: np.ndarray, coordinates: list) -> np.ndarray | None:
    lacking = (places < 0).any(-1)
    if lacking.all():
        return None
    if lacking.any():
        raise Fault(
            f"{np.count_nonzero(lacking):,} of {lacking.size:,} faces have no texture coordinates, others do",
            "unwrap them too, or export without texture coordinates",
        )
    if places.max() >= len(coordinates):
        raise Fault(
            f"a face refers to texture coordinate {int(places.max()) + 1} of {len(coordinates)}",
            "the file is damaged, export it again",
        )
    uv = np.array(coordinates, dtype=np.float64)[places]
    uv[..., 1] = 1 - uv[..., 1]
    return uv
