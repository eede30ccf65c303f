"""Wavefront OBJ: faces in file order, texture coordinates per corner.

Read here rather than by trimesh, which regroups faces by material, drops texture coordinates
without a word when some faces lack them, and takes relative indices as counted from the end of the file.
"""

import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import chain

import numpy as np

from texsss.io._polygons import triangulate
from texsss.io._raw import Fault, RawMesh, check_counts, check_indices

ABSENT = 1 << 40  # stands for a corner's texture coordinate where none is stated
LARGEST = 1 << 31  # no mesh has more of anything
NO_DIGITS = str.maketrans("", "", "0123456789")
COMMENTED_OUT = re.compile(r"(#.*)\\$", re.MULTILINE)  # a backslash that continues nothing
JOINED = "\v"  # a blank that stands where a line was continued, so that lines can still be counted
STATEMENT = re.compile(r"^[ \t]*(vt?|f)(?:[ \t]+(.*))?$", re.MULTILINE)


def read_obj(data: bytes) -> RawMesh:
    """The triangles of an OBJ file; materials, normals, lines and points are left out.

    v of texture coordinates runs up in OBJ and is turned. Raises Fault: when lines cannot be understood,
    indices lead nowhere, or only some of the faces have texture coordinates.
    """
    text = data.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    text = COMMENTED_OUT.sub(r"\1", text.replace(JOINED, " ")).replace("\\\n", f" {JOINED}")
    found = STATEMENT.findall(text)
    vertices, coordinates, faces = (_Statements(text, key, found) for key in ("v", "vt", "f"))
    points = vertices.table(least=3, most=3)
    places = coordinates.table(least=1, most=2)
    if not faces.rest:
        what = f"{len(points)} vertices but no faces" if len(points) else "no vertices and no faces"
        raise Fault(f"expected triangles, found {what}", "give a mesh with a surface")
    corners, sizes = _corners(faces, found)
    check_counts(len(points), int((sizes - 2).sum()))
    triangles = _triangles(points, corners, sizes)
    return RawMesh(points, triangles[..., 0], _uv(triangles[..., 1], places))


class _Statements:
    """All statements of one kind: `rest`, what follows the keyword."""

    def __init__(self, text: str, key: str, found: list[tuple[str, str]]):
        self.text, self.key = text, key
        self.rest = [rest for kind, rest in found if kind == key]

    def table(self, *, least: int, most: int) -> np.ndarray:
        """The first `most` numbers of every statement, 0 where fewer than that but `least` are given.

        Raises Fault: where fewer than `least` are, or what is no number.
        """
        if self.rest and all(map(str.strip, self.rest)):
            with suppress(ValueError):  # a short one, or no number: word by word
                return np.loadtxt(self.rest, usecols=range(most), ndmin=2, comments=None)
        words = [rest.split(None, most)[:most] for rest in self.rest]
        for number, row in enumerate(words):
            if len(row) < least:
                raise self.fault(number, f"expected {least} numbers, got {len(row)}")
            row += ["0"] * (most - len(row))
        values = self.all_read(float, words, chain.from_iterable(words))
        return np.array(values, dtype=np.float64).reshape(-1, most)

    def all_read(self, read: Callable[[str], object], words: list[list[str]], given: Iterable[str]) -> list:
        """`read` of all `given` words. Raises Fault, naming the line: where one is not understood."""
        try:
            return list(map(read, given))
        except ValueError:
            for number, row in enumerate(words):
                try:
                    list(map(read, row))
                except ValueError as error:
                    raise self.fault(number, str(error)) from None
            raise

    def fault(self, number: int, what: str) -> Fault:
        """What is wrong with one of the statements, and on which line it stands."""
        matches = (match for match in STATEMENT.finditer(self.text) if match[1] == self.key)
        match = next(match for k, match in enumerate(matches) if k == number)
        line = sum(self.text.count(mark, 0, match.start()) for mark in ("\n", JOINED)) + 1
        said = " ".join(match[0].split())[:40]
        return Fault(f"line {line} is not understood ({said!r}: {what})")


