"""glTF 2.0: the triangles of the scene, with node transforms.

Read here rather than by trimesh, which drops texture coordinates of meshes without a material, and
allocates what a header claims before it looks. Every count is checked against the bytes present.
"""

import base64
import json
import struct
from typing import Any

import numpy as np

from texsss.io._raw import Fault, RawMesh, check_counts, check_indices

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
HARMLESS = (  # extensions that leave triangles where they are
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_punctual", "KHR_mesh_quantization"),
    *("KHR_xmp", "KHR_animation_pointer"),
)
COMPRESSED = {"KHR_draco_mesh_compression": "Draco", "EXT_meshopt_compression": "meshopt"}
MAX_NODES = 100_000
EARLY_BLENDER = "Khronos Blender glTF 2.0 exporter"  # its successor calls itself "… Blender I/O"
DAMAGED = "the file is damaged, export it again"


def read_glb(data: bytes) -> RawMesh:
    """The triangles of a binary glTF file, in the order of its nodes. Raises Fault: see `read_gltf`."""
    if len(data) < 20:
        raise Fault(f"expected a binary glTF of 20 bytes or more, got {len(data)}", DAMAGED)
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise Fault(f"expected glTF version 2, got {version}", "export it as glTF 2.0")
    if length > len(data):
        raise Fault(
            f"the header claims {length:,} bytes, the file has {len(data):,}",
            "it is cut short, copy it again",
        )
    document, binary, at = None, b"", 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise Fault("a chunk runs past the end of the file", "it is cut short, copy it again")
        chunk = data[at + 8 : at + 8 + size]
        if kind == b"JSON" and document is None:
            document = chunk
        elif kind == b"BIN\0" and not binary:
            binary = chunk
        at += 8 + size
    if document is None:
        raise Fault("expected a JSON chunk, found none", DAMAGED)
    return read_gltf(document, binary)


def read_gltf(document: bytes, binary: bytes | None = None) -> RawMesh:
    """The triangles of a glTF document whose buffers are embedded.

    v of texture coordinates runs down, as in texsss. Raises Fault: when anything leads nowhere, refers to
    other files, is compressed, or only some of the triangles have texture coordinates.
    """
    try:
        doc = json.loads(document)
    except (ValueError, RecursionError):
        raise Fault("its JSON is not readable", DAMAGED) from None
    if not isinstance(doc, dict):
        raise Fault(f"expected a JSON object, got a {type(doc).__name__}", DAMAGED)
    try:
        for name in doc.get("extensionsRequired") or []:
            if name in COMPRESSED:
                raise Fault(
                    f"it is compressed with {COMPRESSED[name]}, which is not read",
                    "export it without compression",
                )
            if not str(name).startswith(HARMLESS):
                raise Fault(
                    f"it requires the extension {str(name)[:60]}, which is not read", "export without it"
                )
        return _Reader(doc, binary).read()
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError):
        raise Fault("a part that it refers to is missing or malformed", DAMAGED) from None


