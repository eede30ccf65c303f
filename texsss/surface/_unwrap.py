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

from texsss.surface.mesh import Mesh
from texsss.surface.topology import components
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled

SECONDS_PER_FACE = 1.6e-4  # on two cores; only for progress and to spare hopeless attempts
POLL_S = 0.05
WAITING = 5  # times its own time that it may take on the clock
EXTENT = 1000.0  # xatlas has absolute tolerances; it gets every mesh in this size


def patience(mesh: Mesh) -> float:
    """Processor time after which xatlas is given up [s]: thrice the usual on two cores, at most 600."""
    return min(6 + 6 * SECONDS_PER_FACE * mesh.faces.shape[0], 600.0)


def xatlas_uv(
    mesh: Mesh,
    size: int,
    padding_texels: int,
    *,
    timeout_s: float,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> tuple[Float[Tensor, "F 3 2"] | None, str]:
    """uv of an unwrap by xatlas, or None and why there is none.

    The child is ended when `timeout_s` passes or `cancel` says so. Raises Cancelled: on request.
    """
    expected = SECONDS_PER_FACE * mesh.faces.shape[0]
    if expected > timeout_s:
        count = mesh.faces.shape[0]
        return None, f"xatlas would take about {expected:.0f} s for {count:,} faces, above {timeout_s:g} s"
    edges = torch.cat([mesh.faces[:, :2], mesh.faces[:, 1:]])
    joined = components(mesh.vertices.shape[0], edges)[mesh.faces[:, 0]]
    parts = len(joined.unique())
    if parts * (padding_texels + 1) ** 2 > size**2:
        return None, f"{parts:,} separate parts cannot stand {padding_texels} texels apart in {size} × {size}"
    with tempfile.TemporaryDirectory(prefix="texsss-") as folder:
        source, target = Path(folder, "mesh.npz"), Path(folder, "uv.npy")
        vertices = mesh.vertices.detach().cpu().double()
        vertices = (vertices - vertices.amin(0)) * (EXTENT / float(mesh.extent.max()))
        np.savez(
            source,
            vertices=vertices.float().numpy(),
            faces=mesh.faces.cpu().numpy().astype(np.uint32),
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
            return None, why
        if not target.is_file():
            return None, f"xatlas ended with code {child.returncode}"
        return torch.from_numpy(np.load(target)).to(mesh.vertices), ""


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
