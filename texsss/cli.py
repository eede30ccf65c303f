"""The command line: `texsss bake`, `render`, `compare`, `map`, `inspect`, `profile`, `serve` …"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from texsss import gallery, openmp  # noqa: F401 - before torch
from texsss.ahead import Ahead, build_until_exit
from texsss.options import takes_scene
from texsss.scene import Scene
from texsss.terminal import (
    image_name,
    mistakes_told,
    noted_warnings,
    say,
    show_table,
    shown_progress,
    writable,
)

if TYPE_CHECKING:
    from texsss.io.sandbox import Sandbox

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
scene_app = typer.Typer(help="Scene files.")
app.add_typer(scene_app, name="scene")


def _say_version(asked: bool) -> bool:
    if asked:
        print(f"texsss {version('texsss')}")
        raise typer.Exit()
    return asked


@app.callback()
def texsss(
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Say which version this is."),
    ] = False,
) -> None:
    """Layered subsurface scattering in the texture space of a mesh."""


@app.command()
@takes_scene
def bake(
    scene: Scene,
    sandbox: "Sandbox | None",
    out: Annotated[Path, typer.Option(help="Folder for the six files.")] = Path("out"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what it would cost.")] = False,
) -> None:
    """Bakes scattered light into textures, a GLB and a preview."""
    writable(out)
    if not dry_run:
        build_until_exit()
    from texsss.baker import Baker, lasting_shelf  # torch takes its time: not for --help

    baker = Baker(shelf=lasting_shelf(), sandbox=sandbox)
    if dry_run:
        show_table("Expected", baker.estimate(scene))
        return
    with shown_progress() as progress:
        baked = baker.bake(scene, progress=progress, notice=lambda note: say("note", "yellow", note))
        for note in baked.report["notes"]:
            say("note", "yellow", note)
        written = baked.save(out, progress=progress)
    for path in written.values():
        print(path)


@app.command()
@takes_scene
def render(
    scene: Scene,
    sandbox: "Sandbox | None",
    out: Annotated[Path, typer.Option(help="The picture, .png or .exr.")] = Path("image.png"),
) -> None:
    """Renders the picture of a scene alone."""
    image_name(out)
    build_until_exit()
    from texsss.baker import Baker, lasting_shelf

    with shown_progress() as progress:
        Baker(shelf=lasting_shelf(), sandbox=sandbox).bake(scene, progress=progress).save_picture(out)
    print(out)


@app.command()
@takes_scene
def inspect(
    scene: Scene,
    sandbox: "Sandbox | None",
    as_json: Annotated[bool, typer.Option("--json", help="Everything, as JSON.")] = False,
    picture: Annotated[
        Path | None,
        typer.Option(help="Write a PNG of the texture coordinates that shows where, with a legend."),
    ] = None,
) -> None:
    """Examines a mesh before baking: texture coordinates, topology, scale; says what to do."""
    if picture is not None:
        image_name(picture, (".png",), "--picture")
    from texsss.baker import Baker

    with shown_progress() as progress:
        found = Baker(sandbox=sandbox).inspect(scene, progress=progress, picture=picture)
    if as_json:
        print(json.dumps(found, indent=2))
        return
    for part in ("mesh", "uv", "atlas", "scale"):
        if found[part] is not None:
            show_table(part, found[part])
    for sentence in [*found["kernel"], *found["faults"], *found["advice"]]:
        print(f"- {sentence}")
    if picture is not None:
        print(found["picture"])


@app.command()
@takes_scene
def compare(
    scene: Scene,
    sandbox: "Sandbox | None",
    out: Annotated[Path, typer.Option(help="Folder for table, numbers and sheet.")] = Path("compare"),
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="none, uv, surface, octree, poisson, march-uniform or march-exact, with +through for light "
            "from the far side; repeat for more."
        ),
    ] = None,
    reference: Annotated[str | None, typer.Option(help="The method that others are held against.")] = None,
) -> None:
    """Bakes a scene by several methods: pictures side by side, differences, errors and seconds."""
    writable(out)
    build_until_exit()
    from texsss.baker import Baker
    from texsss.compare import DEFAULT
    from texsss.compare import compare as compared

    baker = Baker(sandbox=sandbox)
    with shown_progress() as progress:
        found = compared(scene, tuple(method or DEFAULT), reference=reference, baker=baker, progress=progress)
        written = found.save(out)
    print(found.markdown())
    for path in written.values():
        print(path)


@app.command("map")
@takes_scene
def map_(
    scene: Scene,
    sandbox: "Sandbox | None",
    name: Annotated[
        str,
        typer.Option(
            help="seam-jump, metric, through-mm, texel-mm, gaussian-3, weight-3, thickness-1, irradiance, "
            "diffused, exitance, radiance, single, coverage, albedo, position or normal."
        ),
    ] = "irradiance",
    out: Annotated[Path, typer.Option(help="The image, .png or .exr.")] = Path("map.exr"),
) -> None:
    """Writes what lies between the stages of a bake as an image over the atlas.

    EXR holds the values themselves; PNG has them between black and white, which is told and kept in its text.
    """
    image_name(out)
    from texsss.baker import Baker
    from texsss.result import save_map

    with shown_progress() as progress:
        found = Baker(sandbox=sandbox).intermediate(scene, name, progress=progress)
    read = save_map(out, name, found)
    say("range", "cyan", f"{name}: {read.sentence if out.suffix.lower() == '.png' else read.values}")
    print(out)


@app.command()
def profile(
    material: Annotated[str, typer.Argument(help="A preset, or a scene.json whose material is meant.")],
    plot: Annotated[Path | None, typer.Option(help="Write a plot of R(r), .png or .svg.")] = None,
    model: Annotated[
        str | None, typer.Option(help="The model to show, such as multipole; layered-sp3 unless told.")
    ] = None,
    against: Annotated[
        list[str] | None, typer.Option(help="Another model in the plot, such as multipole; may be repeated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Everything, as JSON.")] = False,
) -> None:
    """Shows how a material scatters: R(r), total, lengths in mm, Gaussians."""
    scene = Scene.load(material) if material.endswith(".json") else Scene.parse({"material": material})
    from texsss.baker import Baker

    if plot is not None:
        image_name(plot, (".png", ".svg"), "--plot")
    baker = Baker()
    data = scene.model_dump(mode="json", exclude_none=True)

    def by(name: str) -> dict:
        return baker.curve(Scene.parse(data | {"methods": data["methods"] | {"profile": name}}))

    found = baker.curve(scene) if model is None else by(model)
    others = [by(name) for name in against or ()]
    if plot is not None:
        from texsss.plot import plot_curve
        from texsss.result import staging

        with staging(plot.parent) as temporary:
            plot_curve(found, temporary / plot.name, title=material, against=others)
    if as_json:
        print(json.dumps(found, indent=2))
        return
    numbers = ("mean_free_path_mm", "diffusion_length_mm", "total", "fit_error")
    lengths = {name: ["without end" if x is None else x for x in found[name]] for name in numbers}
    radii = {f"radius_of_{float(share):.0%}_mm": radius for share, radius in found["radius_mm"].items()}
    show_table(material, lengths | radii)


@app.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on; 127.0.0.1 if left out.")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on; 8000 if left out.")] = None,
    threads: Annotated[
        int | None, typer.Option(help="Threads of a computation; all cores if left out.")
    ] = None,
    cache_mb: Annotated[float | None, typer.Option(help="Memory for results of stages [MB].")] = None,
    log_format: Annotated[str | None, typer.Option(help="json or text.")] = None,
) -> None:
    """Serves previews and the page over HTTP; every other setting is a variable TEXSSS_…"""
    # the folder server/ under its installed name, which a type checker cannot follow
    from texsss_server.settings import of_options  # pyright: ignore[reportMissingImports]

    ahead = Ahead()
    settings = of_options(host=host, port=port, threads=threads, cache_mb=cache_mb, log_format=log_format)
    if settings.warm:
        ahead.start()
    from texsss_server.serve import serve as run  # pyright: ignore[reportMissingImports]

    run(settings, ahead)


@app.command("cache")
def cache_command(
    clear: Annotated[bool, typer.Option("--clear", help="Take everything away.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Everything, as JSON.")] = False,
) -> None:
    """Lists what is kept on disk between runs, and how large it is; TEXSSS_DISK_MB bounds it."""
    from texsss.shelf import users_shelf

    shelf = users_shelf()
    removed = shelf.clear() if clear else 0
    items = shelf.items()
    total = sum(item.bytes for item in items)
    if as_json:
        listed = [{"name": item.path.name, "bytes": item.bytes, "used": item.used} for item in items]
        found = {"folder": str(shelf.folder), "bytes": total, "max_bytes": shelf.max_bytes, "items": listed}
        print(json.dumps(found | {"removed": removed}, indent=2))
        return
    rows = {"folder": str(shelf.folder), "size": f"{total / 2**20:.0f} of {shelf.max_bytes / 2**20:.0f} MB"}
    rows |= {"removed": f"{removed} files"} if clear else {}
    for item in items:
        used = time.strftime("%F %R", time.localtime(item.used))
        rows[item.path.stem] = f"{item.bytes / 2**20:.0f} MB, used {used}"
    show_table("Kept on disk", rows)


@scene_app.command("init")
def scene_init(
    name: Annotated[
        str | None, typer.Argument(help="A shipped scene, see list; the default if left out.")
    ] = None,
) -> None:
    """Prints a scene to start from, every field stated: texsss scene init > scene.json"""
    print((Scene() if name is None else gallery.scene(name)).to_json(), end="")


@scene_app.command("list")
def scene_list() -> None:
    """Lists the shipped scenes."""
    show_table("Scenes", {name: gallery.scene(name).summary for name in gallery.names()})


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line and exits; a user's mistake is one sentence and exit code 2."""
    given = sys.argv[1:] if arguments is None else arguments
    with mistakes_told(), noted_warnings():
        code = app(args=given or ["--help"], standalone_mode=False)
    sys.exit(code or 0)
