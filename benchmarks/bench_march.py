"""Times of the layered march: 800 × 600 pixels with three layers, beside table 2 of François et al. 2006.

    python benchmarks/bench_march.py [--model fish | gecko] [--mesh FISH.obj] [--repeat 5] [--only compiled]
        [--samples 4000]

The close-up fills the frame, so that all 480,000 pixels are marched. `march alone` is what the paper's
fragment shader does after rasterisation: rays and lights are given. It is in seconds by the clock and, in
brackets, of all processors, which other programs disturb less; `whole call` includes setting them up.
`paper` is its frames per second on a GeForce 7800 GTX, `fps` ours of the march alone, both with three lights.
The fish is a foreign mesh where there is one, else the shipped animal; the gecko is the shipped scene.
"""

from texsss import openmp  # noqa: F401, I001  before torch

import argparse
import math
import time
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import trimesh

from texsss import gallery
from texsss.cache import StageCache
from texsss.light.emitters import Light, PointLight
from texsss.light.visibility import Occluder
from texsss.media.medium import Medium
from texsss.pipeline import Run
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.transport.march.gatherer import Gatherer
from texsss.transport.march.interior import Interior, from_depths, from_stack
from texsss.transport.march.march import march
from texsss.transport.march.planes import Planes, fit_planes, plane_radius
from texsss.transport.march.setup import Surface, light_scalars, view_rays
from texsss.types import unit

PAPER_FPS = {"fish": {10: 126, 50: 51, 100: 20}, "gecko": {10: 120, 50: 33, 100: 16}}
FISH = Path(__file__).resolve().parents[2] / "shared" / "data" / "meshes" / "fish_blub_uv.obj"
LENGTH_MM = 60.0


def fish_media() -> list[Medium]:
    """Dermis, blood, organs: table 1 of François et al. 2006."""
    return [
        Medium([0.6, 0.6, 0.6], [2.0, 1.0, 1.0], 0.25, 1.0),
        Medium([0.6, 0.6, 0.6], [6.0, 3.0, 2.0], 0.40, 1.0),
        Medium([0.5, 0.5, 0.5], [1.0, 1.0, 2.0], 0.80, 1.0),
    ]


def vein_depths(size: int, seed: int = 0) -> torch.Tensor:
    """Three boundaries (H, W, 3) [mm]: a thin skin, veins that reach up into it, a floor."""
    generator = torch.Generator().manual_seed(seed)
    v, u = torch.meshgrid(*[(torch.arange(size) + 0.5) / size] * 2, indexing="ij")
    ridge = torch.zeros(size, size)
    for frequency in (2, 3, 5, 8):
        phase = torch.rand(4, generator=generator) * 2 * math.pi
        wave = torch.sin(
            2 * math.pi * frequency * u + phase[0] + 2 * torch.sin(2 * math.pi * 2 * v + phase[1])
        )
        wave = wave + torch.sin(
            2 * math.pi * frequency * v + phase[2] + 2 * torch.sin(2 * math.pi * u + phase[3])
        )
        ridge = torch.maximum(ridge, torch.exp(-((wave * 6 / frequency**0.5) ** 2)))
    skin = torch.full_like(u, 0.25)
    return torch.stack(
        [skin, skin + 0.05 + 0.7 * ridge, skin + 2.2 - 0.4 * torch.cos(2 * math.pi * 3 * u)], -1
    )


def load(path: Path) -> Mesh:
    loaded = trimesh.load(path, force="mesh", process=False)
    vertices = torch.from_numpy(loaded.vertices.copy()).float()
    vertices = vertices * (LENGTH_MM / float((vertices.amax(0) - vertices.amin(0)).amax()))
    faces = torch.from_numpy(loaded.faces.copy()).long()
    uv = torch.from_numpy(loaded.visual.uv.copy()).float()[faces]
    uv[..., 1] = 1 - uv[..., 1]
    merged, index = torch.unique(vertices, dim=0, return_inverse=True)
    return Mesh(merged, index[faces], uv)


@dataclass(frozen=True)
class Model:
    """What is looked at, from where: a place [mm], the way to the eye, half the height seen [radians]."""

    mesh: Mesh
    interior: Interior
    planes_mm: float
    target: torch.Tensor
    direction: torch.Tensor
    half: float


def fish(path: Path) -> Model:
    """The foreign fish, or the shipped animal with the same media and depths."""
    interior = from_depths(vein_depths(1024), fish_media())
    radius = plane_radius(1.6)
    if path.exists():
        mesh = load(path)
        centre = (mesh.vertices.amax(0) + mesh.vertices.amin(0)) / 2
        return Model(mesh, interior, radius, centre, torch.tensor([1.0, 0.25, 0.3]), math.radians(5.5))
    print(f"{path.name}: not there; the shipped animal takes its place")
    return replace(gecko(), interior=interior, planes_mm=radius)


def gecko() -> Model:
    """The shipped scene of that name."""
    run = Run(StageCache(1 << 30), gallery.scene("gecko"), None, None, None)
    interior = from_stack(run.stack.value)
    radius = plane_radius(float(interior.sigma_t[..., 0, :].amin()))
    target, direction = torch.tensor([-4.0, 8.5, 4.0]), torch.tensor([-0.95, 0.22, -0.12])
    return Model(run.mesh.value[0], interior, radius, target, direction, math.radians(2.6))


