"""Uploads, named by their content. Only files that a limited child has read whole are kept."""

import asyncio
import contextlib
import hashlib
import os
import re
import tempfile
import time
from collections.abc import AsyncIterator
from pathlib import Path

from pydantic import ValidationError
from texsss_server.examine import MAPS, MESHES, Asset, Examiner, too_large
from texsss_server.problems import Problem, no_room, retry_after
from texsss_server.settings import MB, Settings

from texsss.errors import AssetError

NAME = re.compile(r"[^\w. +-]")
ARRIVING = ".texsss-upload-"  # files of ours that may be swept
SHA256 = re.compile(r"[0-9a-f]{64}")


class Store:
    """A folder of uploads named by their sha256 and ending, the descriptions beside them.

    Bounded by bytes and number: the files used least recently go. Safe for one process with threads; files
    appear whole or not at all.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self._own = None if settings.assets_dir else tempfile.TemporaryDirectory(prefix="texsss-assets-")
        self.folder = Path(self._own.name if self._own else settings.assets_dir or ".").resolve()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for leftover in self.folder.glob(f"{ARRIVING}*"):
                leftover.unlink(missing_ok=True)
            tempfile.TemporaryFile(dir=self.folder).close()
        except OSError as error:
            raise AssetError(
                f"Settings: assets_dir: nothing can be written to {self.folder} ({error.strerror}); choose "
                "another folder in TEXSSS_ASSETS_DIR."
            ) from None
        self._arriving = asyncio.Semaphore(settings.uploads)
        self._readers = asyncio.Semaphore(settings.parse_queue)
        self._examiner = Examiner(settings)

    def close(self) -> None:
        """Ends the reading child and removes a temporary folder."""
        self._examiner.close()
        if self._own is not None:
            self._own.cleanup()

    def warm(self) -> None:
        """Starts the reading child, which imports for seconds."""
        self._examiner.warm()

    @property
    def bytes_used(self) -> int:
        """Bytes of all uploads kept."""
        return sum(size for _, size, _ in self._files())

    def get(self, asset: str) -> Asset | None:
        """The description of an upload, None if it isn't there."""
        if not SHA256.fullmatch(asset):
            return None
        try:
            found = Asset.model_validate_json((self.folder / f"{asset}.json").read_bytes())
        except (FileNotFoundError, ValidationError):  # or cut short by a full disk
            return None
        return found if self._file(found).is_file() else None

    def path(self, asset: str) -> Path:
        """The file of an upload. Raises AssetError: when it isn't there."""
        found = self.get(asset)
        if found is None:
            raise AssetError("Source: no such asset is here (any more); upload it again.")
        path = self._file(found)
        os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))
        return path

    def remove(self, asset: str) -> bool:
        """Removes an upload; whether it was there."""
        known = self.get(asset) is not None
        if SHA256.fullmatch(asset):
            for path in self.folder.glob(f"{asset}.*"):
                path.unlink(missing_ok=True)
        return known

    async def add(self, name: str, chunks: AsyncIterator[bytes]) -> tuple[Asset, bool]:
        """The upload that arrives as `chunks`, and whether it is new.

        Raises Problem: when its name or content is not allowed, it is too large, or cannot be read, or too
        many arrive already.
        """
        ending = Path(name).suffix.lower()
        if ending not in (*MESHES, *MAPS):
            raise Problem(
                "unsupported-mesh",
                f"Expected a name that ends in one of {', '.join((*MESHES, *MAPS))}.",
                available=[*MESHES, *MAPS],
            )
        await self._place(self._arriving, "Too many uploads are arriving")
        try:
            return await self._kept(name, chunks)
        except OSError as error:
            raise no_room(error) from None
        finally:
            self._arriving.release()

    async def _kept(self, name: str, chunks: AsyncIterator[bytes]) -> tuple[Asset, bool]:
        self.folder.mkdir(parents=True, exist_ok=True)  # somebody may have taken it away
        handle, temporary = tempfile.mkstemp(prefix=ARRIVING, dir=self.folder)
        try:
            with os.fdopen(handle, "wb") as out:
                digest = await self._write(out, chunks)
            known = self.get(digest)
            if known is not None and (known.kind == "mesh") == (Path(name).suffix.lower() in MESHES):
                self.path(digest)  # used just now
                return known, False
            asset = await self._examined(digest, NAME.sub("_", Path(name).name)[-100:], Path(temporary))
            if (twin := self.get(digest)) is not None and twin.kind == asset.kind:
                return twin, False  # it arrived twice at once
            self._make_room(asset.bytes)
            self._describe(asset)  # a description without its file is no asset yet
            os.replace(temporary, self._file(asset))
            if twin is not None and self._file(twin) != self._file(asset):
                self._file(twin).unlink(missing_ok=True)
            return asset, True
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
        await self._place(self._readers, "Too many uploads are being read")
        try:
            return await asyncio.to_thread(self._examiner.examine, digest, name, path)
        finally:
            self._readers.release()

    async def _place(self, places: asyncio.Semaphore, full: str) -> None:
        """Takes a place. Raises Problem: when none is free for a while."""
        try:
            async with asyncio.timeout(self.settings.queue_wait_s):
                await places.acquire()
        except TimeoutError:
            raise retry_after("queue-full", f"{full}; try again.") from None

    def _file(self, asset: Asset) -> Path:
        """Its ending stays: it helps to tell what is inside."""
        return self.folder / f"{asset.asset}{Path(asset.name).suffix.lower()}"

    def _describe(self, asset: Asset) -> None:
        described = self.folder / f"{ARRIVING}{asset.asset}.json"
        try:
            described.write_text(asset.model_dump_json(), encoding="utf-8")
            os.replace(described, self.folder / f"{asset.asset}.json")
        finally:
            described.unlink(missing_ok=True)

    def _files(self) -> list[tuple[int, int, str]]:
        """When each was used last [ns], its bytes and its sha256."""
        found = []
        with contextlib.suppress(FileNotFoundError), os.scandir(self.folder) as entries:
            for entry in entries:
                asset, _, ending = entry.name.partition(".")
                if SHA256.fullmatch(asset) and ending != "json":
                    with contextlib.suppress(FileNotFoundError):
                        status = entry.stat()
                        found.append((status.st_atime_ns, status.st_size, asset))
        return found

    def _make_room(self, size: int) -> None:
        """Removes what was used least recently until one more of `size` bytes fits."""
        files = sorted(self._files())
        used = sum(held for _, held, _ in files)
        while files and (
            used + size > self.settings.assets_mb * MB or len(files) >= self.settings.assets_count
        ):
            _, held, oldest = files.pop(0)
            used -= held
            self.remove(oldest)
