"""The same mesh from different files gives the same picture."""

from pathlib import Path

import torch

import texsss as tx
from texsss.io.gltf import glb
from texsss.io.meshes import read_mesh
from texsss.types import Float, Tensor


def psnr(image: Float[Tensor, "H W 3"], other: Float[Tensor, "H W 3"]) -> float:
    """Peak signal to noise [dB], against the brightest value."""
    error = float((image - other).square().mean())
    return float(10 * torch.log10(image.max() ** 2 / max(error, 1e-30)))


def baked(path: Path, unit_mm: float) -> tx.Baked:
    """A head at 256², small enough for a test."""
    scene = {
        "mesh": {"source": str(path), "unit_mm": unit_mm},
        "atlas": {"size": 256},
        "methods": {"diffusion": "uv"},
        "camera": {"resolution": [160, 120]},
    }
    return tx.bake(tx.Scene.parse(scene))


def test_obj_and_glb_of_one_head_give_one_picture(shared_data, tmp_path):
    """At least 40 dB: for our own GLB of it (148, 158 dB), and another's, a unit of which is 53 mm."""
    source = shared_data / "head" / "LeePerrySmith.obj"
    mesh, _ = read_mesh(source, unit_mm=1000)
    assert mesh.source_uv is not None
    (tmp_path / "head.glb").write_bytes(glb(mesh, mesh.source_uv))
    first = baked(source, 1000)
    for path, unit_mm in ((tmp_path / "head.glb", 1000), (source.with_suffix(".glb"), 1000 / 18.868)):
        other = baked(path, unit_mm)
        assert psnr(first.radiance, other.radiance) > 40
        assert psnr(first.picture, other.picture) > 40
