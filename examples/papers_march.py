"""What François et al. 2006 and Norberg 2010 show of the layered march, on our own animal.

    python examples/papers_march.py [FOLDER] [polygon lights samples coarse gecko veins fat]

One sheet per figure; `docs/papers.md` tells what to see in each. Errors and seconds are printed.
"""

import sys
import tempfile
import time
from pathlib import Path

import torch
from decimate import decimated
from paper_views import FLANK, HEAD, SIZE, Figures, Picture, close_up, parts, variant

from texsss import Scene, gallery
from texsss.io.sheet import difference_map
from texsss.light.emitters import PointLight
from texsss.light.visibility import Occluder
from texsss.media.medium import Medium
from texsss.placing import camera as placed
from texsss.surface.mesh import Mesh
from texsss.transport.march.interior import from_depths
from texsss.transport.march.march import march
from texsss.types import Float, Tensor
from texsss.view.camera import Camera, Hits
from texsss.view.picture import picture
from texsss.view.tonemap import tonemap

FISH = ("fish-dermis", "fish-blood", "fish-organs")
STEPS = 16  # on the polygon: veins are thinner there than 4 steps of a slanted ray, which show them twice
EXACT, LITTLE = 128, 0.3  # steps of the truth; cosine below which a pixel is grazing


def layers(name: str) -> list[dict]:
    """The layers of a shipped scene."""
    return parts(name)["material"]["layers"]


def brighter(lamp: dict, gain: float) -> dict:
    return lamp | {"intensity_w_per_sr": [gain * watts for watts in lamp["intensity_w_per_sr"]]}


