"""PLY in all its encodings: polygons of any corners, texture coordinates by vertex and by corner."""

import numpy as np
import pytest
import torch

from texsss.errors import AssetError
from texsss.io.meshes import read_mesh

POINTS = [(2, 0, 0), (0.5, 0.5, 0), (0, 2, 0), (0, 0, 0), (2, 2, 0)]
ARROW, FRONT = [0, 1, 2, 3], [0, 4, 1]  # a concave quad of area 1, a triangle beside it
ENCODINGS = ["ascii", "binary_little_endian", "binary_big_endian"]


def ply(faces, encoding: str = "ascii", uv=None, by_corner: bool = False) -> bytes:
    """A file of POINTS; `uv`, v up, for each of them, or by corner of the faces."""
    lines = ["ply", f"format {encoding} 1.0", "comment made up", f"element vertex {len(POINTS)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    by_vertex = uv is not None and not by_corner
    lines += ["property float s", "property float t"] if by_vertex else []
    lines += [f"element face {len(faces)}", "property uchar flags", "property list uchar int vertex_indices"]
    lines += ["property list uchar float texcoord"] if by_corner else []
    rows = [[("f4", v) for v in [*p, *(uv[k] if by_vertex else ())]] for k, p in enumerate(POINTS)]
    for face in faces:
        row = [("u1", 7), ("u1", len(face)), *(("i4", v) for v in face)]
        if by_corner:
            row += [("u1", 2 * len(face)), *(("f4", x) for v in face for x in uv[v])]
        rows.append(row)
    head = "\n".join([*lines, "end_header", ""]).encode()
    if encoding == "ascii":
        return head + "".join(" ".join(f"{v:g}" for _, v in row) + "\n" for row in rows).encode()
    order = ">" if "big" in encoding else "<"
    return head + b"".join(np.array(v, order + kind).tobytes() for row in rows for kind, v in row)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("faces,area", [([ARROW], 1.0), ([ARROW, FRONT], 2.5), ([FRONT, ARROW, FRONT], 4.0)])
def test_polygons_keep_their_outline(encoding, faces, area):
    """Concave ones, and faces of different corners in one file; a fan of the arrow has thrice its area."""
    mesh, _ = read_mesh(ply(faces, encoding), unit_mm=1)
    assert float(mesh.face_area.sum()) == pytest.approx(area)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("by_corner", [False, True])
def test_coordinates_by_vertex_and_by_corner(encoding, by_corner):
    uv = [(0.5 * x, 0.5 * y) for x, y, _ in POINTS]
    mesh, _ = read_mesh(ply([FRONT, ARROW], encoding, uv, by_corner), unit_mm=1)
    place = mesh.corners[..., :2] - mesh.corners[..., :2].amin((0, 1))
    torch.testing.assert_close(mesh.source_uv[..., 0], place[..., 0] / 2)
    torch.testing.assert_close(mesh.source_uv[..., 1], 1 - place[..., 1] / 2)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_files_cut_anywhere_are_told(encoding):
    whole = ply([ARROW, FRONT], encoding)
    body = whole.index(b"end_header") + 11
    for end in range(body, len(whole) - 2):
        with pytest.raises(AssetError, match=r"cut short|vertex"):
            read_mesh(whole[:end], name="arrow.ply")


@pytest.mark.parametrize(
    "spoil,words",
    [
        ((b"property float x", b"property float q"), "lacks x, y, z"),
        ((b"vertex_indices", b"corners"), "lacks x, y, z or vertex_indices"),
        ((b"element face 2", b"element face -2"), "malformed"),
        ((b"list uchar", b"list text"), "malformed"),
        ((b"format ascii", b"format morse"), "malformed"),
        ((b"\n7 3 0 4 1", b"\n7 3 0 4 9"), "vertex 9 of 5"),
        ((b"\n7 3 0 4 1", b"\n7 -3 0 4 1"), "does not fit"),
        ((b"element face 2", b"element face 0"), "point cloud"),
    ],
)
def test_faults_are_named(spoil, words):
    with pytest.raises(AssetError, match=words):
        read_mesh(ply([ARROW, FRONT]).replace(*spoil), name="arrow.ply")