class _Reader:
    """One document with its buffers."""

    def __init__(self, doc: dict[str, Any], binary: bytes | None):
        self.doc, self.binary = doc, binary
        self.notes: list[str] = []

    def read(self) -> RawMesh:
        """All triangles of the scene as one mesh. Raises Fault: when it has none, or is malformed."""
        vertices, faces, uv = [], [], []
        seen = triangles = 0
        for mesh, matrix in self._instances():
            for primitive in self.doc["meshes"][mesh]["primitives"]:
                part = self._primitive(primitive)
                if part is None:
                    continue
                points, index, coordinates = part
                seen, triangles = seen + len(points), triangles + len(index)
                check_counts(seen, triangles)
                if np.linalg.det(matrix[:3, :3]) < 0:  # a mirror turns triangles inside out
                    index = index[:, ::-1]
                with np.errstate(invalid="ignore", over="ignore"):
                    vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
                faces.append(index + seen - len(points))
                uv.append(None if coordinates is None else coordinates[index])
        if not triangles:
            raise Fault("expected triangles, found none in its scene", "give a mesh with a surface")
        if self.doc.get("skins") or self.doc.get("animations"):
            self.notes.append("skins and animations were left out: the mesh is in its rest pose")
        if any(part.get("targets") for mesh in self.doc["meshes"] for part in mesh["primitives"]):
            self.notes.append("morph targets were left out: the mesh has its base shape")
        if "KHR_texture_transform" in (self.doc.get("extensionsUsed") or []):
            self.notes.append(
                "its materials move their maps (KHR_texture_transform), which is not read: bake that into "
                "the texture coordinates"
            )
        texture = self._joined(uv, faces)
        if texture is not None and not self.doc.get("images"):
            return self._without_maps(np.concatenate(vertices), np.concatenate(faces), texture)
        return RawMesh(np.concatenate(vertices), np.concatenate(faces), texture, self.notes, "down")

    def _without_maps(self, vertices: np.ndarray, faces: np.ndarray, texture: np.ndarray) -> RawMesh:
        """A mesh none of whose maps can tell which way v runs: the format's way, or its exporter's."""
        if not str(self.doc["asset"].get("generator", "")).startswith(EARLY_BLENDER):
            self.notes.append("it brings no map of its own: should yours land upside down, set v to up")
            return RawMesh(vertices, faces, texture, self.notes, "down")
        texture[..., 1] = 1 - texture[..., 1]
        self.notes.append(
            "it has no map and comes from an early Blender exporter, so its v was taken to run up: "
            "should your map land upside down, set v to down"
        )
        return RawMesh(vertices, faces, texture, self.notes, "up")

    def _joined(self, uv: list, faces: list) -> np.ndarray | None:
        lacking = sum(len(f) for f, t in zip(faces, uv) if t is None)
        total = sum(len(f) for f in faces)
        if lacking == total:
            return None
        if lacking:
            raise Fault(
                f"{lacking:,} of {total:,} faces have no texture coordinates, others do",
                "unwrap them too, or export without texture coordinates",
            )
        return np.concatenate(uv)

    def _instances(self) -> list[tuple[int, np.ndarray]]:
        """Mesh index and world matrix of every node in the scene, parents first."""
        nodes = self.doc.get("nodes") or []
        scenes = self.doc.get("scenes") or []
        if not nodes or not scenes:
            raise Fault("expected a scene with a mesh, found none", "export the object with its scene")
        if len(nodes) > MAX_NODES:
            raise Fault(f"expected at most {MAX_NODES:,} nodes, got {len(nodes):,}", "join the objects")
        roots = scenes[self.doc.get("scene") or 0]["nodes"]
        waiting = [(root, np.eye(4)) for root in reversed(roots)]
        reached: set[int] = set()
        found = []
        while waiting:
            number, above = waiting.pop()
            if number in reached:
                raise Fault(
                    f"node {number} is reached twice, while glTF wants a tree",
                    "export it again, without shared nodes",
                )
            reached.add(_index(number, nodes))
            node = nodes[number]
            matrix = above @ _matrix(node)
            if "mesh" in node:
                found.append((_index(node["mesh"], self.doc["meshes"]), matrix))
            waiting += [(child, matrix) for child in reversed(node.get("children") or [])]
        return found

    def _primitive(self, primitive: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray | None] | None:
        for name in primitive.get("extensions") or {}:
            if name in COMPRESSED:
                raise Fault(
                    f"it is compressed with {COMPRESSED[name]}, which is not read",
                    "export it without compression",
                )
        mode = primitive.get("mode", 4)
        if mode not in (4, 5, 6):
            self.notes.append("points and lines were left out")
            return None
        attributes = primitive["attributes"]
        points = self._accessor(attributes["POSITION"], "VEC3").astype(np.float64)
        if "indices" in primitive:
            flat = self._accessor(primitive["indices"], "SCALAR")[:, 0].astype(np.int64)
        else:
            flat = np.arange(len(points))
        index = _assembled(flat, mode)
        check_indices(index, len(points))
        if "TEXCOORD_0" not in attributes:
            return points, index, None
        uv = self._accessor(attributes["TEXCOORD_0"], "VEC2").astype(np.float64)
        if len(uv) != len(points):
            raise Fault(
                f"{len(uv):,} texture coordinates for {len(points):,} vertices do not match",
                "export it again",
            )
        return points, index, uv

    def _accessor(self, number: int, kind: str) -> np.ndarray:
        """Values (count, width) of an accessor, normalised integers as numbers in −1..1."""
        accessor = self.doc["accessors"][_index(number, self.doc["accessors"])]
        if accessor["type"] != kind or accessor["componentType"] not in COMPONENTS:
            raise Fault(f"accessor {number} is no {kind} of a known kind", DAMAGED)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise Fault(
                f"accessor {number} is sparse, which is not read", "export it without sparse accessors"
            )
        dtype, width, count = np.dtype(COMPONENTS[accessor["componentType"]]), WIDTHS[kind], accessor["count"]
        views = self.doc["bufferViews"]
        view = views[_index(accessor["bufferView"], views)]
        buffer = self._buffer(view["buffer"])
        start, size = view.get("byteOffset", 0), view["byteLength"]
        offset, step = accessor.get("byteOffset", 0), view.get("byteStride") or dtype.itemsize * width
        numbers = (count, start, size, offset, step)
        if not all(isinstance(n, int) and n >= 0 for n in numbers) or step < dtype.itemsize * width:
            raise Fault(f"accessor {number} has sizes below zero or not whole", DAMAGED)
        needed = offset + (step * (count - 1) + dtype.itemsize * width if count else 0)
        if start + size > len(buffer) or needed > size:
            raise Fault(f"accessor {number} claims {count:,} values, more than the file holds", DAMAGED)
        values = np.ndarray((count, width), dtype, buffer, start + offset, (step, dtype.itemsize))
        if accessor.get("normalized") and dtype.kind in "iu":
            return np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _buffer(self, number: int) -> bytes:
        buffer = self.doc["buffers"][_index(number, self.doc["buffers"])]
        uri = buffer.get("uri")
        if uri is None:
            if self.binary is None or number != 0:
                raise Fault("a buffer has no data", DAMAGED)
            return self.binary
        if not uri.startswith("data:"):
            raise Fault("its data lie in another file, which is not followed", "export it as one binary .glb")
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except ValueError:
            raise Fault("its embedded data are not valid base64", DAMAGED) from None


