"""xatlas in a child process: it may take minutes or crash, and can only be stopped from outside."""

import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from texsss.errors import DomainError
from texsss.surface._shelves import FILL
from texsss.surface._xatlas_child import NO_MEMORY, NO_ROOM, PIECE
from texsss.surface.mesh import Mesh
from texsss.surface.topology import components
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled

SECONDS_PER_FACE = 1.6e-4  # of processor time; only for progress and to spare hopeless attempts
LONG_S = 60.0  # of processor time: beyond it projections, which end sooner, are made unless asked otherwise
CHARTS_PER_PIECE = 3  # that curved surfaces fall into, at least about
POLL_S = 0.05
WAITING = 5  # times its own time that it may take on the clock
EXTENT = 1000.0  # xatlas has absolute tolerances; it gets every mesh in this size


def patience(mesh: Mesh) -> float:
    """Processor time after which xatlas is given up [s]: several times the usual, at most 600."""
    return min(6 + 6 * SECONDS_PER_FACE * mesh.faces.shape[0], 600.0)


def unwrap_seconds(faces: int) -> float:
    """Processor time that xatlas usually takes for so many faces [s]."""
    return SECONDS_PER_FACE * faces


def check_room(mesh: Mesh, size: int, padding_texels: int) -> None:
    """Raises DomainError: when `size` [texels] is too small for the charts that the mesh must fall into."""
    parts = int(_parts(mesh).max()) + 1
    charts = max(parts, CHARTS_PER_PIECE * (mesh.faces.shape[0] // PIECE))
    least = math.sqrt(parts) if parts == charts else math.sqrt(charts / FILL) * 3
    if size < least:
        enough = math.sqrt(charts / FILL) * (2 * padding_texels + 3)
        raise DomainError(
            f"Atlas: {size} × {size} texels cannot hold {mesh.name}, which has {charts:,} charts or more; "
            f"raise atlas.size (--size) to {16 * math.ceil(enough / 16):,} or above."
        )


def _parts(mesh: Mesh) -> Int[Tensor, " F"]:
    """The connected part of every face, by shared vertices."""
    edges = torch.cat([mesh.faces[:, :2], mesh.faces[:, 1:]])
    return components(mesh.vertices.shape[0], edges)[mesh.faces[:, 0]].unique(return_inverse=True)[1]


def _places(mesh: Mesh, part: Int[Tensor, " F"]) -> Float[Tensor, "F 3"]:
    """Where each face is for cutting the mesh into pieces: small parts lie in one place as a whole."""
    centre = mesh.corners.detach().mean(1).double().cpu()
    count = torch.bincount(part).double()
    mean = torch.zeros(len(count), 3, dtype=centre.dtype).index_add(0, part, centre) / count[:, None]
    return torch.where((count <= PIECE)[part][:, None], mean[part], centre)


def xatlas_uv(
    mesh: Mesh,
    size: int,
    padding_texels: int,
    *,
    timeout_s: float,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> tuple[Float[Tensor, "F 3 2"] | None, float, str]:
    """uv of an unwrap by xatlas and its padding at `size` [texels], or None and why there is none.

    Charts get less padding than asked for where there are so many that it would fill the square.
    The child is ended when `timeout_s` passes or `cancel` says so. Raises Cancelled: on request.
    """
    expected = unwrap_seconds(mesh.faces.shape[0])
    if expected > timeout_s:
        count = mesh.faces.shape[0]
        return (
            None,
            0.0,
            f"xatlas would take about {expected:.0f} s for {count:,} faces, above {timeout_s:g} s",
        )
    part = _parts(mesh).cpu()
    parts = int(part.max()) + 1
    if parts / FILL * 9 > size**2:
        return None, 0.0, f"{parts:,} separate parts leave no room between them in {size} × {size}"
    with tempfile.TemporaryDirectory(prefix="texsss-") as folder:
        source, target = Path(folder, "mesh.npz"), Path(folder, "uv.npz")
        vertices = mesh.vertices.detach().cpu().double()
        vertices = (vertices - vertices.amin(0)) * (EXTENT / float(mesh.extent.max()))
        np.savez(
            source,
            vertices=vertices.float().numpy(),
            faces=mesh.faces.cpu().numpy().astype(np.uint32),
            place=_places(mesh, part).numpy(),
            size=size,
            padding=padding_texels,
        )
        script = Path(__file__).with_name("_xatlas_child.py")
        # -P: the script's folder has modules whose names others may want
        child = subprocess.Popen(
            [sys.executable, "-P", str(script), str(source), str(target)],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            why = _wait(child, expected, timeout_s, progress, cancel)
        finally:
            child.kill()
            child.wait()
        if why:
            return None, 0.0, why
        if child.returncode == NO_ROOM:
            return None, 0.0, f"the charts find no room in {size} × {size} texels"
        if child.returncode == NO_MEMORY:
            return None, 0.0, "xatlas had too little memory"
        if not target.is_file():
            return None, 0.0, f"xatlas crashed (code {child.returncode})"
        with np.load(target) as made:
            return torch.from_numpy(made["uv"]).to(mesh.vertices), float(made["padding"]), ""


def _cpu_seconds(process: int) -> float | None:
    """Processor time of a running process [s]; None where the system does not tell."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError):
        return None


def _wait(
    child: subprocess.Popen,
    expected: float,
    timeout_s: float,
    progress: Progress | None,
    cancel: Cancel | None,
) -> str:
    start = time.monotonic()
    while child.poll() is None:
        check_cancelled(cancel)
        wall = time.monotonic() - start
        # its own time, so that a busy machine does not get another atlas than an idle one
        passed = _cpu_seconds(child.pid)
        if passed is None:
            passed = wall
        if passed > timeout_s or wall > WAITING * timeout_s:
            return f"xatlas did not end within {passed:.0f} s"
        if progress is not None:
            # xatlas reports nothing: approach 1 at the usual pace
            progress("unwrap", 1 - math.exp(-2 * passed / max(expected, 0.5)))
        time.sleep(POLL_S)
    return ""
