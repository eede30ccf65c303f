"""Noise and time of sampled lights against their number of samples, on the LeePerrySmith head.

    python benchmarks/bench_lights.py [--mesh FILE.obj] [--points 20000]

Noise is the root mean square error over the mean, against 1024 samples of the same light with nothing
shared. The last lines time the texels of a 512² atlas under an environment at 256 samples, as the bake
does it, and compare every 50th of them with 1024 samples of its own.
"""

import argparse
import time
from pathlib import Path

import torch

from texsss.io.meshes import read_mesh
from texsss.light.areas import RectangleLight, SphereLight
from texsss.light.emitters import ConstantEnvironment, Light
from texsss.light.environment import ImageEnvironment
from texsss.light.irradiance import irradiance, irradiance_at
from texsss.light.sites import sites_at
from texsss.light.visibility import Occluder
from texsss.surface.atlas import make_atlas
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.surface.raster import rasterise
from texsss.types import Float, Tensor

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "LeePerrySmith.obj"


def scattered(mesh: Mesh, count: int) -> Points:
    """Points spread evenly over the surface."""
    generator = torch.Generator().manual_seed(0)
    face = torch.multinomial(mesh.face_area, count, replacement=True, generator=generator).sort().values
    bary = torch.rand(count, 3, generator=generator) + 1e-3
    return Points(face, bary / bary.sum(-1, keepdim=True))


def lights() -> dict[str, Light]:
    """One of each kind, for a head at the origin."""
    sunny = torch.full((64, 128, 3), 0.2)
    sunny[12, 80] = 300.0
    return {
        "panel": RectangleLight((300, 300, 500), (200, 0, 0), (0, -150, -150), (10, 10, 10)),
        "ball": SphereLight((-300, 300, 500), 60.0, (30, 30, 30)),
        "constant": ConstantEnvironment((1, 1, 1)),
        "panorama": ImageEnvironment(sunny),
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--mesh", type=Path, default=HEAD)
    parser.add_argument("--points", type=int, default=20_000)
    arguments = parser.parse_args()
    mesh, _ = read_mesh(arguments.mesh)
    occluder, points = Occluder(mesh), scattered(mesh, arguments.points)

    def lit(light: Light, count: int, sharing: int, where: Points = points) -> Float[Tensor, "P 3"]:
        return irradiance(
            where, mesh, [light], eta=1.4, occluder=occluder,
            environment_samples=count, area_samples=count, sharing=sharing, seed=count,
        )  # fmt: skip

    print(f"{'light':10} {'samples':>8} {'alone':>8} {'shared':>8} {'seconds':>8}")
    for name, light in lights().items():
        truth = lit(light, 1024, 1)[:, 0]
        for count in (16, 64, 256):
            start = time.perf_counter()
            alone = lit(light, count, 1)[:, 0]
            seconds = time.perf_counter() - start
            shared = lit(light, count, 16)[:, 0]
            noise = [float((e - truth).square().mean().sqrt() / truth.mean()) for e in (alone, shared)]
            print(f"{name:10} {count:8} {noise[0]:8.2%} {noise[1]:8.2%} {seconds:8.2f}", flush=True)
    texels = rasterise(mesh, make_atlas(mesh, size=512).uv, (512, 512)).points
    sites, some = sites_at(texels, mesh), slice(None, None, 50)
    for name in ("constant", "panorama"):
        start = time.perf_counter()
        baked = irradiance_at(sites, [lights()[name]], eta=1.4, occluder=occluder, environment_samples=256)
        seconds = time.perf_counter() - start
        truth = lit(lights()[name], 1024, 1, texels[some])
        noise = float((baked[some] - truth).square().mean().sqrt() / truth.mean())
        print(f"512², {name}, 256 samples, shared by 16: {seconds:.1f} s, noise {noise:.2%}", flush=True)


if __name__ == "__main__":
    main()
