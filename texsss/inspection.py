"""A scene examined before it is baked: mesh, texture coordinates, scale of the scattering."""

import math
from dataclasses import asdict
from pathlib import Path

from texsss.curve import curve
from texsss.errors import ShapeError
from texsss.io.images import write_png
from texsss.pipeline import Run
from texsss.surface.doctor import examine

FEW_TEXELS = 2.0  # that the 99 % radius must span to be seen
MANY_TEXELS = 100.0  # beyond which fewer would show the same
MOST_TEXELS = 8192
LARGE_SHARE = 0.25  # of the object's height that light may cross before flat profiles mislead


def inspect(run: Run, picture: Path | None = None) -> dict:
    """What was found and what to do about it, as plain values.

    `picture`: a PNG to write that shows where in the author's texture coordinates.

    `mesh`: counts, size [mm], unit. `uv`: the doctor's report on the author's texture coordinates, or
    None without. `atlas`: what the light would be stored in. `scale`: lengths of the scattering per
    channel in mm, texels and as a share of the object's height; `radius`: within which 99 % of the light
    comes back. `kernel`: what these lengths mean for this bake. `advice`: sentences, the worst first.
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
    lengths = {
        "mean_free_path": spread["mean_free_path_mm"],
        "diffusion_length": spread["diffusion_length_mm"],
        "radius": spread["radius_mm"]["0.99"],
    }
    height = float(mesh.extent[1]) or float(mesh.extent.max())
    scale = {"texel_mm": texel, "height_mm": height, "object_mm": [round(x, 4) for x in mesh.extent.tolist()]}
    for name, length in lengths.items():
        for unit, one in (("mm", 1.0), ("texels", texel), ("share", height)):
            scale[f"{name}_{unit}"] = [None if mm is None else mm / one for mm in length]
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
        "kernel": kernel(max(lengths["radius"]), texel, height, mesh.name, size),
        "advice": run.advice,
    }


def kernel(radius_mm: float, texel_mm: float, height_mm: float, name: str, size: int) -> list[str]:
    """What the widest channel's 99 % radius [mm] means beside a texel and the object, and what to do.

    `texel_mm`, `height_mm`: of the atlas of `size` texels and of the object called `name`.
    """
    texels, share = radius_mm / texel_mm, radius_mm / height_mm
    part = f"{share:.2g} times" if share >= 1 else f"{100 * share:.2g} % of"
    in_texels = f"kernel = {texels:.2g} texels (99 % of the light comes back within {radius_mm:.3g} mm)"
    in_object = f"kernel = {part} {name}, which is {height_mm:.3g} mm tall"
    if texels < FEW_TEXELS:
        wanted = 2 ** math.ceil(math.log2(size * FEW_TEXELS / texels))
        remedy = f"raise --size to {wanted}" if wanted <= MOST_TEXELS else "no --size will show it"
        in_texels += f": too narrow to be seen; {remedy}, or check --unit-mm."
    elif texels > MANY_TEXELS and share <= LARGE_SHARE:
        enough = max(2 ** math.ceil(math.log2(size * MANY_TEXELS / texels)), 16)
        in_texels += f": finer than the light; --size {enough} would do."
    else:
        in_texels += ": wide enough to be seen, nothing to do."
    if share > LARGE_SHARE:
        in_object += (
            ": light crosses it and its shape washes out; check --unit-mm, or take a denser --material."
        )
    else:
        in_object += ": nothing to do if that is its real height, else state --unit-mm."
    return [in_texels, in_object]
