"""PLY: headers checked against the bytes present, faces of any number of corners, ASCII and binary.

Read here rather than by trimesh, which refuses binary files whose faces differ in corners, and cuts
concave ones beyond their outline.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from texsss.io._polygons import triangulate
from texsss.io._raw import Fault, RawMesh, check_counts, check_indices

CUT = "it is cut short or damaged, copy it again"
KINDS = {
    "char": "i1", "uchar": "u1", "int8": "i1", "uint8": "u1", "short": "i2", "ushort": "u2", "int16": "i2",
    "uint16": "u2", "int": "i4", "uint": "u4", "int32": "i4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
INDICES = ("vertex_indices", "vertex_index")
COORDINATES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))


@dataclass
class Element:
    """`count` rows of properties: (name, kind) of numbers, (name, kind, kind of the length) of lists."""

    name: str
    count: int
    properties: list[tuple[str, ...]] = field(default_factory=list)

    @property
    def least(self) -> int:
        """Bytes of a binary row whose lists are empty."""
        return sum(np.dtype(p[-1]).itemsize for p in self.properties)


def read_ply(data: bytes) -> RawMesh:
    """The triangles of a PLY file; v of its texture coordinates runs up and is turned.

    Raises Fault: when the header is malformed, claims more than the file holds, or there are no faces.
    """
    elements, order, start = _header(data)
    counts = {element.name: element.count for element in elements}
    if not counts.get("face"):
        raise Fault("expected triangles, found a point cloud", "reconstruct a surface first")
    try:
        columns = _ascii(data[start:], elements) if not order else _binary(data, start, elements, order)
        vertex, face = columns["vertex"], columns["face"]
        vertices = np.stack([np.asarray(vertex[axis], np.float64) for axis in "xyz"], -1)
        corners = next(face[name] for name in INDICES if name in face)
    except (KeyError, StopIteration):
        raise Fault("it lacks x, y, z or vertex_indices", "export it again") from None
    except (ValueError, IndexError, OverflowError):
        raise Fault("its body does not fit its header", CUT) from None
    lengths = np.diff(corners.ends, prepend=0)
    kept = np.flatnonzero(lengths >= 3)
    if not len(kept):
        raise Fault("expected triangles, found none", "give a mesh with a surface")
    check_counts(len(vertices), int((lengths[kept] - 2).sum()))
    number = corners.values.astype(np.int64)
    check_indices(number, len(vertices))
    flat = _cut(vertices[number], corners.ends, lengths, kept)  # places of corners, (F, 3)
    return RawMesh(vertices, number[flat], _coordinates(vertex, face, number, lengths, flat))


@dataclass
class Lists:
    """Lists of several lengths one after another; `ends`: where each stops."""

    values: np.ndarray
    ends: np.ndarray


def _cut(points: np.ndarray, ends: np.ndarray, lengths: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Triangles of all faces in order, as places in the list of corners."""
    first = np.concatenate([[0], np.cumsum(lengths[kept] - 2)])
    result = np.empty((first[-1], 3), np.int64)
    for count in np.unique(lengths[kept]):
        rows = np.flatnonzero(lengths[kept] == count)
        place = (ends - lengths)[kept[rows], None] + np.arange(count)
        cut = triangulate(points[place])
        result[first[rows, None] + np.arange(count - 2)] = place[np.arange(len(rows))[:, None, None], cut]
    return result


def _coordinates(
    vertex: dict, face: dict, number: np.ndarray, lengths: np.ndarray, flat: np.ndarray
) -> np.ndarray | None:
    """uv (F, 3, 2), v down, by corner or by vertex; None without."""
    uv = None
    held = face.get("texcoord")
    if isinstance(held, Lists) and np.array_equal(np.diff(held.ends, prepend=0), 2 * lengths):
        uv = np.asarray(held.values, np.float64).reshape(-1, 2)[flat]
    for names in COORDINATES:
        if uv is None and all(name in vertex for name in names):
            uv = np.stack([np.asarray(vertex[name], np.float64) for name in names], -1)[number[flat]]
    if uv is not None:
        uv[..., 1] = 1 - uv[..., 1]
    return uv


