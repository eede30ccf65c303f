"""A scene examined before it is baked: mesh, texture coordinates, scale of the scattering."""

import math
from dataclasses import asdict
from pathlib import Path

from texsss.curve import curve
from texsss.io.images import write_png
from texsss.io.sheet import with_legend
from texsss.pipeline import Run
from texsss.surface._uv_picture import COLOURS
from texsss.surface.doctor import UvReport, examine
from texsss.surface.topology import Edges, edge_report

NOTHING = 1e-6  # share of the light below which none comes back
FEW_TEXELS = 2.0  # that the 99 % radius must span to be seen
MANY_TEXELS = 100.0  # beyond which fewer would show the same
MOST_TEXELS = 8192
LEAST_PADDING = 2.0  # texels between charts that look-ups beside their edges reach
LARGE_SHARE = 0.25  # of the object's height that light may cross before flat profiles mislead


def inspect(run: Run, picture: Path | None = None) -> dict:
    """What was found and what to do about it, as plain values.

    `picture`: a PNG to write that shows where in the author's texture coordinates, or without any in those of
    the atlas.

    `mesh`: counts, size [mm], unit. `uv`: the doctor's report on the author's texture coordinates, or
    None without. `atlas`: what the light would be stored in. `scale`: lengths of the scattering per
    channel in mm, texels and as a share of the object's height; `radius`: within which 99 % of the light
    comes back. `kernel`: what these lengths mean for this bake. `faults`: what is wrong with coordinates and
    edges, each with its remedy. `advice`: what a bake would note, the worst first. `picture`: what it shows,
    a sentence, only if one was asked for.
    """
    mesh, notes = run.mesh.value
    size = run.scene.atlas.texels
    atlas, texels, spread = run.atlas.value, run.texels.value, curve(run)
    own = mesh.source_uv
    report = None
    if own is not None or picture is not None:
        report, image = examine(mesh, atlas.uv if own is None else own, (size, size), run.cancel)
        if picture is not None:
            write_png(picture, with_legend(image, legend(report)))
    shows = f"the author's texture coordinates of {mesh.name}"
    if own is None:
        shows = f"those that light gets ({atlas.origin}), as {mesh.name} has no texture coordinates"
        report = None
    texel = texels.texel_mm
    lengths = {
        "mean_free_path": spread["mean_free_path_mm"],
        "diffusion_length": spread["diffusion_length_mm"],
        "radius": spread["radius_mm"]["0.99"],
    }
    # a radius means nothing in channels of which nothing comes back
    back = [mm for mm, total in zip(lengths["radius"], spread["total"], strict=True) if total > NOTHING]
    height = float(mesh.extent[1]) or float(mesh.extent.max())
    scale = {"texel_mm": texel, "height_mm": height, "object_mm": [round(x, 4) for x in mesh.extent.tolist()]}
    for name, length in lengths.items():
        for unit, one in (("mm", 1.0), ("texels", texel), ("share", height)):
            scale[f"{name}_{unit}"] = [None if mm is None else mm / one for mm in length]
    found = {
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
        "faults": [*faults_of_uv(report), *faults_of_edges(edge_report(mesh.faces))],
        "kernel": kernel(max(back, default=0.0), texel, height, mesh.name, size),
        "advice": run.advice,
    }
    return found if picture is None else found | {"picture": f"{picture} shows {shows}."}


def legend(report: UvReport) -> list[tuple[tuple[float, float, float], str]]:
    """What the colours of the doctor's picture mean, and how many faces have them."""
    means = {
        "sound": "sound",
        "mirrored": f"mirrored, which is fine: {report.mirrored:,}",
        "flipped": f"folded back: {report.flipped:,}",
        "outside": f"outside of the square: {report.outside:,}",
        "overlap": f"under others: {report.overlapping:,}",
        "flat": f"no area in uv: {report.flat:,}",
        "seam": f"borders of charts: {report.atlas.charts:,}",
        "empty": f"empty: {max(0.0, 1 - report.covered):.0%} of the square",
    }
    return [(COLOURS[name], text) for name, text in means.items()]


def faults_of_uv(report: UvReport | None) -> list[str]:
    """Every count of the doctor's that is not as it should be, in a sentence with its remedy."""
    if report is None:
        return []
    remedy = (
        "few enough to store light in them; mend them if you see specks"
        if report.atlas.serves
        else "light gets coordinates of its own (--uv auto or xatlas); unwrap anew what maps are painted on"
    )
    counts = {
        "leave the unit square": report.outside,
        "lie partly under others in uv": report.overlapping,
        "are folded back within their chart": report.flipped,
        "have no area in uv": report.flat,
    }
    said = [f"Faces that {what}: {count:,}; {remedy}." for what, count in counts.items() if count]
    if report.atlas.starved:
        said.append(
            f"Charts without a texel: {report.atlas.starved:.2%} of the surface; raise --size, or give small "
            "charts more room."
        )
    if report.padding_texels is not None and report.padding_texels < LEAST_PADDING:
        said.append(
            f"Texels between charts: {report.padding_texels:.2g} at the least; raise --size, or leave "
            f"{LEAST_PADDING:g}."
        )
    return said


def faults_of_edges(edges: Edges) -> list[str]:
    """Edges at which the surface is no closed, oriented one, in sentences with their remedies."""
    remedies = {
        "Open edges, at which light ends": (edges.open, "close the holes if it is to be solid"),
        "Edges of more than two faces": (
            edges.non_manifold,
            "take inner and double faces away (in Blender: Select, All by Trait, Non Manifold)",
        ),
        "Edges of faces that turn against each other": (
            edges.inconsistent,
            "the wrong ones stay dark; turn them (in Blender: Mesh, Normals, Recalculate Outside)",
        ),
    }
    return [f"{what}: {count:,}; {remedy}." for what, (count, remedy) in remedies.items() if count]


def kernel(radius_mm: float, texel_mm: float, height_mm: float, name: str, size: int) -> list[str]:
    """What the widest channel's 99 % radius [mm] means beside a texel and the object, and what to do.

    `texel_mm`, `height_mm`: of the atlas of `size` texels and of the object called `name`. A radius of 0
    stands for media of which no light comes back.
    """
    if not 0 < radius_mm < math.inf:
        return [
            "kernel = none: no light comes back out of this material; raise sigma_s_per_mm, or take another "
            "--material."
        ]
    texels, share = radius_mm / texel_mm, radius_mm / height_mm
    part = f"{share:.2g} times" if share >= 1 else f"{100 * share:.2g} % of"
    in_texels = f"kernel = {texels:.2g} texels (99 % of the light comes back within {radius_mm:.3g} mm)"
    in_object = f"kernel = {part} {name}, which is {height_mm:.3g} mm tall"
    if texels < FEW_TEXELS:
        wanted = 2 ** math.ceil(math.log2(size * FEW_TEXELS / texels))
        remedy = (
            f"raise --size to {wanted}, or check --unit-mm"
            if wanted <= MOST_TEXELS
            else f"even --size {MOST_TEXELS} would not show it: check --unit-mm, or take --diffusion none"
        )
        in_texels += f": too narrow to be seen; {remedy}."
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
