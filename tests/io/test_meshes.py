"""Every format gives the same mesh; faults are named; nothing is assumed in silence."""

import json
import struct
import time

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from texsss.errors import AssetError
from texsss.io._polygons import triangulate
from texsss.io.meshes import UPRIGHT, read_mesh
from texsss.numerics.sampling import bilinear

SQUARE = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"
CORNERS = torch.tensor([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
V_DOWN = torch.tensor([[0.0, 1], [1, 1], [1, 0], [0, 0]])


def glb(positions, indices, uv=None, **extra) -> bytes:
    """A binary glTF of one mesh, its uv v down as the format has it."""
    blocks = [np.asarray(positions, "<f4").tobytes(), np.asarray(indices, "<u4").tobytes()]
    kinds = [(5126, "VEC3", len(positions)), (5125, "SCALAR", np.size(indices))]
    attributes = {"POSITION": 0}
    if uv is not None:
        attributes["TEXCOORD_0"] = 2
        blocks.append(np.asarray(uv, "<f4").tobytes())
        kinds.append((5126, "VEC2", len(uv)))
    starts = np.cumsum([0, *map(len, blocks)])
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 1}]}],
        "accessors": [
            {"bufferView": i, "componentType": c, "type": t, "count": int(n)}
            for i, (c, t, n) in enumerate(kinds)
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": int(s), "byteLength": len(b)} for s, b in zip(starts, blocks)
        ],
        "buffers": [{"byteLength": int(starts[-1])}],
        **extra,
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", int(starts[-1]), b"BIN\0") + b"".join(blocks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def ply() -> bytes:
    rows = "".join(
        f"{x:g} {y:g} {z:g} {u:g} {1 - v:g}\n" for (x, y, z), (u, v) in zip(CORNERS.tolist(), V_DOWN.tolist())
    )
    return (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "property float s\nproperty float t\nelement face 2\n"
        "property list uchar int vertex_indices\nend_header\n"
        f"{rows}3 0 1 2\n3 0 2 3\n"
    ).encode()


def stl() -> bytes:
    rows = b"".join(
        struct.pack("<12fH", 0, 0, 1, *CORNERS[list(t)].reshape(-1).tolist(), 0)
        for t in ((0, 1, 2), (0, 2, 3))
    )
    return b"\0" * 80 + struct.pack("<I", 2) + rows


def test_files_that_are_written_otherwise_than_usual():
    """Binary STL that says solid, with more behind its triangles; text STL in capitals; late vertices."""
    binary = b"solid x".ljust(80, b" ") + stl()[80:] + b"made by a scanner"
    text = "solid a\n" + "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x:g} {y:g} {z:g}\n" for x, y, z in rows)
        for rows in (CORNERS[[0, 1, 2]].tolist(), CORNERS[[0, 2, 3]].tolist())
    )
    late = b"# " + b"x" * (1 << 21) + b"\n" + SQUARE.encode()
    for data, name in ((binary, "a.stl"), (text.upper().encode(), "b.stl"), (late, "c.obj")):
        mesh, _ = read_mesh(data, name=name, unit_mm=1)
        torch.testing.assert_close(mesh.vertices[mesh.faces.long()].amax((0, 1)), CORNERS.amax(0))
        assert len(mesh.faces) == 2


@pytest.mark.parametrize(
    "data",
    [SQUARE.encode(), ply(), stl(), glb(CORNERS, [0, 1, 2, 0, 2, 3], V_DOWN)],
    ids=["obj", "ply", "stl", "glb"],
)
def test_every_format_gives_the_same_square(data):
    """Positions, orientation, order of faces, and v down whatever the format has."""
    mesh, notes = read_mesh(data, unit_mm=10)
    torch.testing.assert_close(mesh.corners, CORNERS[torch.tensor([[0, 1, 2], [0, 2, 3]])] * 10)
    assert notes.size_mm == (20, 10, 0) and not notes.unit_assumed
    if notes.uv == "complete":
        torch.testing.assert_close(mesh.source_uv, V_DOWN[torch.tensor([[0, 1, 2], [0, 2, 3]])])
    else:
        assert notes.file_format == "stl"


