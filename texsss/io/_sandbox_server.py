"""The other end of `Sandbox`: a process that has everything imported and forks one limited child per file.

It has one thread and touches no file's content itself, so that forking is cheap and safe.
"""

import ctypes
import io
import json
import os
import resource
import select
import signal
import sys
import time
from multiprocessing.connection import Connection

import numpy as np
import torch

from texsss.errors import AssetError
from texsss.io.images import read_image
from texsss.io.meshes import read_mesh, read_positions

PR_SET_PDEATHSIG = 1  # of Linux' prctl


def main(descriptor: int) -> None:
    """Answers requests (as JSON, then the file's bytes) until the other end closes."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a stop of all is for the other end, which ends us
    link = Connection(descriptor)
    while True:
        try:
            asked = json.loads(link.recv_bytes())
            data = link.recv_bytes()
        except (EOFError, OSError):
            return
        status, answer = _in_child(link, asked, data)
        link.send_bytes(status.encode())
        link.send_bytes(answer)


def _in_child(link: Connection, asked: dict, data: bytes) -> tuple[str, bytes]:
    """What a child of limited time and memory answers: "ok" and arrays, or "fault" and a sentence."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        link.close()  # else the other end would not notice that this process's parent is gone
        _serve(asked, data, writer)  # does not return
    os.close(writer)
    deadline = time.monotonic() + asked["timeout_s"]
    parts, late = [], False
    while not late:
        ready = select.select([reader], [], [], max(0.0, deadline - time.monotonic()))[0]
        part = os.read(reader, 1 << 20) if ready else b""
        if ready and not part:
            break
        late = not ready
        parts.append(part)
    os.close(reader)
    if late:
        os.kill(child, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if late or code == -signal.SIGXCPU:
        return "fault", f"reading it takes longer than {asked['timeout_s']:g} s".encode()
    if code != 0:
        return (
            "fault",
            f"reading it needs more than {asked['memory_mb']:g} MB or fails (code {code})".encode(),
        )
    whole = b"".join(parts)
    return whole[:5].decode().strip(), whole[5:]


def _serve(asked: dict, data: bytes, writer: int) -> None:
    code = 1
    try:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # nobody would wait for it any more
        _limit(asked["memory_mb"], asked["timeout_s"])
        torch.set_num_threads(1)
        with os.fdopen(writer, "wb") as out:
            out.write(_answer(asked, data))
        code = 0
    except MemoryError:
        code = 2
    finally:
        # no clean-up of what belongs to the parent
        os._exit(code)


def _limit(memory_mb: float, timeout_s: float) -> None:
    """Caps the address space at what is there plus `memory_mb`, processor time, and forbids writing files."""
    with open("/proc/self/statm") as statm:
        present = int(statm.read().split()[0]) * resource.getpagesize()
    space, seconds = present + int(memory_mb * 2**20), int(timeout_s) + 1
    resource.setrlimit(resource.RLIMIT_AS, (space, space))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _answer(asked: dict, data: bytes) -> bytes:
    try:
        return b"ok   " + TASKS[asked["task"]](data, **asked["options"])
    except AssetError as error:
        told = {"sentence": str(error)}
        told |= {field: getattr(error, field, None) for field in ("limit", "actual")}
        return b"error" + json.dumps(told).encode()


def _image(data: bytes, **options) -> bytes:
    image = read_image(data, **options)
    return json.dumps(list(image.shape)).encode()


def _mesh(data: bytes, **options) -> bytes:
    mesh, notes = read_mesh(data, **options)
    assert mesh.source_vertex is not None
    arrays = {
        "vertices": mesh.vertices.numpy(),
        "faces": mesh.faces.numpy(),
        "source_vertex": mesh.source_vertex.numpy(),
    }
    if mesh.source_uv is not None:
        arrays["source_uv"] = mesh.source_uv.numpy()
    notes_text = json.dumps({**vars(notes), "name": mesh.name})
    return _packed(arrays | {"notes": np.frombuffer(notes_text.encode(), dtype=np.uint8)})


def _positions(data: bytes, **options) -> bytes:
    positions, faces = read_positions(data, **options)
    return _packed({"positions": positions, "faces": faces})


def _packed(arrays: dict[str, np.ndarray]) -> bytes:
    out = io.BytesIO()
    np.savez(out, allow_pickle=False, **arrays)
    return out.getvalue()


TASKS = {"mesh": _mesh, "positions": _positions, "image": _image}


if __name__ == "__main__":
    main(int(sys.argv[1]))
