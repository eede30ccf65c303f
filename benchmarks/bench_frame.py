"""Seconds of a deformed frame: a new pose in the texels of the old one, its planes, light, bank and march.

    python -m benchmarks frame [--size 512] [--repeat 5]

The axolotl bends its tail; one lamp with shadows, skin1. Atlas, raster, weights and operators stay those of
the rest pose. The march is that of every texel towards one eye, in four exact steps.
"""

from texsss import openmp  # noqa: F401, I001  before torch

import argparse
import math
import time
from collections import defaultdict
from itertools import pairwise

import torch

from texsss import Baker, Scene
from texsss.light.emitters import PointLight
from texsss.light.irradiance import irradiance
from texsss.light.visibility import Occluder
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.transport.bank import Bank, exitance
from texsss.transport.march.interior import from_stack
from texsss.transport.march.march import fitted_planes, march, planes_radius
from texsss.transport.operators import surface_operators

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
    scene = {"mesh": {"source": {"builtin": "axolotl/axolotl.obj"}}, "atlas": {"size": args.size}}
    baked = Baker().bake(Scene.parse(scene))
    rest, weights = baked.texels, baked.weights
    operators = surface_operators(rest, weights.variances)
    skin = preset("skin1")
    interior = from_stack(Stack([Layer(skin)]))
    lights = [PointLight(torch.tensor([100.0, 150.0, 200.0]), [0.1] * 3)]
    eye = torch.tensor([150.0, 60.0, 150.0])
    print(f"{len(rest.points)} texels of {args.size}², {len(rest.mesh.vertices)} vertices")
    seen: dict[str, list[float]] = defaultdict(list)
    for k in range(args.repeat + 1):
        marks = [("", time.perf_counter())]

        def done(step: str, marks: list = marks) -> None:
            marks.append((step, time.perf_counter()))

        texels = rest.moved(bent(rest.mesh.vertices, 2 * math.pi * k / args.repeat))
        done("positions")
        planes = fitted_planes(texels.mesh, planes_radius(interior))
        done("planes")
        occluder = Occluder(texels.mesh)
        light = irradiance(texels.points, texels.mesh, lights, eta=skin.eta, occluder=occluder)
        done("light")
        exitance(Bank(weights.variances, light, operators.applied(light)), weights)
        done("bank")
        march(texels.points, texels.mesh, planes, interior, lights, eye, occluder=occluder, compiled=True)
        done("march")
        for (_, before), (step, after) in pairwise(marks):
            seen[step].append(after - before)
        seen["frame"].append(marks[-1][1] - marks[0][1])
    for step, seconds in seen.items():
        print(f"{step:10} {min(seconds[1:]):.3f} s")  # the first may build the loop


if __name__ == "__main__":
    main()
