"""A tail that bends over 24 frames: the texels and what carries light between them are kept, the rest redone.

    python examples/swimming_axolotl.py [swimming.webp]

Atlas, raster, weights and operators of diffusion belong to the rest pose and stay; positions, normals,
shadows, light, its bank and the picture are made for every frame. The last line says what the kept
operators cost: the difference to ones that are made anew for the pose that bends most.
"""

import math
import sys
import time
from collections import defaultdict
from pathlib import Path

import torch
from PIL import Image

from texsss import Baker, Scene, preset
from texsss.light.irradiance import irradiance
from texsss.light.visibility import Occluder
from texsss.look import seer, shower
from texsss.placing import background, camera, lights
from texsss.surface.mesh import Mesh
from texsss.surface.points import TexelMaps
from texsss.transport.bank import Bank, exitance
from texsss.transport.operators import Operators, surface_operators
from texsss.view.picture import picture

FRAMES, SIZE, RESOLUTION = 24, 512, [640, 360]
SWING_MM = 20.0


def bent(rest: torch.Tensor, phase: float) -> torch.Tensor:
    """Vertices (V, 3) [mm] with a wave that runs down the body and grows towards the tail."""
    head, tail = float(rest[:, 2].max()), float(rest[:, 2].min())
    along = ((head - 70.0 - rest[:, 2]) / (head - 70.0 - tail)).clamp_min(0)
    moved = rest.clone()
    moved[:, 0] += SWING_MM * along**2 * torch.sin(phase - 2.8 * along)
    return moved


def every_pose(rest: Mesh) -> Mesh:
    """The poses that bend most, as one mesh: what the camera is to see."""
    poses = [bent(rest.vertices, math.pi * k / 2) for k in range(4)]
    faces = [rest.faces + k * len(rest.vertices) for k in range(4)]
    return Mesh(torch.cat(poses), torch.cat(faces))


class Film:
    """What stays from frame to frame, and the seconds of every step."""

    def __init__(self, scene: Scene):
        self.scene, self.seconds = scene, defaultdict(float)
        baker = Baker()
        baked = baker.bake(scene)
        self.rest, self.weights, self.display = baked.texels, baked.weights, baker.display
        self.lights = lights(scene, self.rest.mesh, {})
        self.camera = camera(scene.camera, every_pose(self.rest.mesh))
        self.images = {"albedo": baker.map(scene, "albedo")}
        self.eta = preset("skin1").eta
        start = time.perf_counter()
        self.operators = surface_operators(self.rest, self.weights.variances)
        print(f"operators of the rest pose: {time.perf_counter() - start:.1f} s, once")

    def scattered(self, texels: TexelMaps, occluder: Occluder, operators: Operators) -> torch.Tensor:
        """Exitance (P, 3) before the albedo."""
        start = time.perf_counter()
        light = irradiance(texels.points, texels.mesh, self.lights, eta=self.eta, occluder=occluder)
        self.seconds["light"] += time.perf_counter() - start
        start = time.perf_counter()
        bank = Bank(self.weights.variances, light, operators.applied(light))
        left = exitance(bank, self.weights)
        self.seconds["bank"] += time.perf_counter() - start
        return left

    def frame(self, phase: float) -> Image.Image:
        """The picture of one pose."""
        start = time.perf_counter()
        texels = self.rest.moved(bent(self.rest.mesh.vertices, phase))
        occluder = Occluder(texels.mesh)
        self.seconds["pose"] += time.perf_counter() - start
        left = self.scattered(texels, occluder, self.operators)
        start = time.perf_counter()
        surface = self.scene.material.surface
        see = seer(surface, self.images, texels.mesh, self.lights, eta=self.eta, occluder=occluder, seed=0)
        show = shower(texels.to_image(left), texels.atlas_uv)
        look = {"samples": self.scene.camera.samples, "background": background(self.scene)}
        seen = picture(self.camera, occluder, lambda hits: show(see(hits)), **look)
        self.seconds["picture"] += time.perf_counter() - start
        shown = self.display(self.scene, seen[..., :3]).clamp(0, 1)
        return Image.fromarray((shown * 255).round().to(torch.uint8).numpy())


def main() -> None:
    film = Film(Scene.parse({"atlas": {"size": SIZE}, "camera": {"resolution": RESOLUTION}}))
    frames = [film.frame(2 * math.pi * k / FRAMES) for k in range(FRAMES)]
    steps = "  ".join(f"{name} {total / FRAMES:.2f}" for name, total in film.seconds.items())
    print(f"seconds a frame: {steps}")
    texels = film.rest.moved(bent(film.rest.mesh.vertices, math.pi / 2))
    occluder = Occluder(texels.mesh)
    kept = film.scattered(texels, occluder, film.operators)
    anew = film.scattered(texels, occluder, surface_operators(texels, film.weights.variances))
    print(f"operators kept against made anew: {float((kept - anew).norm() / anew.norm()):.2%} RMS")
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "swimming.webp")
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=60, loop=0, quality=80)
    print(out)


if __name__ == "__main__":
    main()
