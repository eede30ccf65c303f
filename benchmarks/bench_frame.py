"""Seconds of a deformed frame: a new pose in the texels of the old one, its planes, light, bank and march.

    python -m benchmarks frame [--size 512] [--repeat 5]

The axolotl bends its tail; one lamp with shadows, skin1. Atlas, raster, weights and operators stay those of
the rest pose: `Baker.bake(scene, pose=…)` makes the light. Pictures march their pixels; here every texel is
marched towards one eye, in four exact steps.
"""

from texsss import openmp  # noqa: F401, I001  before torch

import argparse
import math
import time
from collections import defaultdict

import torch

from texsss import Baker, Pose, Scene
from texsss.light.emitters import PointLight
from texsss.light.visibility import Occluder
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.transport.march.interior import from_stack
from texsss.transport.march.march import fitted_planes, march, planes_radius

LAMP = {"type": "point", "position_mm": [100.0, 150.0, 200.0], "intensity_w_per_sr": [0.1, 0.1, 0.1]}
STEPS = {
    "positions": ("pose", "texels", "sites"),
    "light": ("occluder", "light"),
    "bank": ("bank", "exitance"),
}
SWING_MM = 20.0


def bent(rest: torch.Tensor, phase: float) -> torch.Tensor:
    """Vertices (V, 3) [mm] of a tail that swings."""
    along = ((rest[:, 2].amax() - 70 - rest[:, 2]) / (rest[:, 2].amax() - 70 - rest[:, 2].amin())).clamp_min(
        0
    )
    return rest + SWING_MM * (along**2 * torch.sin(phase - 2.8 * along))[:, None] * torch.eye(3)[0]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--repeat", type=int, default=5)
    args = parser.parse_args()
    mesh = {"source": {"builtin": "axolotl/axolotl.obj"}}
    scene = Scene.parse({"mesh": mesh, "atlas": {"size": args.size}, "lights": [LAMP]})
    baker = Baker()
    baked, rest = baker.bake(scene), baker.mesh(scene).vertices
    interior = from_stack(Stack([Layer(preset("skin1"))]))
    lights = [PointLight(torch.tensor(LAMP["position_mm"]), LAMP["intensity_w_per_sr"])]
    eye = torch.tensor([150.0, 60.0, 150.0])
    print(f"{len(baked.texels)} texels of {args.size}², {len(rest)} vertices")
    seen: dict[str, list[float]] = defaultdict(list)
    for k in range(args.repeat + 1):
        start = time.perf_counter()
        baked = baker.bake(scene, pose=Pose(bent(rest, 2 * math.pi * k / args.repeat + 0.1)))
        done = time.perf_counter()
        texels, occluder = baked.texels, Occluder(baked.texels.mesh)
        fitting = time.perf_counter()
        planes = fitted_planes(texels.mesh, planes_radius(interior))
        fitted = time.perf_counter()
        march(texels.points, texels.mesh, planes, interior, lights, eye, occluder=occluder, compiled=True)
        marched = time.perf_counter()
        took = baked.report["seconds"]
        for step, stages in STEPS.items():
            seen[step].append(sum(took[stage] for stage in stages))
        seen["planes"].append(fitted - fitting)
        seen["march"].append(marched - fitted)
        seen["frame"].append(done - start + marched - fitting)
    for step, seconds in seen.items():
        print(f"{step:10} {min(seconds[1:]):.3f} s")  # the first may build the loop


if __name__ == "__main__":
    main()
