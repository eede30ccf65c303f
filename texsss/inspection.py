"""A scene examined before it is baked: mesh, texture coordinates, scale of the scattering."""

from dataclasses import asdict
from pathlib import Path

from texsss.curve import curve
from texsss.errors import ShapeError
from texsss.io.images import write_png
from texsss.pipeline import Run
from texsss.surface.doctor import examine


def inspect(run: Run, picture: Path | None = None) -> dict:
    """What was found and what to do about it, as plain values.

    `picture`: a PNG to write that shows where in the author's texture coordinates.

    `mesh`: counts, size [mm], unit. `uv`: the doctor's report on the author's texture coordinates, or
    None without. `atlas`: what the light would be stored in. `scale`: lengths of the scattering in mm;
    `radius`, within which 99 % of the light comes back, in texels and as a share of the object, too.
    `advice`: sentences, the worst first.
    """
    mesh, notes = run.mesh.value
    size = run.scene.atlas.texels
    report = None
    if mesh.source_uv is not None:
        report, image = examine(mesh, mesh.source_uv, (size, size))
        if picture is not None:
            write_png(picture, image)
    elif picture is not None:
        raise ShapeError(f"inspect: {mesh.name} has no texture coordinates to show; leave --picture out.")
    atlas, texels, spread = run.atlas.value, run.texels.value, curve(run)
    texel = texels.texel_mm
    radius = spread["radius_mm"]["0.99"]
    scale = {
        "texel_mm": texel,
        "object_mm": [round(edge, 4) for edge in mesh.extent.tolist()],
        "radius_mm": radius,
        "radius_texels": [r / texel for r in radius],
        "radius_share": [r / max(mesh.extent.tolist()) for r in radius],
        "diffusion_length_mm": spread["diffusion_length_mm"],
        "mean_free_path_mm": spread["mean_free_path_mm"],
    }
    return {
        "mesh": {
            "name": mesh.name,
            "faces": notes.faces,
            "vertices": notes.vertices,
            "size_mm": list(notes.size_mm),
            "unit_mm": notes.unit_mm,
            "unit_assumed": notes.unit_assumed,
        },
        "uv": None if report is None else asdict(report) | {"serves": report.atlas.serves},
        "atlas": {"origin": atlas.origin, "charts": atlas.report.charts, "texels": texels.covered_count},
        "scale": scale,
        "advice": run.advice,
    }
