"""What report.json says: what was baked, from what, at what cost."""

import resource
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version

import torch

from texsss.profiles.weights import Weights
from texsss.scene import Scene
from texsss.surface.atlas import Atlas
from texsss.surface.points import TexelMaps
from texsss.types import Float, Tensor


def describe(
    scene: Scene,
    seconds: Mapping[str, float],
    notes: Sequence[str],
    atlas: Atlas,
    texels: TexelMaps,
    weights: Weights,
    irradiance: Float[Tensor, "P 3"],
    exitance: Float[Tensor, "P 3"],
    marching: Mapping[str, str | int],
    pose: Mapping[str, str | float] | None = None,
) -> dict:
    """The report of a bake as plain values.

    `seconds` per stage that ran (kept results take none). `notes`: sentences for the user. Energy is
    what entered and what left the whole surface [W]. `marching`: what pictures march, by how many steps.
    `pose`: whose operators carry light over the surface, and by how much the pose stretches that.
    """
    mesh, area = texels.mesh, texels.area[:, None] / 1e6  # m²
    return {
        "texsss": version("texsss"),
        "seconds": {name: round(value, 4) for name, value in seconds.items()},
        "peak_memory_mb": round(peak_memory_bytes() / 2**20),
        "peak_memory_of_children_mb": round(peak_memory_bytes(resource.RUSAGE_CHILDREN) / 2**20),
        "threads": torch.get_num_threads(),
        "mesh": {
            "name": mesh.name,
            "faces": mesh.faces.shape[0],
            "vertices": mesh.vertices.shape[0],
            "extent_mm": [round(edge, 3) for edge in mesh.extent.tolist()],
        },
        "pose": None if pose is None else dict(pose),
        "atlas": {"origin": atlas.origin, "charts": atlas.report.charts},
        "texels": {
            "size": list(texels.size),
            "covered": texels.covered_count,
            "gutter": len(texels) - texels.covered_count,
            "texel_mm": texels.texel_mm,
        },
        "variances_mm2": weights.variances.tolist(),
        "variances_texels2": (weights.variances / texels.texel_mm**2).tolist(),
        "weights": {"rows": len(weights.table), "total": weights.table.sum(1).mean(0).tolist()},
        "energy": {
            "entered_w": (area * irradiance).sum(0).tolist(),
            "left_w": (area * exitance).sum(0).tolist(),
        },
        "march": dict(marching),
        "notes": list(notes),
        "scene": scene.model_dump(mode="json"),
    }


def peak_memory_bytes(who: int = resource.RUSAGE_SELF) -> int:
    """The most memory that this process has held, or the largest of its children that have ended."""
    peak = resource.getrusage(who).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
