"""What a file is, told from its first bytes before its name."""

import re
from typing import Literal

from texsss.io._raw import Fault

MeshFormat = Literal["obj", "ply", "stl", "glb", "gltf"]
SUPPORTED = "OBJ, PLY, STL, GLB or glTF"
FOREIGN = {
    b"PK\x03\x04": "a zip archive",
    b"PK\x05\x06": "a zip archive",
    b"\x1f\x8b": "a gzip archive",
    b"7z\xbc\xaf": "a 7z archive",
    b"Rar!": "a rar archive",
    b"BZh": "a bzip2 archive",
    b"\xfd7zXZ": "an xz archive",
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"GIF8": "a GIF image",
    b"II*\x00": "a TIFF image",
    b"MM\x00*": "a TIFF image",
    b"v/1\x01": "an OpenEXR image",
    b"%PDF": "a PDF",
    b"\x7fELF": "a program",
    b"BLENDER": "a Blender file",
    b"Kaydara FBX": "an FBX file",
    b"version https://git-lfs": "a Git LFS pointer, not the file itself",
}


VERTEX = re.compile(rb"(?:^|[\r\n])[ \t]*v[ \t]")


def mesh_format(data: bytes, hint: str = "") -> MeshFormat:
    """Which of the formats the bytes of a mesh file are in.

    `hint`: the name's ending, asked only where the content leaves it open.
    Raises Fault: when they are none of the formats.
    """
    hint = hint.lower().lstrip(".")
    head = data[:4096].lstrip(b"\xef\xbb\xbf \t\r\n")
    if not data:
        raise Fault("the file is empty", "export it again")
    if data[:4] == b"glTF":
        return "glb"
    for magic, what in FOREIGN.items():
        if head.startswith(magic):
            raise Fault(f"expected {SUPPORTED}, found {what}", "unpack or export it first")
    if head[:4] in (b"ply\n", b"ply\r"):
        return "ply"
    if head[:1] in (b"{", b"["):
        return "gltf"
    if head[:1] == b"<":
        raise Fault(f"expected {SUPPORTED}, found a web page or XML", "export the mesh in one of these")
    if len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return "stl"
    if head[:5].lower() == b"solid" and b"facet" in data[:100_000].lower():
        return "stl"
    if _looks_like_obj(data[: 1 << 20]) or (hint == "obj" and _looks_like_obj(data)):
        return "obj"
    if hint == "stl" and len(data) >= 84:
        return "stl"
    raise Fault(f"expected {SUPPORTED}, found none of them in its content", "export the mesh in one of these")


def _looks_like_obj(data: bytes) -> bool:
    """Whether some line is a vertex."""
    return VERTEX.search(data) is not None