class Marched(Figures):
    def polygon(self) -> None:
        """François, figure 4: veins beneath a flat polygon."""
        depth = vein_depths(512)
        corners = torch.tensor([[-10.0, 0, 10], [10, 0, 10], [10, 0, -10], [-10, 0, -10]])
        faces, uv = torch.tensor([[0, 1, 2], [0, 2, 3]]), torch.tensor([[0.0, 1], [1, 1], [1, 0], [0, 0]])
        mesh = Mesh(corners, faces, uv[faces])
        named = [MEDIA[name] for name in ("skin", "blood", "flesh")]
        media = [Medium(m["sigma_a_per_mm"], m["sigma_s_per_mm"], 0.0, m["eta"]) for m in named]
        interior = from_depths(depth, media)
        lights = [PointLight([-22.0, 18.0, -14.0], [1.1e-2, 1.05e-2, 1.0e-2])]

        def shader(hits: Hits) -> Tensor:
            return march(hits.points, mesh, None, interior, lights, hits.view, samples=STEPS)

        row = [("Depth of the veins", "grey 0.2 mm, white 1.1 mm", shown_depth(depth))]
        for title, eye in (
            ("From above", (0.0, 45.0, 0.1)),
            ("From 45°", (0.0, 30.0, 30.0)),
            ("From 70°", (0.0, 13.0, 36.0)),
        ):
            camera = Camera(eye, (0.0, 0.0, 0.0), fov_y=0.32, resolution=(SIZE[0], SIZE[1]))
            image = picture(camera, Occluder(mesh), shader, background=(0.02, 0.022, 0.026))[..., :3]
            row.append(
                (title, f"two triangles, {STEPS} exact steps", tonemap(image, exposure_ev=1.0, name="aces"))
            )
        self.write("papers-polygon", [row], 4)

    def lights(self) -> None:
        """François, figure 13: in front, beneath, behind, and all three."""
        lamps = parts("fish-organs")["lights"]
        camera = {"direction": [-0.95, 0.22, -0.12], "fov_y_deg": 18.0, "resolution": [780, 400]}
        row = []
        for title, on, gain in (
            ("In front", [0], 2),
            ("Beneath", [1], 2),
            ("Behind", [2], 2),
            ("All three", [0, 1, 2], 1),
        ):
            lit = [brighter(lamps[i], gain) for i in on]
            note = "twice as bright" if gain > 1 else "as shipped"
            row.append((title, note, self.whole(variant("fish-organs", lights=lit, camera=camera))))
        self.write("papers-lights", [row], 2)

    def samples(self) -> None:
        """François, figure 14: the fish by 10, 50, 100 samples, and by 4 exact steps."""
        published = [layer | {"medium": name} for layer, name in zip(layers("fish-organs"), FISH)]
        material = {"layers": published}

        def scene(method: str, count: int) -> Scene:
            methods = {"diffusion": "none", "single_scattering": method, "march_samples": count}
            camera = close_up(FLANK, 0.3, samples=1)
            return variant("fish-organs", material=material, methods=methods, camera=camera)

        truth = self.once(scene("exact", EXACT))
        facing = self.facing(scene("exact", 1))
        seen = facing > 0
        mean, gain = truth[seen].mean(), 0.42 / float(torch.quantile(truth[seen], 0.95))
        rows, found = [[], []], {}
        for method, count in (("uniform", 10), ("uniform", 50), ("uniform", 100), ("exact", 4)):
            start = time.perf_counter()
            image = found[count] = self.once(scene(method, count))
            seconds = time.perf_counter() - start
            gap = image - truth
            rms = float(gap[seen].square().mean().sqrt() / mean)
            title = f"{count} {'samples' if method == 'uniform' else 'exact steps'}"
            rows[0].append((title, "three lights", tonemap(image * gain, name="aces")))
            note = f"RMSE {rms:.1%} of the mean" if rms < 0.1 else f"RMSE {rms:.0%} of the mean"
            rows[1].append(("Error", note, difference_map(gap * seen[..., None] / mean, 1.0)))
            print(f"{title}: RMSE {rms:.2%}, {seconds:.2f} s", flush=True)
        change = (found[50] - found[100]).abs().mean(-1) / mean
        for name, where in (("facing", facing > 0.7), ("grazing", seen & (facing < LITTLE))):
            print(f"50 against 100 samples, {name}: {float(change[where].mean()):.1%} of the mean")
        self.write("papers-samples", rows, 4)

    def facing(self, scene: Scene) -> Float[Tensor, "H W"]:
        """Cosine between surface and view per pixel, 0 where there is nothing."""
        mesh = self.mesh(scene)
        shader = lambda hits: (hits.points.normal(mesh) * hits.view).sum(-1, keepdim=True).expand(-1, 3)  # noqa: E731
        return picture(placed(scene.camera, mesh), Occluder(mesh), shader, samples=1)[..., 0]

    def mesh(self, scene: Scene) -> Mesh:
        draft = scene.model_dump(mode="json", exclude_none=True)
        draft |= {"atlas": {"size": 64}, "methods": {"diffusion": "none"}}
        return self.baker.bake(Scene.parse(draft)).texels.mesh

    def coarse(self) -> None:
        """François, figures 11, 15, 16: a close-up of a mesh of few triangles."""
        fine = self.mesh(gallery.scene("fish-organs"))
        coarse = decimated(fine, 2788)
        rows = [[], []]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "coarse.obj"
            file.write_text(obj(coarse))
            sources = {fine: {"source": {"builtin": "axolotl/axolotl.obj"}, "unit_mm": 0.3}}
            sources[coarse] = {"source": str(file), "unit_mm": 1.0}
            for mesh, source in sources.items():
                name = f"{len(mesh.faces):,} triangles"
                for row, where in zip(rows, (FLANK, HEAD)):
                    scene = variant("fish-organs", mesh=source, camera=close_up(where, 0.3))
                    row += [(name, "", wires(mesh, scene)), (name, "as seen", self.whole(scene))]
        self.write("papers-coarse", rows, 4)

    def gecko(self) -> None:
        """François, figure 17: bumpy skin, more or less visible with the view."""
        whole = {"direction": [-0.6, 0.5, 0.7], "fov_y_deg": 18.0, "resolution": SIZE}
        head = {"target": [4.0, 30.0, 78.0], "height": 48.0}
        above, low = head | {"direction": [-0.35, 1.0, 0.3]}, head | {"direction": [-0.5, 0.22, 1.0]}
        _, *below = layers("gecko")
        surface = {"roughness": 0.3}
        even = {"layers": [{"medium": "horn", "thickness_mm": 0.17}, *below], "surface": surface}
        row = [("Our gecko", "20,000 vertices", self.whole(variant("gecko", camera=whole)))]
        for title, note, where, more in (
            ("The head from above", "scales up to 0.35 mm of horn", above, {}),
            ("The head at a slant", "the same scales", low, {}),
            ("From above, no scales", "0.17 mm of horn everywhere", above, {"material": even}),
        ):
            row.append((title, note, self.whole(variant("gecko", camera=close_up(where, 0.5), **more))))
        self.write("papers-gecko", [row], 4)

    def veins(self) -> None:
        """François, figure 18: veins beneath the skin of a head."""
        rows = []
        for title, note, where in (
            ("Veins beneath the skin", "of a head", HEAD),
            ("From the front", "", HEAD | {"direction": [0.1, 0.25, 1.0], "height": 60.0}),
            ("Behind the shoulder", "", FLANK | {"target": [-10.0, 20.0, -14.0], "height": 44.0}),
        ):
            scene = self.beneath(
                [SKIN, VEINS, FLESH], where, methods={"diffusion": "surface", "single_scattering": "exact"}
            )
            rows.append((title, note, self.whole(scene)))
        once = self.once(self.beneath([SKIN, VEINS, FLESH], HEAD))
        rows.append(
            ("The head again", "scattered once alone, four times as bright", tonemap(4 * once, name="aces"))
        )
        self.write("papers-veins", [rows], 4)

    def fat(self) -> None:
        """Norberg, figures 16 to 18: samples, fat alone, noise."""

        def panel(stack: list[dict], count: int, note: str = "", **how) -> tuple:
            methods = {
                "diffusion": "none",
                "single_scattering": "uniform",
                "march_samples": count,
                "march": how,
            }
            image = self.once(self.beneath(stack, HEAD, methods=methods, samples=1))
            print(f"{count} samples {note} {how}", flush=True)
            return f"{count} samples", note, tonemap(3.5 * image, name="aces")

        every, alone = [FAT, VEINS, FLESH], [FAT]
        rows = [
            [panel(every, n, "fat, veins, flesh") for n in (15, 25, 35, 100)],
            [panel(alone, n, "the fat alone") for n in (15, 50, 100)],
            [panel(every, 40), panel(every, 40, "starts shifted by noise", noise=1.0)],
            [],
        ]
        exact = {"diffusion": "none", "single_scattering": "exact", "march_samples": 4}
        for stack, row in ((alone, rows[1]), (every, rows[2])):
            image = self.once(self.beneath(stack, HEAD, methods=exact, samples=1))
            row.append(("4 exact steps", "no samples to see", tonemap(3.5 * image, name="aces")))
        rows[2].append(panel(every, 40, "uv shifted by noise", noise_uv=0.0008))
        self.write("papers-fat", rows, 4)

    def beneath(self, stack: list[dict], where: dict, methods: dict | None = None, samples: int = 9) -> Scene:
        """The head with layers of its own: fat, veins, flesh."""
        builtin = {"veins": "axolotl/veins.png", "fat": "scenes/tones.png"}
        maps = {name: {"source": {"builtin": file}} for name, file in builtin.items()}
        named = sorted({layer["medium"] for layer in stack})
        return variant(
            "fish-organs",
            maps=maps,
            media={name: MEDIA[name] for name in named},
            material={"layers": stack, "surface": {"roughness": 0.35}},
            methods=methods or {"diffusion": "none", "single_scattering": "exact"},
            lights=[{"type": "studio", "intensity": 2.0}],
            camera=close_up(where, 0.3, samples=samples),
        )


