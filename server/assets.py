"""Uploads, named by their content. Only files that a limited child has read whole are kept."""

import asyncio
import hashlib
import os
import re
import tempfile
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ValidationError
from texsss_server.problems import FOLDERS, Problem, retry_after
from texsss_server.settings import MB, Settings

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

NAME = re.compile(r"[^\w. +-]")
SHA256 = re.compile(r"[0-9a-f]{64}")


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


class Store:
    """A folder of uploads named by their sha256, the descriptions beside them.

    Bounded by bytes: the files used least recently go. Safe for one process with threads; files appear
    whole or not at all.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self._own = None if settings.assets_dir else tempfile.TemporaryDirectory(prefix="texsss-assets-")
        self.folder = Path(self._own.name if self._own else settings.assets_dir or ".").resolve()
        self.folder.mkdir(parents=True, exist_ok=True)
        for leftover in self.folder.glob("upload-*"):
            leftover.unlink(missing_ok=True)
        self._readers = asyncio.Semaphore(settings.parse_queue)
        self._sandbox = None

    def close(self) -> None:
        """Ends the reading child and removes a temporary folder."""
        if self._sandbox is not None:
            self._sandbox.close()
        if self._own is not None:
            self._own.cleanup()

    def warm(self) -> None:
        """Starts the reading child, which imports for seconds."""
        triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
        self._child().read_mesh(triangle, name="triangle.obj")

    @property
    def bytes_used(self) -> int:
        """Bytes of all uploads kept."""
        return sum(self._size(path) for path in self._files())

    def get(self, asset: str) -> Asset | None:
        """The description of an upload, None if it isn't there."""
        if not SHA256.fullmatch(asset):
            return None
        try:
            found = Asset.model_validate_json((self.folder / f"{asset}.json").read_bytes())
        except (FileNotFoundError, ValidationError):  # or cut short by a full disk
            return None
        return found if (self.folder / asset).is_file() else None

    def path(self, asset: str) -> Path:
        """The file of an upload. Raises AssetError: when it isn't there."""
        path = self.folder / asset
        if not SHA256.fullmatch(asset) or not path.is_file():
            raise AssetError("Source: no such asset is here (any more); upload it again.")
        now = time.time_ns()
        modified = path.stat().st_mtime_ns  # stays: stages are kept under it
        os.utime(path, ns=(now, modified))
        return path

    def remove(self, asset: str) -> bool:
        """Removes an upload; whether it was there."""
        known = self.get(asset) is not None
        if SHA256.fullmatch(asset):
            for path in (self.folder / f"{asset}.json", self.folder / asset):
                path.unlink(missing_ok=True)
        return known

    async def add(self, name: str, chunks: AsyncIterator[bytes]) -> tuple[Asset, bool]:
        """The upload that arrives as `chunks`, and whether it is new.

        Raises Problem: when its name or content is not allowed, it is too large, or cannot be read.
        """
        ending = Path(name).suffix.lower()
        if ending not in (*MESHES, *MAPS):
            raise Problem(
                "unsupported-mesh",
                f"Expected a name that ends in one of {', '.join((*MESHES, *MAPS))}.",
                available=[*MESHES, *MAPS],
            )
        try:
            handle, temporary = tempfile.mkstemp(prefix="upload-", dir=self.folder)
        except OSError as error:
            raise _no_room(error) from None
        try:
            with os.fdopen(handle, "wb") as out:
                digest = await self._write(out, chunks)
            known = self.get(digest)
            if known is not None and known.kind == ("mesh" if ending in MESHES else "map"):
                return known, False
            asset = await self._examined(digest, NAME.sub("_", Path(name).name)[-100:], Path(temporary))
            self._make_room(asset.bytes)
            self._describe(asset)  # a description without its file is no asset yet
            os.replace(temporary, self.folder / digest)
            return asset, True
        except OSError as error:
            raise _no_room(error) from None
        finally:
            Path(temporary).unlink(missing_ok=True)

    async def _write(self, out, chunks: AsyncIterator[bytes]) -> str:
        digest, size, limit = hashlib.sha256(), 0, int(self.settings.upload_mb * MB)
        async for chunk in chunks:
            size += len(chunk)
            if size > limit:
                raise too_large("bytes", limit, size)
            digest.update(chunk)
            out.write(chunk)
        return digest.hexdigest()

    async def _examined(self, digest: str, name: str, path: Path) -> Asset:
        """What the limited child found. Raises Problem: when it found fault."""
        try:
            async with asyncio.timeout(self.settings.queue_wait_s):
                await self._readers.acquire()
        except TimeoutError:
            raise retry_after("queue-full", "Too many uploads are being read; try again.") from None
        try:
            return await asyncio.to_thread(self._examine, digest, name, path)
        finally:
            self._readers.release()

    def _examine(self, digest: str, name: str, path: Path) -> Asset:
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
        if self._sandbox is None:
            from texsss.io.sandbox import Sandbox  # brings torch: not before the socket is open

            limits = {"memory_mb": self.settings.parse_memory_mb, "timeout_s": self.settings.parse_timeout_s}
            self._sandbox = Sandbox(**limits)
        return self._sandbox

    def _describe(self, asset: Asset) -> None:
        described = self.folder / f"upload-{asset.asset}.json"
        try:
            described.write_text(asset.model_dump_json(), encoding="utf-8")
            os.replace(described, self.folder / f"{asset.asset}.json")
        finally:
            described.unlink(missing_ok=True)

    def _files(self) -> list[Path]:
        return [path for path in self.folder.iterdir() if SHA256.fullmatch(path.name)]

    def _make_room(self, size: int) -> None:
        """Removes what was used least recently until `size` bytes fit."""
        files = sorted(self._files(), key=lambda path: path.stat().st_atime_ns)
        used = sum(self._size(path) for path in files)
        while files and used + size > self.settings.assets_mb * MB:
            oldest = files.pop(0)
            used -= self._size(oldest)
            self.remove(oldest.name)

    @staticmethod
    def _size(path: Path) -> int:
        try:
            return path.stat().st_size
        except FileNotFoundError:
            return 0


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


def _no_room(error: OSError) -> Problem:
    return Problem("storage-full", f"The file could not be kept ({error.strerror or 'no room'}); try later.")
