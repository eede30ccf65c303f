"""Files from strangers, read in a child process of limited memory and time."""

import io
import json
import socket
import struct
import subprocess
import sys
import threading
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import torch

from texsss.errors import AssetError, LimitError, TooLarge
from texsss.io.meshes import MeshNotes, Up, VDirection, bytes_of
from texsss.surface.mesh import Mesh
from texsss.types import Float, Int

START_S = 60.0  # for the server to import everything, once
GRACE_S = 5.0  # for the answer to arrive after the child's own limit


class Sandbox:
    """A fork server for reading files; use it as a context, or close it.

    The server starts with the first file (seconds, once); every file then costs milliseconds and its own
    limited child. One file at a time; threads wait for each other. Needs Linux: elsewhere use
    `texsss.io.meshes.read_mesh`, which checks the same things without a limit on memory.
    """

    def __init__(self, *, memory_mb: float | int = 1500, timeout_s: float | int = 20):
        self.memory_mb, self.timeout_s = float(memory_mb), float(timeout_s)
        self._lock = threading.Lock()
        self._server: subprocess.Popen | None = None
        self._link: Connection | None = None

    def __enter__(self) -> "Sandbox":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Ends the server; the next file would start it again."""
        if self._link is not None:
            self._link.close()
        if self._server is not None:
            self._server.kill()
            self._server.wait()
        self._server = self._link = None

    def read_mesh(
        self,
        source: Path | str | bytes,
        *,
        unit_mm: float | int | None = None,
        up: Up = "y",
        v: VDirection = "auto",
        file_type: str | None = None,
        name: str | None = None,
    ) -> tuple[Mesh, MeshNotes]:
        """A mesh file and what was assumed, as `texsss.io.meshes.read_mesh` gives them.

        Raises AssetError: as there, and when the file needs more time or memory than allowed.
        """
        data, name = bytes_of(source, name)
        options = {
            "unit_mm": unit_mm,
            "up": up,
            "v": v,
            "file_type": file_type,
            "name": name,
        }
        return _unpacked(self._answer("mesh", options, data))

    def read_positions(
        self,
        source: Path | str | bytes,
        *,
        unit_mm: float | int,
        up: Up = "y",
        file_type: str | None = None,
        name: str | None = None,
    ) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
        """Vertices and triangles of a mesh file as `texsss.io.meshes.read_positions` gives them.

        Raises AssetError: as there, and when the file needs more time or memory than allowed.
        """
        data, name = bytes_of(source, name)
        options = {"unit_mm": unit_mm, "up": up, "file_type": file_type, "name": name}
        answer = self._answer("positions", options, data)
        with np.load(io.BytesIO(answer), allow_pickle=False) as arrays:
            return arrays["positions"], arrays["faces"]

    def examine_image(self, data: bytes, *, name: str, max_pixels: int) -> tuple[int, int, int]:
        """Height, width and channels of an image, which was read whole by `texsss.io.images.read_image`.

        Raises AssetError: as there, and when the file needs more time or memory than allowed.
        """
        answer = self._answer("image", {"name": name, "max_pixels": max_pixels}, data)
        height, width, channels = json.loads(answer)
        return height, width, channels

    def _answer(self, task: str, options: dict, data: bytes) -> bytes:
        """What the child hands back. Raises TooLarge, LimitError, AssetError: what it tells."""
        limits = {"memory_mb": self.memory_mb, "timeout_s": self.timeout_s}
        with self._lock:
            status, answer = self._ask({"task": task, "options": options, **limits}, data)
        if status == "ok":
            return answer
        if status == "error":
            told = json.loads(answer)
            if told["limit"] is not None:
                raise TooLarge(told["sentence"], told["limit"], told["actual"])
            raise AssetError(told["sentence"])
        sentence = answer.decode(errors="replace")
        raise LimitError(f"{options['name']}: {sentence}; give a smaller or a sound file.")

    def _ask(self, asked: dict, data: bytes) -> tuple[str, bytes]:
        if self._server is not None and self._server.poll() is not None:
            self.close()  # it ended while nothing was asked of it
        first = self._link is None
        link = self._link or self._start()
        try:
            link.send_bytes(json.dumps(asked).encode())
            link.send_bytes(data)
            if not link.poll(self.timeout_s + GRACE_S + (START_S if first else 0.0)):
                raise EOFError
            return link.recv_bytes().decode(), link.recv_bytes()
        except (EOFError, OSError):
            self.close()
            return "fault", b"the process that reads it ended"
        except BaseException:
            self.close()  # an answer may be under way: it must not meet the next question
            raise

    def _start(self) -> Connection:
        ours, theirs = socket.socketpair()
        # sending waits for the reader: no longer than for its answer
        limit = struct.pack("@ll", int(self.timeout_s + GRACE_S + START_S), 0)
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        with theirs:
            self._server = subprocess.Popen(
                [sys.executable, "-m", "texsss.io._sandbox_server", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl+C is for us: we end it
            )
        self._link = Connection(ours.detach())
        return self._link


def _unpacked(answer: bytes) -> tuple[Mesh, MeshNotes]:
    """Arrays only: nothing that a child of doubtful input sends is ever unpickled."""
    with np.load(io.BytesIO(answer), allow_pickle=False) as arrays:
        notes = json.loads(arrays["notes"].tobytes())
        name = notes.pop("name")
        uv = torch.from_numpy(arrays["source_uv"]) if "source_uv" in arrays else None
        vertices, faces, origin = (
            torch.from_numpy(arrays[part]) for part in ("vertices", "faces", "source_vertex")
        )
        mesh = Mesh(vertices, faces, uv, name, origin)
    notes |= {field: tuple(notes[field]) for field in ("size_mm", "messages", "shift_mm")}
    return mesh, MeshNotes(**notes)