def coefficients(sigma_a: list[float], sigma_s: list[float]) -> dict:
    return {"sigma_a_per_mm": sigma_a, "sigma_s_per_mm": sigma_s, "eta": 1.4}


MEDIA = {
    "skin": coefficients([0.03, 0.14, 0.30], [0.9, 0.9, 0.9]),
    "blood": coefficients([1.2, 4.0, 3.2], [2.0, 1.2, 1.6]),
    "flesh": coefficients([0.10, 0.55, 0.70], [2.4, 2.2, 2.0]),
    "tallow": coefficients([0.03, 0.16, 1.60], [1.6, 1.6, 1.6]),
}
SKIN = {"medium": "skin", "thickness_mm": 0.15}
FAT = {"medium": "tallow", "thickness_mm": {"map": "fat", "range": [0.0, 1.4]}}
VEINS = {"medium": "blood", "thickness_mm": {"map": "veins", "range": [0.0, 0.5]}}
FLESH = {"medium": "flesh"}


def vein_depths(size: int, seed: int = 3) -> Float[Tensor, "H W 2"]:
    """Depths (size, size, 2) [mm] that tile: a thin skin, and veins in ridges of smooth noise."""
    generator = torch.Generator().manual_seed(seed)
    s = torch.fft.fftfreq(size, 1 / size)
    radius = torch.hypot(s[:, None], s[None])
    ridge = torch.zeros(size, size)
    for frequency, width, depth in ((3.0, 0.16, 1.0), (7.0, 0.10, 0.6)):
        white = torch.fft.fft2(torch.randn(size, size, generator=generator))
        smooth = torch.fft.ifft2(white * torch.exp(-((radius / frequency) ** 2))).real
        ridge = torch.maximum(ridge, depth * torch.exp(-((smooth / smooth.std() / width) ** 2)))
    skin = torch.full((size, size), 0.2)
    return torch.stack([skin, skin + 0.9 * ridge], -1)


