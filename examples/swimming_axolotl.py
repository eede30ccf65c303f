"""A tail that bends over 24 frames: the texels and what carries light between them are kept, the rest redone.

    python examples/swimming_axolotl.py [swimming.webp]

Atlas, raster, weights and operators of diffusion belong to the rest pose and stay; positions, normals,
planes, shadows, light, its bank, and the picture with its march are made for every frame. The last lines
say what kept operators cost: the difference to ones made anew for the pose that bends most, and what
making them takes.
"""

from texsss import openmp  # noqa: F401, I001  before torch

import math
import sys
from collections import defaultdict
from pathlib import Path

import torch
from PIL import Image

from texsss import Baker, Pose, Scene

FRAMES, SIZE, RESOLUTION = 24, 512, [640, 360]
SWING_MM = 20.0
# around all that the tail sweeps: a fitted camera would look at the rest pose alone
CAMERA = {"position_mm": [302.2, 182.3, 300.5], "target_mm": [-35.0, -13.4, -80.2], "fov_y_deg": 18.0}


def bent(rest: torch.Tensor, phase: float) -> torch.Tensor:
    """Vertices (V, 3) [mm] with a wave that runs down the body and grows towards the tail."""
    head, tail = float(rest[:, 2].max()), float(rest[:, 2].min())
    along = ((head - 70.0 - rest[:, 2]) / (head - 70.0 - tail)).clamp_min(0)
    moved = rest.clone()
    moved[:, 0] += SWING_MM * along**2 * torch.sin(phase - 2.8 * along)
    return moved


def main() -> None:
    methods = {"single_scattering": "exact"}
    scene = Scene.parse(
        {"atlas": {"size": SIZE}, "camera": CAMERA | {"resolution": RESOLUTION}, "methods": methods}
    )
    baker = Baker()
    rest = baker.mesh(scene).vertices
    once = baker.bake(scene).report["seconds"]
    print("rest pose, once: " + "  ".join(f"{name} {took:.2f}" for name, took in once.items()))
    frames, seconds = [], defaultdict(float)
    for k in range(FRAMES):
        baked = baker.bake(scene, pose=Pose(bent(rest, 2 * math.pi * k / FRAMES)))
        shown = baker.display(scene, baked.picture).clamp(0, 1)
        frames.append(Image.fromarray((shown * 255).round().to(torch.uint8).numpy()))
        if k:  # the first also makes what stays
            for name, took in baked.report["seconds"].items():
                seconds[name] += took / (FRAMES - 1)
    print("seconds a frame: " + "  ".join(f"{name} {took:.3f}" for name, took in seconds.items()))
    print(f"in all {sum(seconds.values()):.2f} s; results kept: {baker.cache.bytes_used / 2**20:.0f} MB")
    most = bent(rest, math.pi / 2)
    kept, anew = (baker.bake(scene, pose=Pose(most, operators=of)) for of in ("rest", "pose"))
    off = (kept.texel_exitance - anew.texel_exitance).norm() / anew.texel_exitance.norm()
    print(f"the pose that bends most stretches the surface by {kept.report['pose']['stretch']:.1%} (RMS)")
    print(f"operators kept against made anew: {float(off):.2%} RMS of exitance")
    print(f"operators made anew: {anew.report['seconds']['operators']:.2f} s")
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "swimming.webp")
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=60, loop=0, quality=80, method=6)
    print(out)


if __name__ == "__main__":
    main()
