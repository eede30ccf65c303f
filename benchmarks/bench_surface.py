"""Surface diffusion against the all-pairs sum: error, jump across seams, seconds and memory, uv beside it.

python benchmarks/bench_surface.py [HEAD.obj] [--sizes 512 1024] [--shapes head-source head-xatlas sphere]
"""

import argparse
import math
import time
from pathlib import Path

import torch
import trimesh

from texsss.io.meshes import read_mesh
from texsss.numerics.sampling import bilinear
from texsss.surface.atlas import make_atlas
from texsss.surface.mesh import Mesh
from texsss.surface.points import TexelMaps
from texsss.surface.raster import rasterise
from texsss.transport.operators import surface_operators
from texsss.transport.uv import diffuse_uv
from texsss.types import Float, Tensor

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "LeePerrySmith.obj"
HEAD_MM = 240.0
STD = torch.logspace(math.log10(0.2), 1, 8)  # mm
SAMPLES = 300
REACH = 6.0  # standard deviations in the reference
STRIPES_MM = 12.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("head", nargs="?", type=Path, default=HEAD)
    parser.add_argument("--sizes", nargs="+", type=int, default=[512, 1024])
    parser.add_argument("--shapes", nargs="+", default=["head-source", "head-xatlas", "sphere"])
    arguments = parser.parse_args()
    print(f"threads: {torch.get_num_threads()}")
    for shape in arguments.shapes:
        if shape.startswith("head") and not arguments.head.is_file():
            print(f"{shape}: skipped, {arguments.head} is absent")
            continue
        for size in arguments.sizes:
            measured(shape, atlas_of(shape, arguments.head, size))


def atlas_of(shape: str, path: Path, size: int) -> TexelMaps:
    """Texels of the head in the author's or our atlas, or of a sphere of 100 mm in ours."""
    if shape == "sphere":
        ball = trimesh.creation.icosphere(subdivisions=4, radius=100.0)
        mesh = Mesh(torch.tensor(ball.vertices).float(), torch.tensor(ball.faces))
    else:
        mesh = read_mesh(path, unit_mm=1.0)[0]
        mesh = mesh.moved(mesh.vertices * (HEAD_MM / mesh.height_mm))
    atlas = make_atlas(mesh, "source" if shape == "head-source" else "xatlas", size=size)
    return rasterise(mesh, atlas.uv, (size, size))


def measured(shape: str, texels: TexelMaps) -> None:
    """Print figures of one atlas; seconds are the least of three, but for building."""
    light = lit(texels)
    variances = STD**2
    begin, cpu = time.perf_counter(), time.process_time()
    operators = surface_operators(texels, variances)
    built, cpu = time.perf_counter() - begin, time.process_time() - cpu
    applied, gradient = [], []
    for _ in range(3):
        begin = time.perf_counter()
        operators.applied(light)
        applied.append(time.perf_counter() - begin)
    asking = light.clone().requires_grad_()
    for _ in range(3):  # the first one makes the transposes
        begin = time.perf_counter()
        operators.applied(asking).sum().backward()
        gradient.append(time.perf_counter() - begin)
    print(
        f"\n{shape} {texels.size[0]}²: {texels.covered_count:,} texels of {texels.texel_mm:.3f} mm; "
        f"built in {built:.1f} s ({cpu:.1f} s of processor), applied in {min(applied):.3f} s, with gradient "
        f"{min(gradient):.3f} s (first {gradient[0]:.1f} s), {operators.bytes / 1e6:.0f} MB"
    )
    surface, along_uv = operators.applied(light), diffuse_uv(light, texels, variances)
    sample = torch.multinomial(texels.area, SAMPLES, generator=torch.Generator().manual_seed(0))
    seams = seam_pairs(texels)
    print(f"lightmap's own jump {jump(texels, light, seams):.4f}\n")
    print("| std mm | surface L2 | jump | energy | uv L2 | jump |\n|---|---|---|---|---|---|")
    area = texels.area[:, None]
    for k, std in enumerate(STD.tolist()):
        expected = all_pairs(texels, light, sample, std)
        errors = [
            float((b[k][sample] - expected).norm() / expected.norm())
            for b in (surface.double(), along_uv.double())
        ]
        energy = float(((surface[k] * area).sum(0) / (light * area).sum(0) - 1).abs().max())
        jumps = [jump(texels, b[k], seams) for b in (surface, along_uv)]
        print(
            f"| {std:.2f} | {errors[0]:.2%} | {jumps[0]:.4f} | {energy:.2%} | {errors[1]:.2%} "
            f"| {jumps[1]:.4f} |",
            flush=True,
        )


def lit(texels: TexelMaps) -> Float[Tensor, "P 3"]:
    """Two lamps and, in one channel, stripes with edges of about a millimetre, all in 0..1."""
    position, normal = texels.points.position(texels.mesh), texels.points.normal(texels.mesh)
    lamps = torch.nn.functional.normalize(torch.tensor([[0.4, 0.3, 0.86], [-0.8, 0.5, 0.2]]), dim=1)
    first, second = (normal @ lamps.T).clamp_min(0).unbind(1)
    stripes = torch.sigmoid(8 * torch.sin(position * (2 * math.pi / STRIPES_MM)).sum(1))
    return torch.stack([first, 0.7 * second + 0.2 * first, first * stripes], 1)


def all_pairs(
    texels: TexelMaps, light: Float[Tensor, "P 3"], sample: Tensor, std: float
) -> Float[Tensor, "Q 3"]:
    """Σ_j G E_j A_j / Σ_j G A_j over all texels within reach, in float64."""
    position, area = texels.points.position(texels.mesh).double(), texels.area.double()
    result = []
    for at in position[sample]:
        near = torch.nonzero(((position - at).abs() < REACH * std).all(1))[:, 0]
        weight = torch.exp((position[near] - at).square().sum(1) / (-2 * std**2)) * area[near]
        result.append(weight @ light[near].double() / weight.sum())
    return torch.stack(result)


def seam_pairs(texels: TexelMaps) -> tuple[Tensor, Tensor]:
    """Both places in uv of the middles of edges that charts share."""
    faces = texels.mesh.faces
    edges = torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    uv = texels.atlas_uv
    middle = torch.cat([uv[:, [0, 1]].mean(1), uv[:, [1, 2]].mean(1), uv[:, [2, 0]].mean(1)])
    key = edges.amin(1) * texels.mesh.vertices.shape[0] + edges.amax(1)
    order = torch.argsort(key, stable=True)
    twins = torch.nonzero(key[order][1:] == key[order][:-1])[:, 0]
    first, second = middle[order[twins]], middle[order[twins + 1]]
    apart = (first - second).abs().amax(1) > 1e-4
    return first[apart], second[apart]


def jump(texels: TexelMaps, values: Float[Tensor, "P 3"], seams: tuple[Tensor, Tensor]) -> float:
    """95th percentile of the difference of bilinear look-ups on both sides of the seams."""
    if not len(seams[0]):
        return 0.0
    image = texels.to_image(values)
    first, second = (bilinear(image, side, "clamp") for side in seams)
    return float((first - second).abs().amax(1).quantile(0.95))


if __name__ == "__main__":
    main()
