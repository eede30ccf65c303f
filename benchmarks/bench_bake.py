"""A whole bake, and what an edit of the material or of a light costs on a baked scene.

python -m benchmarks.bench_bake [MESH [ALBEDO]]: the scanned head where it is at hand, else our own asset.
"""

import sys
import tempfile
import time
from pathlib import Path

from texsss.baker import Baker
from texsss.scene import Scene

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head"


def scene(
    size: int,
    mesh: Path | None,
    albedo: Path | None,
    *,
    material: str = "skin1",
    x_mm: float = 300,
    blue: float = 3.0,
) -> Scene:
    # uv: what a lightmap costs without operators; bench_surface has theirs
    data: dict = {
        "atlas": {"size": size},
        "methods": {"diffusion": "uv"},
        "material": {"layers": [{"medium": material}]},
    }
    data["lights"] = [
        {"type": "point", "position_mm": [x_mm, 400.0, 700.0], "intensity_w_per_sr": [3.0, 3.0, blue]}
    ]
    if mesh is not None:
        data["mesh"] = {"source": str(mesh), "unit_mm": 1000.0 if mesh.is_relative_to(HEAD) else None}
    if albedo is not None:
        data["maps"] = {"albedo": {"source": {"path": str(albedo)}, "space": "srgb"}}
        data["material"]["surface"] = {"albedo": "albedo"}
    return Scene.parse(data)


def clock(work) -> tuple[float, object]:
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def main() -> None:
    given = [Path(argument) for argument in sys.argv[1:3]]
    if not given and HEAD.is_dir():
        given = [HEAD / "LeePerrySmith.obj", HEAD / "Map-COL.jpg"]
    mesh, albedo = [*given, None, None][:2]
    Baker().bake(scene(64, mesh, albedo))  # libraries loaded, threads up

    print("size   bake+files   of which                    (1024²: ≤ 5 s, of it the bank ≤ 3 s)")
    for size in (256, 512, 1024, 2048):
        with tempfile.TemporaryDirectory() as folder:
            seconds, baked = clock(lambda size=size, folder=folder: _whole(scene(size, mesh, albedo), folder))
        stages = "  ".join(
            f"{name} {value:.2f}" for name, value in baked.report["seconds"].items() if value >= 0.01
        )
        print(f"{size:5d}  {seconds:6.2f} s     {stages}", flush=True)

    baker = Baker()
    cold, _ = clock(lambda: _shown(baker.bake(scene(1024, mesh, albedo))))
    print(
        "\nat 1024², on a baked scene (× faster than baking anew)"
        "\nlimits: another skin .1 s, a light .3 s and its bank"
    )
    edits = {
        "the same again": scene(1024, mesh, albedo),
        "another skin": scene(1024, mesh, albedo, material="skin2"),  # of the same refractive index
        "marble": scene(1024, mesh, albedo, material="marble"),  # of another: less light enters
        "a light moved": scene(1024, mesh, albedo, x_mm=200),
        "a tinted light": scene(1024, mesh, albedo, blue=2.0),  # three channels to blur, not one
    }
    for name, edited in edits.items():
        seconds, baked = clock(lambda edited=edited: _shown(baker.bake(edited)))
        made = "  ".join(f"{stage} {value:.3f}" for stage, value in baked.report["seconds"].items())
        print(f"{name:18s} {seconds:6.3f} s  {cold / seconds:6.1f}×   {made}", flush=True)


def _shown(baked):
    """What an edit is waited for: the radiance texture."""
    _ = baked.radiance
    return baked


def _whole(described: Scene, folder: str):
    baked = Baker().bake(described)
    baked.save(folder)
    return baked


if __name__ == "__main__":
    main()
