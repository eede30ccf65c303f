"""Pictures against a volumetric path tracer (Mitsuba 3): how wrong each method is, and how long it takes.

    python -m benchmarks path_tracer        # needs: pip install mitsuba

Both see the same mesh of one homogeneous medium behind a boundary without refraction (eta 1), lit by one
point light. Pictures are averaged over boxes of 5 × 5 pixels; compared where a box lies within the object.
The tracer's noise is told from the methods' errors: it traces twice, by seeds of its own, and the mean square
of half the difference is that of the noise in the mean of both; it is taken off the squared errors. Ours are
seen by 3 × 3 rays per pixel of equal weight: `camera.samples` would weigh bright ones down along outlines.
"""

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import trimesh

from texsss.baker import Baker
from texsss.io.images import write_png
from texsss.light.visibility import Occluder
from texsss.media.presets import preset
from texsss.scene import Scene
from texsss.surface.mesh import Mesh
from texsss.types import Float, Tensor
from texsss.view.camera import Camera, pixel_centres, primary_hits

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "LeePerrySmith.obj"
OWN = "axolotl/axolotl.obj"
# what is seen (the radius of a ball [mm], a file or our own), millimetres per unit, and what it is made of
OBJECTS: dict[str, tuple[float | Path | str, float | None, str]] = {
    "ball": (100.0, 1.0, "skin1"),
    "marble": (20.0, 1.0, "marble"),
    "bead": (5.0, 1.0, "marble"),
    "head": (HEAD, None, "skin1"),
    "axolotl": (OWN, 1.0, "marble"),
    "large axolotl": (OWN, 3.0, "marble"),
}
BOX = 5  # pixels
FINER = 3  # rays of ours along each edge of a pixel
METHODS = {
    "no diffusion (Lambert)": {"diffusion": "none"},
    "diffusion of all light": {"diffusion": "surface", "single_scattering": "none"},
    "diffusion + march": {"diffusion": "surface", "single_scattering": "exact"},
    "… + transmission": {"diffusion": "surface", "single_scattering": "exact", "transmission": True},
    "… + interreflection": {
        "diffusion": "surface",
        "single_scattering": "exact",
        "transmission": True,
        "interreflection": 3,
    },
    "… + angular": {
        "diffusion": "surface",
        "single_scattering": "exact",
        "transmission": True,
        "interreflection": 3,
        "angular": True,
    },
}
NEVER = 1 << 20  # roulette on paths of hundreds of scatterings leaves a few of great weight: bright dots
AWAY = 1.5  # extents of the object: how far it is moved to tell what its distance from the origin costs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=256, help="of the path tracer, per pixel, twice")
    parser.add_argument("--size", type=int, nargs=2, default=(200, 150), metavar=("W", "H"))
    parser.add_argument("--atlas", type=int, default=1024)
    parser.add_argument("--only", choices=tuple(OBJECTS))
    parser.add_argument("--keep", type=Path, help="a folder of what was traced, to be taken from there again")
    parser.add_argument("--pictures", type=Path, help="a folder for the pictures, as PNG")
    arguments = parser.parse_args()
    try:
        import drjit
        import mitsuba
    except ImportError:
        print("skipped: the path tracer is not installed; pip install mitsuba")
        return
    mitsuba.set_variant("scalar_rgb")
    drjit.set_thread_count(torch.get_num_threads())
    with tempfile.TemporaryDirectory() as folder:
        everything(arguments, Path(folder))


def ball(folder: Path, radius: float) -> Path:
    """A file of a sphere: nothing on it lights anything else on it."""
    path = folder / f"ball{radius:g}.obj"
    trimesh.creation.icosphere(subdivisions=6, radius=radius).export(path)
    return path


@dataclass(frozen=True)
class Case:
    """One object in one medium under one lamp; lengths [mm], `intensity` [W/sr]."""

    solid: Mesh
    camera: Camera
    occluder: Occluder
    sigma_a: list[float]
    sigma_s: list[float]
    lamp: Float[Tensor, "3"]
    intensity: float
    reach: float


def everything(arguments: argparse.Namespace, folder: Path) -> None:
    """Prints the tables of all objects."""
    for name, (source, unit_mm, medium) in OBJECTS.items():
        if arguments.only not in (None, name):
            continue
        if source == HEAD and not HEAD.is_file():
            print(f"{name}: skipped, {HEAD} is absent")
            continue
        if isinstance(source, float):
            source = ball(folder, source)
        mesh: dict = {"source": {"path": str(source)} if isinstance(source, Path) else {"builtin": source}}
        compared(name, mesh if unit_mm is None else mesh | {"unit_mm": unit_mm}, medium, arguments)