def close_up(
    model: Model, occluder: Occluder, width: int = 800, height: int = 600
) -> tuple[Points, torch.Tensor, int]:
    """Camera hits, the eye, and how many of the pixels hit; misses take the place of their neighbours."""
    centre = model.target
    eye = centre + unit(model.direction) * 2 * LENGTH_MM
    forward = unit(centre - eye)
    right = unit(torch.linalg.cross(forward, torch.tensor([0.0, 1.0, 0.0])))
    up = torch.linalg.cross(right, forward)
    y, x = torch.meshgrid(
        (torch.arange(height) + 0.5) / height, (torch.arange(width) + 0.5) / width, indexing="ij"
    )
    half = math.tan(model.half)
    direction = unit(
        forward
        + ((2 * x - 1) * half * width / height)[..., None] * right
        + ((1 - 2 * y) * half)[..., None] * up
    ).reshape(-1, 3)
    face, bary, _ = occluder.closest(eye.expand_as(direction), direction)
    hit = face >= 0
    nearest = torch.cummax(torch.where(hit, torch.arange(len(face)), 0), 0).values
    rows = torch.where(hit[nearest], nearest, hit.nonzero()[0, 0])
    return Points(face[rows].int(), bary[rows]), eye, int(hit.sum())


def three_lights(mesh: Mesh) -> list[Light]:
    """Front, beneath, behind."""
    size = LENGTH_MM
    return [
        PointLight(torch.tensor([2.0, 1.5, 1.0]) * size, [1.0, 1, 1]),
        PointLight(torch.tensor([0.5, -2.0, 0.5]) * size, [1.0, 1, 1]),
        PointLight(torch.tensor([-2.0, 0.5, -0.5]) * size, [1.0, 1, 1]),
    ]


class Prepared:
    """Rays and lights of all points, set up beforehand."""

    def __init__(
        self,
        points: Points,
        mesh: Mesh,
        planes: Planes,
        interior: Interior,
        lights: list[Light],
        eye: torch.Tensor,
    ):
        surface = Surface(mesh, planes, mesh.source_uv)
        probe = Gatherer(interior, "exact", 1, "schlick", False)
        sites = surface.at(points)
        rays = view_rays(sites, unit(eye - sites.position), interior.eta, probe.far, probe.size, None)
        seen = [
            light_scalars(
                sites, rays, li.sample(sites.position, sites.normal, sites.uv), interior.eta, probe.size
            )
            for li in lights
        ]
        self.ray, self.lights = rays.scalars, torch.stack(seen)

    def run(self, gather: Gatherer) -> torch.Tensor:
        """The march alone."""
        return gather(self.ray, self.lights)


def best(call, repeat: int) -> tuple[float, float]:
    """Seconds by the clock and of all processors, each the least of some calls."""
    clock, processors = [], []
    for _ in range(repeat):
        start = time.perf_counter(), time.process_time()
        call()
        clock.append(time.perf_counter() - start[0])
        processors.append(time.process_time() - start[1])
    return min(clock), min(processors)


def psnr(image: torch.Tensor, truth: torch.Tensor) -> float:
    """[dB], against the brightest value of the truth."""
    error = ((image.double() - truth.double()) ** 2).mean()
    return float(10 * torch.log10(truth.double().amax() ** 2 / error))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", choices=("fish", "gecko"), default="fish")
    parser.add_argument("--mesh", type=Path, default=FISH)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--samples", type=int, default=4000, help="of the uniform reference")
    parser.add_argument("--only", choices=("compiled", "eager"))
    args = parser.parse_args()
    model = fish(args.mesh) if args.model == "fish" else gecko()
    mesh = model.mesh
    interior = model.interior.to(mesh.vertices)
    start = time.perf_counter()
    planes = fit_planes(mesh, model.planes_mm)
    print(f"planes of {len(mesh.vertices)} vertices: {time.perf_counter() - start:.3f} s")
    points, eye, hits = close_up(model, Occluder(mesh))
    lights = three_lights(mesh)
    print(f"{args.model}: {len(points)} points, {hits} of them hits; {torch.get_num_threads()} threads")

    truth = None
    for fast in {None: [True, False], "compiled": [True], "eager": [False]}[args.only]:
        prepared = {n: Prepared(points, mesh, planes, interior, lights[:n], eye) for n in (1, 3)}
        for method, samples in [("exact", 4), ("uniform", 10), ("uniform", 50), ("uniform", 100)]:
            start = time.perf_counter()
            gather = Gatherer(interior, method, samples, "schlick", fast)
            first = prepared[1].run(gather)
            cold = time.perf_counter() - start
            alone = {
                n: best(lambda n=n, gather=gather, prepared=prepared: prepared[n].run(gather), args.repeat)
                for n in (1, 3)
            }
            if truth is None:
                truth = prepared[1].run(Gatherer(interior, "exact", 64, "schlick", fast))
                coarse = prepared[1].run(Gatherer(interior, "uniform", args.samples, "schlick", fast))
                print(f"64 exact steps against {args.samples} uniform samples: {psnr(truth, coarse):.1f} dB")

            def whole(n: int, method=method, samples=samples, fast=fast) -> torch.Tensor:
                return march(
                    points,
                    mesh,
                    planes,
                    interior,
                    lights[:n],
                    eye,
                    method=method,
                    samples=samples,
                    phase="schlick",
                    compiled=fast,
                )

            call = {n: best(lambda n=n: whole(n), max(1, args.repeat // 2)) for n in (1, 3)}
            print(
                f"{'compiled' if fast else 'eager':8} {method:7} {samples:3}: "
                + "; ".join(f"{n} lights {alone[n][0]:.3f} s ({alone[n][1]:.3f})" for n in (1, 3))
                + f"; whole call {call[1][0]:.2f} s, {call[3][0]:.2f} s; first call {cold:.1f} s; "
                f"{1 / alone[3][0]:.1f} fps, paper {PAPER_FPS[args.model].get(samples, '-')}; "
                f"{psnr(first, coarse):.1f} dB against {args.samples} samples, "
                f"{psnr(first, truth):.1f} dB against 64 exact",
                flush=True,
            )


if __name__ == "__main__":
    main()
