"""GLB: what another reader gets back."""

import io
import json
import struct

import numpy as np
import pytest
import torch
import trimesh
from shapes import sphere

from texsss.errors import ShapeError
from texsss.io.gltf import write_glb
from texsss.numerics.sampling import bilinear
from texsss.surface.mesh import Mesh


def quadrants() -> torch.Tensor:
    """Red and green above, blue and white below."""
    image = torch.zeros(16, 16, 3)
    image[:8, :8, 0] = 1
    image[:8, 8:, 1] = 1
    image[8:, :8, 2] = 1
    image[8:, 8:] = 1
    return image


def sheet(source: bool) -> tuple[Mesh, torch.Tensor]:
    vertices = torch.tensor([[0.0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    uv = torch.tensor([[0.0, 1], [1, 1], [1, 0], [0, 0]])[faces]  # v down: y up is v 0
    return Mesh(vertices, faces, uv * 3 if source else None), uv


def document(path) -> dict:
    data = path.read_bytes()
    return json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])


@pytest.mark.parametrize("source", [False, True])
def test_another_reader_sees_the_texture_right_side_up(tmp_path, source):
    mesh, uv = sheet(source)
    write_glb(tmp_path / "a.glb", mesh, uv, quadrants())
    read = trimesh.load(tmp_path / "a.glb", force="mesh", process=False)
    np.testing.assert_allclose(read.bounds[1], [0.1, 0.1, 0.0], atol=1e-7)  # metres
    for corner, colour in {
        (0, 1): (255, 0, 0),
        (1, 1): (0, 255, 0),
        (0, 0): (0, 0, 255),
        (1, 0): (255, 255, 255),
    }.items():
        nearest = np.abs(read.vertices[:, :2] - np.array(corner) * 0.1).sum(1).argmin()
        u, v = np.clip(read.visual.uv[nearest], 0.01, 0.99)  # trimesh turns v upwards
        texture = read.visual.material.baseColorTexture
        assert texture.getpixel((int(u * 16), int((1 - v) * 16))) == colour
    attributes = document(tmp_path / "a.glb")["meshes"][0]["primitives"][0]["attributes"]
    assert ("TEXCOORD_1" in attributes) == source
    assert document(tmp_path / "a.glb")["materials"][0]["extensions"] == {"KHR_materials_unlit": {}}


def test_colours_survive_charts_and_seams(tmp_path):
    """Every corner of every face finds its texel, its normal and its place."""
    mesh = sphere(50.0, 2)
    generator = torch.Generator().manual_seed(0)
    uv = torch.rand(320, 3, 2, generator=generator)
    image = torch.rand(32, 32, 3, generator=generator)
    write_glb(tmp_path / "a.glb", mesh, uv, image)
    read = trimesh.load(tmp_path / "a.glb", force="mesh", process=False)
    back = read.visual.uv[read.faces].astype(np.float32)
    back[..., 1] = 1 - back[..., 1]
    assert len(read.faces) == 320
    np.testing.assert_allclose(back, uv.numpy(), atol=1e-6)
    np.testing.assert_allclose(read.vertices[read.faces], mesh.corners.numpy() * 1e-3, atol=1e-7)
    # trimesh makes its own normals: read ours by hand
    data, doc = (tmp_path / "a.glb").read_bytes(), document(tmp_path / "a.glb")
    accessor = doc["accessors"][doc["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]]
    start = (
        len(data) - doc["buffers"][0]["byteLength"] + doc["bufferViews"][accessor["bufferView"]]["byteOffset"]
    )
    normals = np.frombuffer(data, "<f4", accessor["count"] * 3, start).reshape(-1, 3)
    np.testing.assert_allclose(normals[read.faces], mesh.corner_normals.numpy(), atol=1e-6)
    texture = torch.from_numpy(np.asarray(read.visual.material.baseColorTexture)[..., :3] / np.float32(255))
    seen = bilinear(texture, torch.from_numpy(back).reshape(-1, 2))
    assert float((seen - bilinear(image, uv.reshape(-1, 2))).abs().max()) < 0.5 / 255 + 1e-5


def test_vertices_are_shared_where_nothing_differs(tmp_path):
    mesh = sphere(50.0, 2)
    smooth = torch.zeros(320, 3, 2)
    write_glb(tmp_path / "a.glb", mesh, smooth, quadrants())
    assert document(tmp_path / "a.glb")["accessors"][0]["count"] == mesh.vertices.shape[0]


def test_the_container_is_sound(tmp_path):
    mesh, uv = sheet(True)
    write_glb(tmp_path / "a.glb", mesh, uv, quadrants())
    data = (tmp_path / "a.glb").read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    assert (magic, version, length) == (b"glTF", 2, len(data)) and length % 4 == 0
    doc = document(tmp_path / "a.glb")
    for view in doc["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= doc["buffers"][0]["byteLength"]
    image = doc["bufferViews"][doc["images"][0]["bufferView"]]
    start = len(data) - doc["buffers"][0]["byteLength"] + image["byteOffset"]
    from PIL import Image

    assert Image.open(io.BytesIO(data[start : start + image["byteLength"]])).size == (16, 16)


def test_a_foreign_atlas_is_refused(tmp_path):
    mesh, _ = sheet(False)
    with pytest.raises(ShapeError, match="2 faces"):
        write_glb(tmp_path / "a.glb", mesh, torch.zeros(3, 3, 2), quadrants())
    assert not list(tmp_path.iterdir())
