"""What a viewer needs to show a baked scene by itself: the surface, and where lights and camera stand."""

from typing import Any

import torch

from texsss import placing
from texsss.cache import content_key
from texsss.io.gltf import glb
from texsss.lamps import StudioSpec
from texsss.light.emitters import PointLight
from texsss.media.fresnel import F_dt
from texsss.pipeline import Run


def model(run: Run) -> bytes:
    """The mesh with its atlas and the author's texture coordinates as a GLB without textures."""
    mesh, _ = run.mesh.value
    return glb(mesh, run.atlas.value.uv)


def showing(run: Run) -> dict[str, Any]:
    """Where things stand [mm], and the indices that light leaves through, as plain values.

    `geometry` names the content of `model`, so that it is fetched only when it changed. A studio's
    lights come as the points they are. `transmittance`: of light that arrives from outside, F_dt.
    """
    (mesh, notes), atlas, texels, stack = run.mesh.value, run.atlas, run.texels.value, run.stack.value
    camera = run.camera.value
    low, high = mesh.vertices.detach().amin(0), mesh.vertices.detach().amax(0)
    return {
        "geometry": atlas.key if run.pose is None else content_key(atlas, run.mesh),
        "mesh": {
            "name": mesh.name,
            "faces": notes.faces,
            "unit_mm": notes.unit_mm,
            "unit_assumed": notes.unit_assumed,
            "box_mm": [low.tolist(), high.tolist()],
        },
        "atlas": {
            "origin": atlas.value.origin,
            "charts": atlas.value.report.charts,
            "texels": texels.covered_count,
            "texel_mm": texels.texel_mm,
        },
        "camera": {
            "position_mm": _triple(camera.position),
            "target_mm": _triple(camera.target),
            "fov_y_deg": run.scene.camera.fov_y_deg,
        },
        "lights": _lights(run),
        "background": placing.background(run.scene),
        "eta": stack.eta,
        "transmittance": float(F_dt(stack.eta)),
        "variances_mm2": run.variances.tolist(),
        "normalised": run.normalised,
    }


def _lights(run: Run) -> list[dict[str, Any]]:
    mesh, _ = run.rest.value
    found = []
    for spec in run.scene.lights:
        if isinstance(spec, StudioSpec):
            lamps = placing.studio(mesh, spec.intensity)
            found += [_point(lamp) for lamp in lamps if isinstance(lamp, PointLight)]
        else:
            found.append(spec.model_dump(mode="json"))
    return found


def _point(lamp: PointLight) -> dict[str, Any]:
    return {
        "type": "point",
        "position_mm": _triple(lamp.position),
        "intensity_w_per_sr": _triple(lamp.intensity),
    }


def _triple(values: Any) -> list[float]:
    return torch.as_tensor(values).detach().tolist()