def compared(name: str, mesh: dict, medium: str, arguments: argparse.Namespace) -> None:
    """Prints the table of one object."""
    known = preset(medium)  # scatters alike in all directions
    plain = {"sigma_a_per_mm": known.sigma_a.tolist(), "sigma_s_per_mm": known.sigma_s.tolist(), "eta": 1.0}
    baker = Baker()
    first = Scene.parse({"mesh": mesh, "camera": {"resolution": arguments.size}})
    run = baker._run(first, None, None)
    solid, camera = run.mesh.value[0], run.camera.value
    eye, target = camera.position, camera.target
    reach = float(solid.extent.max())
    lamp = eye + reach * torch.tensor([1.0, 0.8, 0.2], dtype=torch.float64)
    intensity = (float((lamp - target).norm()) / 1000) ** 2  # about 1 W/m² where it shines
    media = plain["sigma_a_per_mm"], plain["sigma_s_per_mm"]
    case = Case(solid, camera, run.occluder.value, *media, lamp, intensity, reach)
    scene = {
        "mesh": mesh,
        "media": {"plain": plain},
        "material": {"layers": [{"medium": "plain"}], "surface": {"specular": 0.0}},
        "lights": [{"type": "point", "position_mm": lamp.tolist(), "intensity_w_per_sr": [intensity] * 3}],
        "atlas": {"size": arguments.atlas},
        "camera": {
            "position_mm": eye.tolist(),
            "target_mm": target.tolist(),
            "resolution": [FINER * n for n in arguments.size],
            "samples": 1,
        },
        "output": {"background": [0.0, 0.0, 0.0]},
    }
    start = time.perf_counter()
    size = "x".join(map(str, arguments.size))
    kept = arguments.keep and arguments.keep / f"{name} {size} {arguments.samples}.pt"
    truth = traced(case, arguments.samples, kept)
    print(f"\n{name}, {medium}, {reach:.0f} mm, {arguments.size[0]} × {arguments.size[1]}")
    print(f"path tracer, twice {arguments.samples} samples: {time.perf_counter() - start:.1f} s\n")
    print("| picture | RMSE, R G B | of it noise | without noise | mean ratio, R G B | first, s | again, s |")
    print("|---|---|---|---|---|---|---|")
    shown = {"path tracer": truth.mean(0)}
    for label, methods in METHODS.items():
        given = Scene.parse(scene | {"methods": methods})
        start = time.perf_counter()
        image = meaned(baker.render(given))
        seconds = time.perf_counter() - start
        start = time.perf_counter()
        baker.render(given.model_copy(update={"seed": 1}))
        again = time.perf_counter() - start
        columns = (" ".join(f"{x:.3f}" for x in column) for column in errors(image, truth))
        print(f"| {label} | {' | '.join(columns)} | {seconds:.1f} | {again:.1f} |", flush=True)
        shown[label] = image
    if arguments.pictures is not None:
        save(arguments.pictures, name, shown)


def traced(case: Case, samples: int, kept: Path | None) -> Tensor:
    """Mitsuba's picture twice, of seeds of its own each (2, h, w, 3), in W/(m² sr); see `freed`."""
    if kept is not None and kept.is_file():
        return torch.load(kept)
    halves = torch.stack([freed(case, samples, seed) for seed in range(2)])
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        torch.save(halves, kept)
    return halves