def test_the_heads_colours_agree_between_obj_and_glb(shared_data):
    """The colour map at corresponding points. This glTF has v up, as its exporter left it."""
    from PIL import Image

    image = np.asarray(Image.open(shared_data / "head" / "Map-COL.jpg").convert("RGB"))
    colours = torch.from_numpy(image.astype(np.float32) / 255)
    obj, _ = read_mesh(shared_data / "head" / "LeePerrySmith.obj")

    def centres(mesh):
        return (mesh.corners.mean(1) - mesh.vertices.amin(0)) / float(mesh.extent.max())

    difference = {}
    for v in ("auto", "down"):
        other, notes = read_mesh(shared_data / "head" / "LeePerrySmith.glb", v=v)
        assert (
            len(obj.faces) == len(other.faces) == 17684 and len(obj.vertices) == len(other.vertices) == 8844
        )
        assert any("upside down" in message for message in notes.messages)
        distance, nearest = torch.cdist(centres(obj)[::23], centres(other)).min(-1)
        # two exports of the scan, up to 3 % apart; measured 3.0e-3
        assert distance.mean() < 6e-3
        one = bilinear(colours, obj.source_uv[::23].mean(1))
        difference[v] = float((one - bilinear(colours, other.source_uv[nearest].mean(1))).abs().mean())
    assert difference["auto"] < 0.013  # measured 0.0065
    assert difference["down"] > 0.04  # measured 0.074


@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e6])
def test_merging_is_relative_to_the_size(scale):
    """A mesh of 1e-8 units keeps its vertices; a seam that differs by rounding closes at any size."""
    text = (
        f"v 0 0 0\nv {scale} 0 0\nv {scale} {scale} 0\n"
        f"v {scale * 1e-16} 0 0\nv {scale} {scale} {scale * 1e-17}\nv 0 {scale} 0\nf 1 2 3\nf 4 5 6\n"
    )
    mesh, notes = read_mesh(text.encode(), unit_mm=1)
    assert len(mesh.vertices) == 4 and len(mesh.faces) == 2 and notes.faces_dropped == 0


@pytest.mark.parametrize("up", list(UPRIGHT))
def test_up_becomes_y_by_a_rotation(up):
    matrix = np.array(UPRIGHT[up])
    axis = {"x": 0, "y": 1, "z": 2}[up[-1]]
    direction = np.eye(3)[axis] * (-1 if up[0] == "-" else 1)
    assert (matrix @ direction).tolist() == [0, 1, 0]
    assert np.linalg.det(matrix) == pytest.approx(1)


@pytest.mark.parametrize(
    "size, unit", [(0.42, 1000), (2.9, 1000), (3.1, 10), (40, 10), (299, 10), (301, 1), (5000, 1)]
)
def test_assumed_units_follow_the_stated_rule_and_are_told(size, unit):
    _, notes = read_mesh(f"v 0 0 0\nv 0 {size} 0\nv {size / 2} 0 0\nf 1 2 3".encode())
    assert notes.unit_mm == unit and notes.unit_assumed
    assert notes.height_mm == pytest.approx(size * unit, rel=1e-6)
    assert f"{unit:g} mm" in notes.messages[0] and "tall" in notes.messages[0]


def test_nodes_transform_and_mirror():
    """Moved, turned by 90° about z and mirrored: orientation stays outward."""
    node = {"mesh": 0, "translation": [5, 0, 0], "rotation": [0, 0, 0.5**0.5, 0.5**0.5], "scale": [-1, 1, 1]}
    mesh, _ = read_mesh(glb(CORNERS, [0, 1, 2, 0, 2, 3], V_DOWN, nodes=[node]), unit_mm=1)
    expected = CORNERS * torch.tensor([-1.0, 1, 1])
    expected = torch.stack([5 - expected[:, 1], expected[:, 0], expected[:, 2]], -1)
    torch.testing.assert_close(mesh.corners, expected[torch.tensor([[2, 1, 0], [3, 2, 0]])])
    assert bool((mesh.face_normals[:, 2] > 0.99).all())


def test_far_objects_are_moved_and_flat_faces_dropped_with_a_note():
    text = "v 1e6 0 0\nv 1000001 0 0\nv 1000000 1 0\nv 1000000.5 0 0\nf 1 2 3\nf 1 4 2\n"
    mesh, notes = read_mesh(text.encode(), unit_mm=1)
    assert notes.faces_dropped == 1 and len(mesh.faces) == 1
    assert any("was moved" in m for m in notes.messages) and any(
        "1 of 2 triangles" in m for m in notes.messages
    )
    torch.testing.assert_close(mesh.face_area, torch.tensor([0.5]))