def _corners(faces: _Statements, found: list[tuple[str, str]]) -> tuple[np.ndarray, np.ndarray]:
    """Vertex and texture coordinate (N, 2), from 0, of corners, −1 for none; how many each face has."""
    words = [rest.split("#", 1)[0].split() for rest in faces.rest]
    sizes = np.fromiter(map(len, words), dtype=np.int64, count=len(words))
    if sizes.min() < 3:
        face = int(sizes.argmin())
        raise faces.fault(face, f"expected 3 corners or more, got {sizes[face]}")
    flat = list(chain.from_iterable(words))
    stated = _alike(flat)
    if stated is None:
        stated = np.array(faces.all_read(_corner, words, flat), dtype=np.int64)
    index = stated - 1
    if (stated < 0).any():  # counted back from the latest of its kind
        kinds = np.array([kind for kind, _ in found])
        seen = np.stack([np.cumsum(kinds == "v"), np.cumsum(kinds == "vt")], -1)[kinds == "f"]
        index = np.where(stated < 0, seen.repeat(sizes, axis=0) + stated, index)
        if (index < 0).any():
            row, column = (int(k) for k in np.argwhere(index < 0)[0])
            known = index[row, column] - stated[row, column]
            face = int(np.searchsorted(np.cumsum(sizes), row, side="right"))
            raise faces.fault(face, f"goes {-index[row, column]} before the first of {known}")
    index[stated == ABSENT] = -1
    return index, sizes


def _alike(words: list[str]) -> np.ndarray | None:
    """Vertex and texture coordinate of corners as stated, if all are written alike and count from 1."""
    text = " ".join(words)
    marks = set(text.translate(NO_DIGITS).split(" "))
    if marks not in ({""}, {"/"}, {"//"}):
        return None
    if marks == {"//"} and text.count("//") not in (0, len(words)):
        return None
    values = np.fromstring(text.replace("/", " "), dtype=np.int64, sep=" ")
    given = len(values) // len(words)
    # no word holds more numbers than its marks allow, so that this many mean as many in each
    allowed = 2 if "//" in text else 1 + len(next(iter(marks)))
    if len(values) != allowed * len(words) or not (values.min() > 0 and values.max() <= LARGEST):
        return None
    stated = values.reshape(-1, given)[:, :2]
    if given == 1 or "//" in text:
        return np.stack([stated[:, 0], np.full(len(stated), ABSENT)], -1)
    return stated


def _corner(word: str) -> tuple[int, int]:
    """Vertex and texture coordinate of a corner as stated."""
    vertex, _, others = word.partition("/")
    place = others.partition("/")[0]
    corner = int(vertex), int(place) if place else ABSENT
    if 0 in corner:
        raise ValueError("indices start at 1")
    if any(abs(index) > LARGEST and index != ABSENT for index in corner):
        raise ValueError("an index beyond any mesh")
    return corner


def _triangles(points: np.ndarray, corners: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Corners (F, 3, 2) of all triangles in file order."""
    start = np.cumsum(sizes) - sizes
    first = np.cumsum(sizes - 2) - (sizes - 2)
    result = np.empty((int((sizes - 2).sum()), 3, 2), dtype=np.int64)
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        polygons = corners[start[rows, None] + np.arange(size)]  # (N, n, 2)
        check_indices(polygons[..., 0], len(points), counted_from=1)
        cut = triangulate(points[polygons[..., 0]])  # (N, n − 2, 3)
        result[first[rows, None] + np.arange(size - 2)] = polygons[np.arange(len(rows))[:, None, None], cut]
    return result


def _uv(places: np.ndarray, coordinates: np.ndarray) -> np.ndarray | None:
    if (places < 0).all():
        return None
    lacking = (places < 0).any(-1)
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
    uv = coordinates[places]
    uv[..., 1] = 1 - uv[..., 1]
    return uv