def freed(case: Case, samples: int, seed: int) -> Tensor:
    """Mitsuba's picture (h, w, 3), in W/(m² sr), freed of how far off a boundary its rays start.

    It traces in single precision, and rays start 9e-5 × (1 + the largest coordinate) beyond what they cross:
    so much of the medium scatters nothing of what enters, 1 to 4 % of the light here. That grows with the
    distance from the origin: the same scene further away tells what none would be. Each channel is traced by
    itself, as a grey medium: weights that differ between channels leave bright dots for long.
    """
    far = AWAY * case.reach
    # what is seen from there counts for little, and so does its noise
    here, there = (
        torch.stack([once(case, channel, 2 * seed + place, count, away) for channel in range(3)], -1)
        for place, (count, away) in enumerate(((samples, 0.0), (max(samples // 4, 1), far)))
    )
    hits = primary_hits(case.camera, case.occluder, *every_pixel(case.camera), torch.float32)
    place = hits.points.position(case.solid)
    near, beyond = (1 + (place + place.new_tensor([x, 0, 0])).abs().amax(1) for x in (0.0, far))
    share = torch.full((len(here.flatten(0, 1)),), float((near / (beyond - near)).mean()))
    share[hits.pixel] = (near / (beyond - near)).to(share)
    return here + share.reshape(*here.shape[:2], 1) * (here - there)


def every_pixel(camera: Camera) -> tuple[Tensor, Tensor]:
    """Centres and numbers of all pixels."""
    return pixel_centres(camera), torch.arange(camera.resolution[0] * camera.resolution[1])


def once(case: Case, channel: int, seed: int, samples: int, away: float) -> Tensor:
    """One channel (h, w) as it is seen when everything is `away` from where it is [mm]."""
    import mitsuba as mi

    scattered, extinct = case.sigma_s[channel], case.sigma_s[channel] + case.sigma_a[channel]
    move = np.array([away, 0.0, 0.0])
    eye, target, up = (
        np.asarray(v, dtype=float) for v in (case.camera.position, case.camera.target, case.camera.up)
    )
    width, height = case.camera.resolution
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "solid.ply"
        trimesh.Trimesh(
            case.solid.vertices.double().numpy() + move, case.solid.faces.numpy(), process=False
        ).export(path)
        scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": NEVER},
                "sensor": {
                    "type": "perspective",
                    "fov": float(np.degrees(case.camera.fov_y)),
                    "fov_axis": "y",
                    "to_world": mi.ScalarTransform4f().look_at(
                        origin=(eye + move).tolist(), target=(target + move).tolist(), up=up.tolist()
                    ),
                    "film": {
                        "type": "hdrfilm",
                        "width": width,
                        "height": height,
                        "pixel_format": "rgb",
                        "component_format": "float32",
                        "rfilter": {"type": "box"},
                    },
                    "sampler": {"type": "independent", "sample_count": samples},
                },
                "solid": {
                    "type": "ply",
                    "filename": str(path),
                    "face_normals": True,
                    "bsdf": {"type": "null"},
                    "interior": {"type": "homogeneous", "sigma_t": extinct, "albedo": scattered / extinct},
                },
                "lamp": {
                    "type": "point",
                    "position": (case.lamp.numpy() + move).tolist(),
                    "intensity": {"type": "rgb", "value": [case.intensity * 1e6] * 3},  # of mm
                },
            }
        )
        return torch.from_numpy(np.array(mi.render(scene, seed=3 * seed + channel)))[..., 0]


def meaned(image: Float[Tensor, "H W 3"]) -> Float[Tensor, "h w 3"]:
    """Means of the rays of each pixel."""
    return torch.nn.functional.avg_pool2d(image.permute(2, 0, 1)[None], FINER)[0].permute(1, 2, 0)


def errors(image: Float[Tensor, "h w 3"], halves: Float[Tensor, "2 h w 3"]) -> tuple[Tensor, ...]:
    """Root mean square of the difference, of the noise, of the rest, all over the mean; ratio of means.

    Per channel, from the means of boxes. The rest is 0 where noise is more than the difference.
    """
    covered = (image.sum(-1, keepdim=True) > 0).float()
    ours, one, two, covered = (boxes(x)[0] for x in (image, *halves, covered))
    inside = covered[0] > 0.999
    ours, one, two = (x[:, inside].double() for x in (ours, one, two))
    theirs, noise = (one + two) / 2, ((one - two) / 2).square().mean(1)
    mean, wrong = theirs.mean(1), (ours - theirs).square().mean(1)
    squares = wrong, noise, (wrong - noise).clamp_min(0)
    return *(x.sqrt() / mean for x in squares), ours.mean(1) / mean


def boxes(image: Tensor) -> Tensor:
    """Means of boxes."""
    return torch.nn.functional.avg_pool2d(image.permute(2, 0, 1)[None].float(), BOX, 1)


def save(folder: Path, name: str, images: dict[str, Tensor]) -> None:
    """Pictures side by side, and their differences from the first."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = next(iter(images.values()))
    scale = 0.8 / float(truth.quantile(0.995))
    top = torch.cat([(scale * x).clamp(0, 1) ** (1 / 2.2) for x in images.values()], 1)
    away = torch.cat([(0.5 + scale * (x - truth)).clamp(0, 1) for x in images.values()], 1)
    write_png(folder / f"{name}.png", torch.cat([top, away], 0))


if __name__ == "__main__":
    main()
