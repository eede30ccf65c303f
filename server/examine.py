"""What an upload is: told by a child of limited memory and time that reads it whole."""

import threading
from pathlib import Path
from typing import Literal

from pydantic import BaseModel
from texsss_server.problems import FOLDERS, Problem
from texsss_server.settings import Settings

from texsss.errors import AssetError, LimitError, TooLarge

MESHES = (".obj", ".ply", ".stl", ".glb")
MAPS = (".png", ".jpg", ".jpeg", ".webp", ".exr", ".hdr")
MAGIC = {
    ".glb": b"glTF",
    ".ply": b"ply",
    ".png": b"\x89PNG\r\n\x1a\n",
    ".jpg": b"\xff\xd8\xff",
    ".jpeg": b"\xff\xd8\xff",
    ".webp": b"RIFF",
    ".exr": b"v/1\x01",
    ".hdr": b"#?",
}
"""How files of these names begin; OBJ and STL are told apart by their reader."""

FOREIGN = (
    b"PK\x03\x04",
    b"\x1f\x8b",
    b"7z\xbc\xaf",
    b"Rar!",
    b"BZh",
    b"\xfd7zXZ",
    b"<",
    b"%PDF",
    b"\x7fELF",
    b"{",
)
"""Archives, XML, JSON and programs: refused by what they are, whatever their name."""


class Asset(BaseModel):
    """An upload: name it in a scene as {"asset": sha256}."""

    asset: str
    kind: Literal["mesh", "map"]
    name: str
    bytes: int
    faces: int | None = None
    vertices: int | None = None
    size_mm: tuple[float, float, float] | None = None
    unit_mm: float | None = None
    width: int | None = None
    height: int | None = None
    channels: int | None = None
    notes: tuple[str, ...] = ()


class Examiner:
    """Reads uploads in a child process, which starts with the first one. Safe for threads."""

    def __init__(self, settings: Settings):
        self.settings = settings
        self._starting = threading.Lock()
        self._sandbox = None

    def close(self) -> None:
        """Ends the child."""
        if self._sandbox is not None:
            self._sandbox.close()

    def warm(self) -> None:
        """Starts the child, which imports for seconds."""
        triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
        self._child().read_mesh(triangle, name="triangle.obj")

    def examine(self, digest: str, name: str, path: Path) -> Asset:
        """The description of a file called `name`, which a child read whole.

        Raises Problem: 415, 413, 422 when it is not what its name says, too large, or of no use.
        """
        data = path.read_bytes()
        ending = Path(name).suffix.lower()
        kind: Literal["mesh", "map"] = "mesh" if ending in MESHES else "map"
        head = data[:512].lstrip(b"\xef\xbb\xbf \t\r\n")
        wrong = ending in MAGIC and not data.startswith(MAGIC[ending])
        if data and (wrong or (kind == "mesh" and head.startswith((*FOREIGN, *_other_magic(ending))))):
            raise Problem(f"unsupported-{kind}", f"Expected the content of {ending}, found something else.")
        try:
            if kind == "mesh":
                return self._mesh(digest, name, data)
            limit = self.settings.max_map_pixels
            height, width, channels = self._child().examine_image(data, name=name, max_pixels=limit)
            return Asset(
                asset=digest,
                kind="map",
                name=name,
                bytes=len(data),
                width=width,
                height=height,
                channels=channels,
            )
        except TooLarge as error:
            unit = "faces" if kind == "mesh" else "pixels"
            raise too_large(unit, error.limit, error.actual) from None
        except LimitError as error:
            raise Problem("parse-limit", _plain(error)) from None
        except AssetError as error:
            raise Problem(f"invalid-{kind}", f"The {kind} cannot be used.", reason=_plain(error)) from None

    def _mesh(self, digest: str, name: str, data: bytes) -> Asset:
        _, notes = self._child().read_mesh(data, name=name)
        if notes.faces > self.settings.max_faces:
            raise TooLarge("too many faces", self.settings.max_faces, notes.faces)
        return Asset(
            asset=digest,
            kind="mesh",
            name=name,
            bytes=len(data),
            faces=notes.faces,
            vertices=notes.vertices,
            size_mm=notes.size_mm,
            unit_mm=notes.unit_mm,
            notes=notes.messages,
        )

    def _child(self):
        with self._starting:
            if self._sandbox is None:
                from texsss.io.sandbox import Sandbox  # brings torch: not before the socket is open

                settings = self.settings
                self._sandbox = Sandbox(
                    memory_mb=settings.parse_memory_mb, timeout_s=settings.parse_timeout_s
                )
            return self._sandbox


def too_large(unit: str, limit: int, actual: int) -> Problem:
    """413 for a file with too much of something."""
    detail = f"Expected at most {limit:,} {unit}, got {actual:,}."
    headers = {"connection": "close"} if unit == "bytes" else {}
    return Problem("asset-too-large", detail, limit=limit, actual=actual, unit=unit, headers=headers)


def _other_magic(ending: str) -> tuple[bytes, ...]:
    """How files begin that are not what a mesh's ending says."""
    own = (ending, ".hdr") if ending == ".obj" else (ending,)  # "#?" may begin a comment
    return tuple(magic for known, magic in MAGIC.items() if known not in own)


def _plain(error: Exception) -> str:
    return FOLDERS.sub("", str(error))