def _header(data: bytes) -> tuple[list[Element], str, int]:
    """Elements, byte order ("" for text) and where the body starts, once the file can hold what it claims."""
    end = data.find(b"end_header", 0, 100_000)
    line = data.find(b"\n", end)
    if end < 0 or line < 0:
        raise Fault("expected a PLY header, found no end of it", CUT)
    elements: list[Element] = []
    order = ""
    try:
        for words in (line.split() for line in data[:end].decode("ascii", errors="replace").splitlines()):
            if words[:1] == ["format"]:
                order = ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2])))
                if elements[-1].count < 0:
                    raise ValueError
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append((words[4], KINDS[words[3]], KINDS[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append((words[2], KINDS[words[1]]))
    except (ValueError, IndexError, KeyError):
        raise Fault("its header is malformed") from None
    # a number takes two bytes of text, but the last of all
    least = sum(e.count * (e.least if order else 2 * len(e.properties)) for e in elements)
    if least > len(data) - line:
        most = max(element.count for element in elements)
        raise Fault(f"its header claims {most:,} elements, more than the file holds", CUT)
    counts = {element.name: element.count for element in elements}
    check_counts(counts.get("vertex", 0), counts.get("face", 0))
    return elements, order, line + 1


def _ascii(body: bytes, elements: list[Element]) -> dict[str, dict]:
    """Columns of every element by name."""
    lines = [line for line in body.decode("ascii", errors="replace").splitlines() if line.strip()]
    found, row = {}, 0
    for element in elements:
        numbers = np.array(" ".join(lines[row : row + element.count]).split(), np.float64)
        row += element.count

        def read(kind: str, count: int, at: int, numbers: np.ndarray = numbers) -> tuple[np.ndarray, int]:
            if at + count > len(numbers):
                raise ValueError
            return numbers[at : at + count], at + count

        found[element.name], at = _columns(read, element, 0)
        if at != len(numbers):
            raise ValueError
    return found


def _binary(data: bytes, at: int, elements: list[Element], order: str) -> dict[str, dict]:
    """Columns of every element by name."""

    def read(kind: str, count: int, at: int) -> tuple[np.ndarray, int]:
        values = np.frombuffer(data, order + kind, count, at)
        return values, at + values.nbytes

    found = {}
    for element in elements:
        found[element.name], at = _alike(data, element, order, at) or _columns(read, element, at)
    return found


def _alike(data: bytes, element: Element, order: str, at: int) -> tuple[dict, int] | None:
    """Columns of an element whose lists are all as long as those of its first row; None otherwise."""
    parts: list[tuple] = []
    place = at
    for k, (_, kind, *length) in enumerate(element.properties):
        count = 1
        if length:
            parts.append((f"length {k}", order + length[0]))
            if element.count:
                count = int(np.frombuffer(data, order + length[0], 1, place)[0])
            place += np.dtype(length[0]).itemsize
        if not 0 <= count <= len(data):
            return None
        parts.append((str(k), order + kind, (count,)) if length else (str(k), order + kind))
        place += np.dtype(kind).itemsize * count
    row = np.dtype(parts)
    if at + row.itemsize * element.count > len(data):
        return None
    table = np.frombuffer(data, row, element.count, at)
    columns = {}
    for k, (name, _, *length) in enumerate(element.properties):
        if not length:
            columns[name] = table[str(k)]
            continue
        count = table[str(k)].shape[1]
        if not (table[f"length {k}"] == count).all():
            return None
        columns[name] = Lists(table[str(k)].reshape(-1), count * np.arange(1, element.count + 1))
    return columns, at + row.itemsize * element.count


def _columns(read: Callable, element: Element, at: int) -> tuple[dict, int]:
    """Columns of an element and where the next one starts, row by row.

    `read(kind, count, at)` gives that many numbers and where the next ones are.
    """
    parts: list[list] = [[] for _ in element.properties]
    for _ in range(element.count):
        for part, (_, kind, *length) in zip(parts, element.properties, strict=True):
            count = 1
            if length:
                (count,), at = read(length[0], 1, at)
            values, at = read(kind, int(count), at)
            part.append(values)
    columns = {}
    for part, (name, _, *length) in zip(parts, element.properties, strict=True):
        flat = np.concatenate(part) if part else np.zeros(0)
        columns[name] = Lists(flat, np.cumsum([len(one) for one in part])) if length else flat
    return columns, at
