"""A baked mesh as one GLB file that any viewer shows as it was baked."""

import json
import struct
from pathlib import Path

import numpy as np

from texsss.errors import ShapeError
from texsss.io.files import replacing
from texsss.io.images import encode_png
from texsss.surface.mesh import Mesh
from texsss.types import Float, Tensor

_UNLIT = {
    "extensionsUsed": ["KHR_materials_unlit"],
    "materials": [
        {
            "name": "baked",
            "doubleSided": True,
            "extensions": {"KHR_materials_unlit": {}},
            # what viewers without the extension fall back to
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0, "texCoord": 0},
                "metallicFactor": 0.0,
                "roughnessFactor": 1.0,
            },
        }
    ],
    "textures": [{"source": 0, "sampler": 0}],
    "samplers": [{"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}],
}
_METRES = 1e-3  # glTF counts in metres
_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963


def write_glb(
    path: str | Path, mesh: Mesh, atlas_uv: Float[Tensor, "F 3 2"], texture: Float[Tensor, "H W C"] | bytes
) -> None:
    """Writes `mesh` with its baked texture, unlit; whole or not at all.

    Positions go from mm to glTF's metres. `texture`: display-encoded values in 0..1 over `atlas_uv`,
    or the bytes of a PNG of them. TEXCOORD_0 is the atlas, so that viewers which know only one set
    show the bake; TEXCOORD_1 is the author's set, where there is one. v runs down in glTF as here.
    Vertices are split where normals or coordinates differ.
    Raises ShapeError: when `atlas_uv` does not fit the mesh. Raises AssetError: when it cannot write.
    Source: Khronos glTF 2.0; KHR_materials_unlit.
    """
    if atlas_uv.shape[0] != mesh.faces.shape[0]:
        raise ShapeError(
            f"write_glb: expected coordinates for {mesh.faces.shape[0]} faces, got {atlas_uv.shape[0]}; "
            "pass the atlas of this mesh."
        )
    png = texture if isinstance(texture, bytes) else encode_png(texture)
    data = glb(mesh, atlas_uv, png)
    with replacing(path) as beside:
        beside.write_bytes(data)


def glb(mesh: Mesh, atlas_uv: Float[Tensor, "F 3 2"], png: bytes | None = None) -> bytes:
    """The bytes of `write_glb`; without `png` the mesh and its texture coordinates alone."""
    attributes, indices = _split(mesh, atlas_uv)
    parts, views, accessors = [], [], []

    def view(data: bytes, target: int | None = None) -> int:
        start = sum(len(p) for p in parts)
        parts.append(data + b"\0" * (-len(data) % 4))
        views.append({"buffer": 0, "byteOffset": start, "byteLength": len(data)})
        if target is not None:
            views[-1]["target"] = target
        return len(views) - 1

    def accessor(array: np.ndarray, kind: str, component: int, target: int) -> int:
        entry = {"componentType": component, "count": len(array), "type": kind}
        entry["bufferView"] = view(array.tobytes(), target)
        accessors.append(entry)
        return len(accessors) - 1

    numbers = {}
    for name, array in attributes.items():
        numbers[name] = accessor(array, f"VEC{array.shape[1]}", _FLOAT, _VERTICES)
    position = attributes["POSITION"]
    accessors[numbers["POSITION"]] |= {"min": position.min(0).tolist(), "max": position.max(0).tolist()}
    faces = accessor(indices.astype("<u4"), "SCALAR", _UINT, _INDICES)
    primitive = {"attributes": numbers, "indices": faces}
    document = {
        "asset": {"version": "2.0", "generator": "texsss"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": mesh.name}],
        "meshes": [{"name": mesh.name, "primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": sum(len(p) for p in parts)}],
    }
    if png is not None:
        primitive["material"] = 0
        document |= _UNLIT
        document["images"] = [{"bufferView": view(png), "mimeType": "image/png", "name": "radiance"}]
        document["buffers"] = [{"byteLength": sum(len(p) for p in parts)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary = b"".join(parts)
    body = (
        struct.pack("<II", len(text), 0x4E4F534A)
        + text
        + struct.pack("<II", len(binary), 0x004E4942)
        + binary
    )
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body


def _split(mesh: Mesh, atlas_uv: Float[Tensor, "F 3 2"]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Attributes of the least vertices that tell all corners apart, and their indices."""
    columns = {"NORMAL": mesh.corner_normals, "TEXCOORD_0": atlas_uv}
    if mesh.source_uv is not None:
        columns["TEXCOORD_1"] = mesh.source_uv
    flat = {k: v.detach().cpu().float().reshape(-1, v.shape[-1]).numpy() for k, v in columns.items()}
    vertex = mesh.faces.detach().cpu().reshape(-1).numpy().astype(np.int32)
    # one row of bytes per corner; -0 and 0 are the same number
    table = np.concatenate([vertex[:, None], *((a + 0.0).view(np.int32) for a in flat.values())], 1)
    rows = np.ascontiguousarray(table).view([("", np.void, table.shape[1] * 4)])[:, 0]
    _, first, indices = np.unique(rows, return_index=True, return_inverse=True)
    position = mesh.vertices.detach().cpu().double().numpy()[vertex[first]] * _METRES
    attributes = {"POSITION": position.astype("<f4")} | {k: a[first].astype("<f4") for k, a in flat.items()}
    return attributes, indices.reshape(-1)