def test_relative_indices_count_from_where_they_stand():
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\n"
    mesh, _ = read_mesh(text.encode(), unit_mm=1)
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.integers(4, 24))
def test_star_polygons_are_cut_into_their_own_area(seed, count):
    """Σ triangle areas is the polygon's (shoelace), all turning the same way."""
    generator = np.random.default_rng(seed)
    turn = np.arange(count) * (2 * np.pi / count)
    radius = generator.uniform(0.2, 1, count)
    flat = np.stack([radius * np.cos(turn), radius * np.sin(turn)], -1)
    shoelace = 0.5 * np.sum(flat[:, 0] * np.roll(flat[:, 1], -1) - flat[:, 1] * np.roll(flat[:, 0], -1))
    turned = np.linalg.qr(generator.normal(size=(3, 2)))[0].T
    cut = triangulate((flat @ turned)[None])[0]
    a, b, c = (flat[cut[:, k]] for k in range(3))
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (areas > -1e-12).all()
    assert areas.sum() == pytest.approx(shoelace, rel=1e-9)


def test_polygons_that_cross_themselves_end_soon():
    """A star of many turns has no ear: cut anyhow, once. Searched round after round it took 7 s."""
    turn = np.arange(401) * (2 * np.pi * 199 / 401)
    start = time.process_time()
    cut = triangulate(np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)[None])[0]
    assert time.process_time() - start < 1  # measured .05 s
    assert cut.shape == (399, 3) and set(cut.reshape(-1)) == set(range(401))


@pytest.mark.parametrize(
    "data, words",
    [
        (b"", "empty"),
        (b"<!DOCTYPE html>", "web page"),
        (b"PK\x03\x04....", "zip archive"),
        (b"version https://git-lfs.github.com/spec/v1", "Git LFS"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        (b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3", "NaN"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4", "vertex 4 of 3"),
        (b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3", "one point"),
        (b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3", "no triangle has any area"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\nf 1 2 3", "1 of 2 faces have no texture"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/9 3/1", "texture coordinate 9 of 1"),
        (b"v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3", "state the unit"),
        (glb(CORNERS, [0, 1, 2], extensionsRequired=["KHR_draco_mesh_compression"]), "Draco"),
        *((glb(CORNERS, [0, 1, 2], extensionsRequired=x), "malformed") for x in (5, [[]], [{}])),
        (glb(CORNERS, [0, 1, 2], V_DOWN[:2]), "do not match"),
        (glb(CORNERS, [0, 1, 2], nodes=[{"mesh": 0, "children": [0]}]), "reached twice"),
    ],
)
def test_faults_are_one_sentence_with_file_and_remedy(data, words):
    with pytest.raises(AssetError, match=words) as caught:
        read_mesh(data, name="thing.obj")
    sentence = str(caught.value)
    assert (
        sentence.startswith("thing.obj: ")
        and sentence.endswith(".")
        and ";" in sentence
        and "\n" not in sentence
    )


def test_missing_files_and_bad_options_are_named(tmp_path):
    with pytest.raises(AssetError, match=r"nothing\.obj: expected a mesh file, found none"):
        read_mesh(tmp_path / "nothing.obj")
    with pytest.raises(AssetError, match="found a folder"):
        read_mesh(tmp_path)
    with pytest.raises(AssetError, match="unit above 0"):
        read_mesh(SQUARE.encode(), unit_mm=0.0)


def test_what_is_left_out_of_a_scene_is_told_and_what_it_requires_refused():
    """glTF 2.0, section 3.12: a reader must not load what requires an extension that it doesn't know."""
    with pytest.raises(AssetError, match="VENDOR_other, which is not read; export without it"):
        read_mesh(glb(CORNERS, [0, 1, 2], extensionsRequired=["VENDOR_other"]), name="a.glb")
    used = ["KHR_texture_transform"]
    _, notes = read_mesh(glb(CORNERS, [0, 1, 2], extensionsUsed=used, extensionsRequired=used), name="a.glb")
    assert any("KHR_texture_transform" in note for note in notes.messages)
