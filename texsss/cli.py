"""The command line: `texsss bake`, `render`, `serve`, `scene init`, `profile`, `cache`."""

import os
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from texsss.errors import AssetError, TexsssError
from texsss.scene import Scene

app = typer.Typer(
    help="Layered subsurface scattering in the texture space of a mesh.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
scene_app = typer.Typer(help="Scene files.", no_args_is_help=True)
app.add_typer(scene_app, name="scene")
console = Console(stderr=True)

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

MeshOrScene = Annotated[
    Path | None,
    typer.Argument(help="A mesh (OBJ, PLY, STL, GLB) or scene.json; our own asset if left out."),
]
Material = Annotated[str | None, typer.Option(help="A preset: skin1, marble, wax, …")]
UnitMm = Annotated[float | None, typer.Option(help="How long one unit of the mesh is [mm].")]
Up = Annotated[str | None, typer.Option(help="The axis that points up in the file: y or z.")]
Size = Annotated[int | None, typer.Option(help="Edge of the lightmap [texels].")]
Albedo = Annotated[Path | None, typer.Option(help="Colour map (sRGB) in the mesh's own texture coordinates.")]
Diffusion = Annotated[str | None, typer.Option(help="none, uv, …: how light spreads over the texture.")]
Exposure = Annotated[float | None, typer.Option(help="Exposure of the picture [EV].")]
Tonemap = Annotated[str | None, typer.Option(help="linear, agx or aces.")]


def build_scene(
    source: Path | None,
    *,
    material: str | None = None,
    unit_mm: float | None = None,
    up: str | None = None,
    size: int | None = None,
    albedo: Path | None = None,
    diffusion: str | None = None,
    exposure: float | None = None,
    tonemap: str | None = None,
) -> Scene:
    """The scene that a mesh or scene file and options describe; options override the file."""
    if source is not None and source.suffix.lower() == ".json":
        data: dict[str, Any] = Scene.load(source).model_dump(mode="json")
    else:
        data = Scene().model_dump(mode="json") if source is None else {"mesh": {"source": str(source)}}

    def put(value: object, *path: str) -> None:
        if value is None:
            return
        place = data
        for name in path[:-1]:
            place = place.setdefault(name, {})
        place[path[-1]] = value

    put(None if material is None else [{"medium": material}], "material", "layers")
    put(unit_mm, "mesh", "unit_mm")
    put(up, "mesh", "up")
    put(size, "atlas", "size")
    put(diffusion, "methods", "diffusion")
    put(exposure, "output", "exposure_ev")
    put(tonemap, "output", "tonemap")
    if albedo is not None:
        put({"source": {"path": str(albedo)}, "space": "srgb"}, "maps", "albedo")
        put("albedo", "material", "surface", "albedo")
    return Scene.parse(data)


@app.command()
def bake(
    source: MeshOrScene = None,
    material: Material = None,
    unit_mm: UnitMm = None,
    up: Up = None,
    size: Size = None,
    albedo: Albedo = None,
    diffusion: Diffusion = None,
    exposure: Exposure = None,
    tonemap: Tonemap = None,
    out: Annotated[Path, typer.Option(help="Folder for the six files.")] = Path("out"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what it would cost.")] = False,
) -> None:
    """Bakes scattered light into textures, a GLB and a preview."""
    scene = build_scene(
        source,
        material=material,
        unit_mm=unit_mm,
        up=up,
        size=size,
        albedo=albedo,
        diffusion=diffusion,
        exposure=exposure,
        tonemap=tonemap,
    )
    if dry_run:
        from texsss.estimate import estimate

        expected = estimate(scene)
        table = Table(title="Expected", show_header=False)
        for name, value in expected.items():
            table.add_row(name, str(value))
        Console().print(table)
        return
    writable(out)
    from texsss.baker import Baker  # torch takes its time: not for --help

    with shown_progress() as progress:
        baked = Baker().bake(scene, progress=progress)
        for note in baked.report["notes"]:
            console.print(f"[yellow]note[/] {note}", highlight=False)
        written = baked.save(out, progress=progress)
    for path in written.values():
        print(path)


@app.command()
def render(
    source: MeshOrScene = None,
    out: Annotated[Path, typer.Option(help="The picture, .png or .exr.")] = Path("image.png"),
    material: Material = None,
    unit_mm: UnitMm = None,
    up: Up = None,
    size: Size = None,
    albedo: Albedo = None,
    diffusion: Diffusion = None,
    exposure: Exposure = None,
    tonemap: Tonemap = None,
) -> None:
    """Renders the picture of a scene alone."""
    if out.suffix.lower() not in {".png", ".exr"}:
        raise AssetError(f"Output: expected a name that ends in .png or .exr, got {out}; change --out.")
    scene = build_scene(
        source,
        material=material,
        unit_mm=unit_mm,
        up=up,
        size=size,
        albedo=albedo,
        diffusion=diffusion,
        exposure=exposure,
        tonemap=tonemap,
    )
    from texsss.baker import Baker

    writable(out.parent)
    with shown_progress() as progress:
        Baker().bake(scene, progress=progress).save_picture(out)
    print(out)


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
    from texsss_server.serve import serve as run
    from texsss_server.settings import of_options

    run(of_options(host=host, port=port, threads=threads, cache_mb=cache_mb, log_format=log_format))


@scene_app.command("init")
def scene_init() -> None:
    """Prints the default scene, every field stated: texsss scene init > scene.json"""
    print(Scene().to_json(), end="")


def writable(folder: Path) -> None:
    """Raises AssetError: when files can't be made in `folder`, before any work is done."""
    existing = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    if not existing.is_dir():
        raise AssetError(f"Output: expected a folder, got the file {existing}; choose another with --out.")
    if not os.access(existing, os.W_OK):
        raise AssetError(f"Output: {existing} cannot be written; choose another folder with --out.")


@contextmanager
def shown_progress():
    """A bar per stage on the terminal; silence where there is none."""
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description:<10}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=not console.is_terminal,
        disable=not console.is_terminal,
    ) as bars:
        tasks = {}

        def progress(stage: str, fraction: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=fraction)

        yield progress


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line and exits; a user's mistake is one sentence and exit code 2."""
    try:
        app(args=arguments)
    except TexsssError as error:
        console.print(f"[red]error[/] {error}", highlight=False, markup=True, soft_wrap=True)
        sys.exit(EXIT_BAD_INPUT)
    except KeyboardInterrupt:
        console.print("stopped; nothing was written")
        sys.exit(EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
