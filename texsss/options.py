"""What the command line may say of a scene, as options that every command shares."""

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from texsss.errors import DomainError
from texsss.scene import Scene
from texsss.shorthand import FORMS, light


def described(
    source: Annotated[
        Path | None,
        typer.Argument(help="A mesh (OBJ, PLY, STL, GLB) or scene.json; our own asset if left out."),
    ] = None,
    material: Annotated[str | None, typer.Option(help="A preset: skin1, marble, …")] = None,
    unit_mm: Annotated[float | None, typer.Option(help="How long one unit of the mesh is [mm].")] = None,
    up: Annotated[str | None, typer.Option(help="The file's axis that points up: y, z, x, -y, …")] = None,
    v: Annotated[str | None, typer.Option(help="Which way v runs in the file: up or down.")] = None,
    pose: Annotated[
        Path | None, typer.Option(help="The same mesh bent: a file whose vertices stand elsewhere.")
    ] = None,
    refresh_operators: Annotated[
        bool, typer.Option("--refresh-operators", help="Spread light anew for --pose; else as at rest.")
    ] = False,
    size: Annotated[int | None, typer.Option(help="Edge of the lightmap [texels].")] = None,
    uv: Annotated[
        str | None, typer.Option(help="Lightmap coordinates: auto, source, xatlas (unwraps anew), fallback.")
    ] = None,
    albedo: Annotated[Path | None, typer.Option(help="Colour map (sRGB), laid on by the mesh's uv.")] = None,
    normal: Annotated[Path | None, typer.Option(help="Tangent-space normal map.")] = None,
    normal_y: Annotated[str | None, typer.Option(help="Its green leans +y (OpenGL) or -y (DirectX).")] = None,
    roughness: Annotated[
        str | None, typer.Option(help="0 to 1, or a grey map; file.png:g takes one channel of it.")
    ] = None,
    specular: Annotated[str | None, typer.Option(help="As --roughness.")] = None,
    lights: Annotated[
        list[str] | None, typer.Option("--light", help=f"May be repeated: {', '.join(FORMS.values())}.")
    ] = None,
    env: Annotated[
        Path | None, typer.Option(help="Panorama that lights the scene (best EXR or HDR).")
    ] = None,
    diffusion: Annotated[str | None, typer.Option(help="none, uv, …: how light spreads.")] = None,
    transmission: Annotated[
        bool | None,
        typer.Option("--transmission/--no-transmission", help="Light through thin parts, from the far side."),
    ] = None,
    incidence: Annotated[
        str | None, typer.Option(help="How light arrives: diffuse, normal, or degrees from the normal.")
    ] = None,
    interreflection: Annotated[
        int | None, typer.Option(help="How often light that left one part of the object lights others.")
    ] = None,
    exposure: Annotated[float | None, typer.Option(help="Exposure of the picture [EV].")] = None,
    tonemap: Annotated[str | None, typer.Option(help="linear, agx or aces.")] = None,
) -> Scene:
    """The scene that a mesh or scene file and options describe; options override the file.

    Raises TexsssError: when the file or an option is not understood.
    """
    if source is not None and source.suffix.lower() == ".json":
        data: dict[str, Any] = Scene.load(source).model_dump(mode="json")
    else:
        data = Scene().model_dump(mode="json") if source is None else {"mesh": {"source": str(source)}}
    surface = data.setdefault("material", {}).setdefault("surface", {})
    maps = data.setdefault("maps", {})

    def paint(name: str, path: Path | str | None, space: str, channel: str = "rgb") -> None:
        if path is not None:
            maps[name] = {"source": {"path": str(path)}, "space": space, "channel": channel}
            surface[name] = name

    def put(value: object, part: str, field: str) -> None:
        if value is not None:
            data.setdefault(part, {})[field] = value

    paint("albedo", albedo, "srgb")
    paint("normal", normal, "linear")
    for name, value in (("roughness", roughness), ("specular", specular)):
        number = _number(value)
        if number is not None:
            surface[name] = number
        elif value is not None and value[-2:] in (":r", ":g", ":b", ":a"):
            paint(name, value[:-2], "linear", value[-1])
        else:
            paint(name, value, "linear")
    if normal_y is not None:
        surface["normal_y"] = normal_y
    put(None if material is None else [{"medium": material}], "material", "layers")
    for field, value in (("unit_mm", unit_mm), ("up", up), ("v", v)):
        put(value, "mesh", field)
    if pose is not None:
        put({"source": {"path": str(pose)}}, "mesh", "pose")
    if refresh_operators:
        bent = data["mesh"].get("pose")
        if bent is None:
            raise DomainError("--refresh-operators: expected a pose, got none; name its file by --pose.")
        bent["operators"] = "pose"
    put(size, "atlas", "size")
    put(size, "atlas", "raster")
    put(uv, "atlas", "uv")
    put(diffusion, "methods", "diffusion")
    put(transmission, "methods", "transmission")
    angle = _number(incidence)
    put(incidence if angle is None else {"angle_deg": angle}, "methods", "incidence")
    put(interreflection, "methods", "interreflection")
    put(exposure, "output", "exposure_ev")
    put(tonemap, "output", "tonemap")
    shining = [light(text) for text in lights or []]
    if env is not None:
        maps["environment"] = {"source": {"path": str(env)}, "space": "srgb"}  # of PNG, JPEG
        shining.append({"type": "environment", "map": "environment"})
    if shining:
        data["lights"] = shining
    return Scene.parse(data)


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


Untrusted = Annotated[
    bool,
    typer.Option("--untrusted", help="Read files in a child of limited memory (1.5 GB) and time (20 s)."),
]


def takes_scene(command: Callable[..., None]) -> Callable[..., None]:
    """`command(scene, sandbox, …)` as a command that takes a scene's options in place of these two."""
    own = list(inspect.signature(command).parameters.values())[2:]
    shared = list(inspect.signature(described).parameters.values())
    doubt = inspect.Parameter(
        "untrusted", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Untrusted
    )

    @wraps(command)
    def run(untrusted: bool, **options: Any) -> None:
        rest = {parameter.name: options.pop(parameter.name) for parameter in own}
        scene = described(**options)
        if not untrusted:
            command(scene, None, **rest)
            return
        from texsss.io.sandbox import Sandbox  # torch takes its time: not for --help

        with Sandbox() as sandbox:
            command(scene, sandbox, **rest)

    parameters = [*shared, *own, doubt]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    del run.__wrapped__  # its signature is not the one to read
    return run
