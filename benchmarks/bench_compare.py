"""Bank against octree on a head: three materials under two lightings, three rules; where they differ.

python -m benchmarks compare, or python -m benchmarks.bench_compare [HEAD.obj] [--picture FILE.png]
"""

import argparse
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import torch

from benchmarks.differences import Panel, drawn
from texsss.baker import Baker
from texsss.io.images import write_png
from texsss.io.meshes import read_mesh
from texsss.result import Baked
from texsss.scene import Scene
from texsss.types import Float, Tensor

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "LeePerrySmith.obj"
HEAD_MM = 240.0
MATERIALS = {
    "skin1": [{"medium": "skin1"}],
    "marble": [{"medium": "marble"}],
    "painted": [
        {"medium": "skin1", "thickness_mm": {"map": "paint", "range": [0.2, 2]}},
        {"medium": "skin2"},
    ],
}
LIGHTS = {
    "one": [{"type": "directional", "direction": [0.5, 0.3, 0.8], "irradiance_w_per_m2": [1, 1, 1]}],
    "studio": [{"type": "studio"}],
}
RULES = ("exit", "entry", "geometric-mean")
TILES = 24  # blotches of paint across the square
SPACING_MM = 1.0  # of the samples, at about a texel's size


@dataclass(frozen=True)
class Head:
    """The head, its paint, and how it is laid out."""

    path: Path
    paint: Path
    unit_mm: float
    size: int

    def scene(self, material: str, light: str, **methods: object) -> Scene:
        return Scene.parse(
            {
                "mesh": {"source": str(self.path), "unit_mm": self.unit_mm},
                "atlas": {"uv": "source", "size": self.size},
                "maps": {"paint": {"source": str(self.paint), "channel": "r"}},
                "material": {"layers": MATERIALS[material]},
                "lights": LIGHTS[light],
                "methods": methods,
            }
        )

    def tree(self, material: str, light: str, *, normalise: bool, rule: str = "exit") -> Scene:
        octree = {"normalise": normalise, "spacing_mm": SPACING_MM}
        return self.scene(material, light, rule=rule, diffusion="octree", octree=octree)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("head", nargs="?", type=Path, default=HEAD)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--picture", type=Path, help="where to draw where they differ")
    parser.add_argument("--picture-only", action="store_true")
    arguments, _ = parser.parse_known_args()
    if not arguments.head.is_file():
        print(f"head: skipped, {arguments.head} is absent")
        return
    print(f"threads: {torch.get_num_threads()}")
    with tempfile.TemporaryDirectory() as folder:
        head = prepared(arguments.head, Path(folder), arguments.size)
        if arguments.picture is not None:
            pictured(head, arguments.picture)
        if not arguments.picture_only:
            table(head)
            rules(head)


def prepared(path: Path, folder: Path, size: int) -> Head:
    """The head at its height, and blotches of paint for its layers."""
    mesh = read_mesh(path, unit_mm=1.0)[0]
    i, j = torch.meshgrid(torch.arange(512), torch.arange(512), indexing="ij")
    wave = 2 * math.pi * TILES / 512
    paint = 0.5 + 0.5 * torch.sin(wave * i) * torch.sin(wave * j)
    write_png(folder / "paint.png", paint[..., None].expand(-1, -1, 3))
    return Head(path, folder / "paint.png", HEAD_MM / mesh.height_mm, size)


def table(head: Head) -> None:
    """Print relative RMS over the surface of bank against octree."""
    baker = Baker()
    print("\n| material | light | rule | octree | RMS | median | 95 % | mean |")
    print("|---|---|---|---|---|---|---|---|")
    for material in MATERIALS:
        for light in LIGHTS:
            for rule in RULES if material == "painted" else RULES[:1]:
                bank = baker.bake(head.scene(material, light, rule=rule))
                for normalise in (True, False):
                    tree = baker.bake(head.tree(material, light, normalise=normalise, rule=rule))
                    rms, median, most, mean = errors(bank, tree)
                    print(
                        f"| {material} | {light} | {rule} | {'normalised' if normalise else 'plain'} "
                        f"| {rms:.2%} | {median:.2%} | {most:.2%} | {mean:+.2%} |",
                        flush=True,
                    )


def rules(head: Head) -> None:
    """Print how far each rule of the bank is from each of the octree, where layers are painted."""
    baker = Baker()
    trees = {r: baker.bake(head.tree("painted", "studio", normalise=True, rule=r)) for r in RULES}
    print(f"\n| octree | {' | '.join(f'bank, {r}' for r in RULES)} | octree, exit |\n|---|---|---|---|---|")
    banks = [baker.bake(head.scene("painted", "studio", rule=r)) for r in RULES]
    for name, tree in trees.items():
        cells = [f"{errors(found, tree)[0]:.2%}" for found in (*banks, trees["exit"])]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def errors(bank: Baked, tree: Baked) -> tuple[float, float, float, float]:
    """Relative RMS by area; median and 95th percentile of the difference by the tree's RMS; of the mean."""
    area = bank.texels.area.double()
    area = area / area.sum()
    found, expected = (x.texel_exitance.double() for x in (bank, tree))
    size = (area @ expected.square()).mean().sqrt()
    off = (found - expected).square().mean(1)
    some = off.sqrt()[area > 0] / size
    mean = (area @ found).mean() / (area @ expected).mean() - 1
    return (
        float((area @ off).sqrt() / size),
        float(some.median()),
        float(some.kthvalue(int(0.95 * len(some))).values),
        float(mean),
    )


def pictured(head: Head, path: Path) -> None:
    """Draw where the bank differs from both octrees, on skin under the studio lights."""
    baker = Baker()
    bank = baker.bake(head.scene("skin1", "studio"))
    panels: list[Panel] = [("surface", "skin1, three lights", shown(bank))]
    for normalise, title in ((True, "octree, normalised"), (False, "octree, plain sum")):
        tree = baker.bake(head.tree("skin1", "studio", normalise=normalise))
        size = (bank.texels.area @ tree.texel_exitance.square()).mean() / bank.texels.area.sum()
        rms = errors(bank, tree)[0]
        off = (bank.texel_exitance - tree.texel_exitance) / float(size.sqrt())
        panels.append((f"surface - {title}", f"RMS {rms:.1%}", off))
    write_png(path, drawn(bank.texels, panels))


def shown(baked: Baked) -> Float[Tensor, "P 3"]:
    """Exitance as display values."""
    return baked.encode(2 * baked.texel_exitance / baked.texel_exitance.amax())


if __name__ == "__main__":
    main()