def _index(number: Any, of: list) -> int:
    if not isinstance(number, int) or not 0 <= number < len(of):
        raise Fault(f"it refers to part {str(number)[:20]} of {len(of)}", DAMAGED)
    return number


def _matrix(node: dict) -> np.ndarray:
    """A node's own transform, column vectors on the right."""
    if "matrix" in node:
        return _numbers(node["matrix"], 16).reshape(4, 4).T
    matrix = np.eye(4)
    if "rotation" in node:
        x, y, z, w = _numbers(node["rotation"], 4)
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    if "scale" in node:
        matrix[:3, :3] *= _numbers(node["scale"], 3)
    if "translation" in node:
        matrix[:3, 3] = _numbers(node["translation"], 3)
    return matrix


def _numbers(values: Any, count: int) -> np.ndarray:
    if len(values) != count or not all(isinstance(v, int | float) for v in values):
        raise Fault("a node's transform is not made of numbers", DAMAGED)
    numbers = np.array(values, dtype=np.float64)
    if not np.isfinite(numbers).all():
        raise Fault("a node's transform is not finite", DAMAGED)
    return numbers


def _assembled(flat: np.ndarray, mode: int) -> np.ndarray:
    """Triangles (F, 3) from a list (4), a strip (5) or a fan (6) of indices."""
    if mode == 4:
        return flat[: len(flat) // 3 * 3].reshape(-1, 3)
    if len(flat) < 3:
        return np.empty((0, 3), np.int64)
    if mode == 6:
        return np.stack([np.full(len(flat) - 2, flat[0]), flat[1:-1], flat[2:]], -1)
    strip = np.stack([flat[:-2], flat[1:-1], flat[2:]], -1)
    strip[1::2, :2] = strip[1::2, 1::-1]  # every other triangle turns the other way
    return strip
