"""PLY and STL: headers checked against the bytes present, then STL read directly and PLY by trimesh."""

import io
import re
import struct
import warnings

import numpy as np

from texsss.io._raw import Fault, RawMesh, check_counts, check_indices

CUT = "it is cut short or damaged, copy it again"
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
PLY_BYTES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2,
    "int": 4, "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip


def read_stl(data: bytes) -> RawMesh:
    """The triangles of a binary or text STL; it has no texture coordinates. Raises Fault: when cut short."""
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else 0
    if len(data) >= 84 and (84 + 50 * count == len(data) or data.lstrip()[:5].lower() != b"solid"):
        if 84 + 50 * count > len(data):
            raise Fault(
                f"the header claims {count:,} triangles, the file holds {(len(data) - 84) // 50:,}", CUT
            )
        check_counts(3 * count, count)
        corners = np.frombuffer(data, STL_TRIANGLE, count, 84)["corners"].reshape(-1, 3)
    else:
        number = rb"\s+([-+.\w]+)"
        rows = re.findall(rb"vertex" + number * 3, data)
        try:
            corners = np.array([[float(word) for word in row] for row in rows]).reshape(-1, 3)
        except ValueError:
            raise Fault("a vertex is not made of three numbers") from None
        if len(corners) % 3:
            raise Fault("its last triangle is not complete", CUT)
        check_counts(len(corners), len(corners) // 3)
    if not len(corners):
        raise Fault("expected triangles, found none", "give a mesh with a surface")
    return RawMesh(corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3), None)


def read_ply(data: bytes) -> RawMesh:
    """The triangles of a PLY file; v of its texture coordinates runs up and is turned.

    Raises Fault: when the header is malformed, claims more than the file holds, or there are no faces.
    """
    faces = _check_ply(data)
    if not faces:
        raise Fault("expected triangles, found a point cloud", "reconstruct a surface first")
    from trimesh.exchange.ply import load_ply

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded = load_ply(io.BytesIO(data), skip_materials=True, fix_texture=True)
        vertices = np.asarray(loaded["vertices"], dtype=np.float64).reshape(-1, 3)
        index = _triangles(loaded["faces"])
        uv = getattr(loaded.get("visual"), "uv", None)
    except MemoryError:
        raise
    except Exception:  # the parser meets damage with whatever its next step raises
        raise Fault("its body does not fit its header", CUT) from None
    check_indices(index, len(vertices))
    if uv is None:
        return RawMesh(vertices, index, None)
    uv = np.asarray(uv, dtype=np.float64)[index]
    uv[..., 1] = 1 - uv[..., 1]
    return RawMesh(vertices, index, uv)


def _triangles(faces) -> np.ndarray:
    from trimesh.geometry import triangulate_quads

    array = np.asarray(faces)
    if array.dtype.kind not in "iu" or array.ndim != 2 or array.shape[1] != 3:
        array = triangulate_quads(faces, dtype=np.int64)
    return np.asarray(array, dtype=np.int64).reshape(-1, 3)


def _check_ply(data: bytes) -> int:
    """The number of faces that the header claims, once the file is long enough for all that it claims."""
    end = data.find(b"end_header")
    if end < 0 or end > 100_000:
        raise Fault("expected a PLY header, found no end of it", CUT)
    lines = [line.split() for line in data[:end].decode("ascii", errors="replace").splitlines()]
    binary, smallest, counts, element = True, 0, {}, 0
    try:
        for words in lines:
            if words[:1] == ["format"]:
                binary = words[1] != "ascii"
            elif words[:1] == ["element"]:
                element = int(words[2])
                counts[words[1]] = element
                if element < 0:
                    raise ValueError
            elif words[:1] == ["property"]:
                # at least a list's own length, or two bytes of text
                size = PLY_BYTES[words[2] if words[1] == "list" else words[1]] if binary else 2
                smallest += element * size
    except (ValueError, IndexError, KeyError):
        raise Fault("its header is malformed") from None
    present = len(data) - end
    if smallest > present:
        raise Fault(f"its header claims {max(counts.values()):,} elements, more than the file holds", CUT)
    check_counts(counts.get("vertex", 0), counts.get("face", 0))
    return counts.get("face", 0)