def shown_depth(depth: Float[Tensor, "H W 2"]) -> Picture:
    """The second boundary in grey, cut to the shape of a panel."""
    grey = torch.nn.functional.interpolate(depth[None, None, ..., 1], size=(SIZE[0], SIZE[0]), mode="area")[
        0, 0
    ]
    return (grey[: SIZE[1], :, None] / 1.1).expand(-1, -1, 3)


def wires(mesh: Mesh, scene: Scene) -> Picture:
    """The triangles, flat and outlined."""
    edges = torch.linalg.vector_norm(mesh.corners.roll(1, 1) - mesh.corners.roll(2, 1), dim=-1)
    heights = 2 * mesh.face_area[:, None] / edges.clamp_min(1e-9)

    def shader(hits: Hits) -> Tensor:
        face = hits.points.face.long()
        facing = (mesh.face_normals[face] * hits.view).sum(-1).clamp(0, 1)
        line = (hits.points.bary * heights[face]).amin(-1) < 0.02
        return (0.06 + 0.5 * facing * torch.where(line, 0.12, 1.0))[:, None].expand(-1, 3)

    return picture(placed(scene.camera, mesh), Occluder(mesh), shader, background=(0.05, 0.055, 0.065))[
        ..., :3
    ].sqrt()


def obj(mesh: Mesh) -> str:
    """The mesh with its texture coordinates as a Wavefront file."""
    assert mesh.source_uv is not None
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vt {u:.7f} {1 - v:.7f}" for u, v in mesh.source_uv.reshape(-1, 2).tolist()]
    for k, corners in enumerate(mesh.faces.tolist()):
        lines.append("f " + " ".join(f"{v + 1}/{3 * k + i + 1}" for i, v in enumerate(corners)))
    return "\n".join(lines) + "\n"


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    figures = Marched(folder)
    for name in sys.argv[2:] or ("polygon", "lights", "samples", "coarse", "gecko", "veins", "fat"):
        getattr(figures, name)()


if __name__ == "__main__":
    main()
