"""Surface diffusion against the all-pairs sum: error, jump across seams, seconds and memory, uv beside it.

python -m benchmarks.bench_surface [HEAD.obj] [--sizes 512 1024] [--shapes head-source head-xatlas sphere]

Two sums are the truth: over the texels themselves, and over those of an atlas up to four times as fine.
"""

import argparse
import math
import resource
import time
from bisect import bisect
from collections.abc import Callable
from pathlib import Path

import torch
import trimesh

from texsss.io.meshes import read_mesh
from texsss.numerics.sampling import bilinear
from texsss.surface.atlas import make_atlas
from texsss.surface.mesh import Mesh
from texsss.surface.points import TexelMaps
from texsss.surface.raster import rasterise
from texsss.transport.neighbours import pairs_within
from texsss.transport.operators import Operators, surface_operators
from texsss.transport.uv import diffuse_uv
from texsss.types import Float, Tensor

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "LeePerrySmith.obj"
HEAD_MM = 240.0
STD = torch.logspace(math.log10(0.2), 1, 8)  # mm
SAMPLES = 2000
FINER = 4, 2, 1  # times: where standard deviations are below 4, below 16 and above 16 texels
REACH = 6.0  # standard deviations in the reference
STRIPES_MM = 12.0
REPEATS = 7


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("head", nargs="?", type=Path, default=HEAD)
    parser.add_argument("--sizes", nargs="+", type=int, default=[512, 1024])
    parser.add_argument("--shapes", nargs="+", default=["head-source", "head-xatlas", "sphere"])
    parser.add_argument("--speed", action="store_true", help="seconds and memory only")
    arguments = parser.parse_args()
    print(f"threads: {torch.get_num_threads()}")
    for shape in arguments.shapes:
        if shape.startswith("head") and not arguments.head.is_file():
            print(f"{shape}: skipped, {arguments.head} is absent")
            continue
        for size in arguments.sizes:
            texels = atlas_of(shape, arguments.head, size)
            operators = timed(shape, texels)
            if not arguments.speed:
                compared(texels, operators)


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


def timed(shape: str, texels: TexelMaps) -> Operators:
    """The operators, their figures printed; seconds are the least of some, but for building."""
    light = lit(texels)
    begin, cpu = time.perf_counter(), time.process_time()
    operators = surface_operators(texels, STD**2)
    built, cpu = time.perf_counter() - begin, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    asking = light.clone().requires_grad_()
    applied, applying = least_seconds(lambda: operators.applied(light))
    gradient, both = least_seconds(lambda: operators.applied(asking).sum().backward())
    print(
        f"\n{shape} {texels.size[0]}²: {texels.covered_count:,} texels of {texels.texel_mm:.3f} mm; "
        f"built in {built:.1f} s ({cpu:.1f} s of processor), applied in {applied:.3f} s ({applying:.3f}), "
        f"with gradient {gradient:.3f} s ({both:.3f}), {operators.bytes / 1e6:.0f} MB, at most {peak:.1f} GB "
        "in all",
        flush=True,
    )
    return operators


def least_seconds(call: Callable[[], object]) -> tuple[float, float]:
    """The least of some: on the clock, and of the processor."""
    seconds, processor = [], []
    for _ in range(REPEATS):
        begin, cpu = time.perf_counter(), time.process_time()
        call()
        seconds.append(time.perf_counter() - begin)
        processor.append(time.process_time() - cpu)
    return min(seconds), min(processor)


def compared(texels: TexelMaps, operators: Operators) -> None:
    """Print errors, jumps and energy of every Gaussian."""
    light = lit(texels)
    surface, along_uv = operators.applied(light), diffuse_uv(light, texels, STD**2)
    sample = torch.multinomial(texels.area, SAMPLES, generator=torch.Generator().manual_seed(0))
    at = texels.points.position(texels.mesh)[sample]
    seams, own = seam_pairs(texels), samples_of(texels)
    finer = {1: own}
    print(f"lightmap's own jump {jump(texels, light, seams):.4f}\n")
    print(
        "| std mm | surface L2 | to finer sum | jump | energy | uv L2 | jump |\n|---|---|---|---|---|---|---|"
    )
    area = texels.area[:, None]
    for k, std in enumerate(STD.tolist()):
        times = FINER[bisect([4, 16], std / texels.texel_mm)]
        if times not in finer:
            size = texels.size[0] * times, texels.size[1] * times
            finer[times] = samples_of(rasterise(texels.mesh, texels.atlas_uv, size, gutter_texels=0))
        truth, exact = all_pairs(at, own, std), all_pairs(at, finer[times], std)
        compare = (surface[k], truth), (surface[k], exact), (along_uv[k], truth)
        errors = [float((b[sample].double() - e).norm() / e.norm()) for b, e in compare]
        energy = float(((surface[k] * area).sum(0) / (light * area).sum(0) - 1).abs().max())
        jumps = [jump(texels, b[k], seams) for b in (surface, along_uv)]
        print(
            f"| {std:.2f} | {errors[0]:.2%} | {errors[1]:.2%} | {jumps[0]:.4f} | {energy:.2%} "
            f"| {errors[2]:.2%} | {jumps[1]:.4f} |",
            flush=True,
        )
        finer = {kept: values for kept, values in finer.items() if kept in (1, times)}


def lit(texels: TexelMaps) -> Float[Tensor, "P 3"]:
    """Two lamps and, in one channel, stripes with edges of about a millimetre, all in 0..1."""
    position, normal = texels.points.position(texels.mesh), texels.points.normal(texels.mesh)
    lamps = torch.nn.functional.normalize(torch.tensor([[0.4, 0.3, 0.86], [-0.8, 0.5, 0.2]]), dim=1)
    first, second = (normal @ lamps.T).clamp_min(0).unbind(1)
    stripes = torch.sigmoid(8 * torch.sin(position * (2 * math.pi / STRIPES_MM)).sum(1))
    return torch.stack([first, 0.7 * second + 0.2 * first, first * stripes], 1)


def samples_of(texels: TexelMaps) -> tuple[Tensor, Tensor, Tensor]:
    """Place, area and light of the texels that have an area."""
    real = torch.nonzero(texels.area > 0)[:, 0]
    return texels.points.position(texels.mesh)[real], texels.area[real].double(), lit(texels)[real].double()


def all_pairs(
    at: Float[Tensor, "Q 3"], samples: tuple[Tensor, Tensor, Tensor], std: float
) -> Float[Tensor, "Q 3"]:
    """Σ_j G E_j A_j / Σ_j G A_j over all samples within reach of `at`, in float64."""
    place, area, light = samples
    result = light.new_empty(len(at), 3)
    for pairs in pairs_within(at, place, REACH * std):
        weight = torch.exp(pairs.squared.double() / (-2 * std**2)) * area[pairs.column.long()]
        sums = light.new_zeros(len(pairs.count), 4)
        held = torch.cat([weight[:, None] * light[pairs.column.long()], weight[:, None]], 1)
        sums.index_add_(0, pairs.row.long(), held)
        result[pairs.block] = sums[:, :3] / sums[:, 3:]
    return result


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
