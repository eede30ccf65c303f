"""A scene examined before it is baked: mesh, texture coordinates, scale of the scattering."""

from dataclasses import asdict
from pathlib import Path

from texsss.curve import curve
from texsss.errors import ShapeError
from texsss.io.images import write_png
from texsss.pipeline import Run
from texsss.surface.doctor import examine

FINE_TEXELS = 0.7  # a scattering radius below so many texels is not resolved
WIDE_SHARE = 0.5  # of the object: light that spreads farther sees a blob, not a surface


def inspect(run: Run, picture: Path | None = None) -> dict:
    """What was found and what to do about it, as plain values.

    `picture`: a PNG to write that shows where in the author's texture coordinates.

    `mesh`: counts, size [mm], unit. `uv`: the doctor's report on the author's texture coordinates, or
    None without. `atlas`: what the light would be stored in. `scale`: scattering lengths in mm and texels.
    `advice`: sentences, the worst first.
    """
    mesh, notes = run.mesh.value
    size = run.scene.atlas.size
    report = None
    if mesh.source_uv is not None:
        report, image = examine(mesh, mesh.source_uv, (size, size))
        if picture is not None:
            write_png(picture, image)
    elif picture is not None:
        raise ShapeError(f"inspect: {mesh.name} has no texture coordinates to show; leave --picture out.")
    atlas, texels, spread = run.atlas.value, run.texels.value, curve(run)
    texel = texels.texel_mm
    radius = spread["radius_mm"]["0.9"]
    scale = {
        "texel_mm": texel,
        "object_mm": [round(edge, 4) for edge in mesh.extent.tolist()],
        "radius_mm": radius,
        "radius_texels": [r / texel if texel else None for r in radius],
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
        "advice": [
            *_scale_advice(max(radius), texel, mesh.diagonal_mm),
            *notes.messages,
            *atlas.report.messages,
        ],
    }


def _scale_advice(radius_mm: float, texel_mm: float, object_mm: float) -> list[str]:
    """What to say when scattering and object do not fit each other."""
    if radius_mm < FINE_TEXELS * texel_mm:
        return [
            f"light spreads {radius_mm:.3g} mm, {radius_mm / texel_mm:.2g} texels: it will not show; "
            "raise atlas.size, or check mesh.unit_mm"
        ]
    if radius_mm > WIDE_SHARE * object_mm:
        return [
            f"light spreads {radius_mm:.3g} mm over an object of {object_mm:.3g} mm: it will look "
            "like wax; check mesh.unit_mm and the material"
        ]
    return []
