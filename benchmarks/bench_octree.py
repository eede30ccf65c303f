"""Hierarchical integration: seconds as samples grow, error to the sum over all pairs, texels of a head.

python -m benchmarks octree, or python benchmarks/bench_octree.py [HEAD.obj] [--counts 10 40 160 640]
"""

import argparse
import math
import time
from pathlib import Path

import torch
import trimesh

from texsss.io.meshes import read_mesh
from texsss.profiles.weights import Weights
from texsss.surface.atlas import make_atlas
from texsss.surface.mesh import Mesh
from texsss.surface.raster import rasterise
from texsss.transport.octree.exitance import Surface, emission
from texsss.transport.octree.samples import surface_samples
from texsss.types import Float, Tensor

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "LeePerrySmith.obj"
HEAD_MM = 240.0
STD = torch.logspace(math.log10(4), 1, 4)  # mm
PAIRS = 400  # receivers whose sum is taken over all samples


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("head", nargs="?", type=Path, default=HEAD)
    parser.add_argument("--counts", nargs="+", type=int, default=[10, 40, 160, 640], help="thousands")
    arguments, _ = parser.parse_known_args()
    print(f"threads: {torch.get_num_threads()}")
    growth([1000 * count for count in arguments.counts])
    errors()
    if arguments.head.is_file():
        texels(arguments.head)
    else:
        print(f"head: skipped, {arguments.head} is absent")


def growth(counts: list[int]) -> None:
    """As many receivers as samples, on a sphere: seconds ÷ (n log n) should stay."""
    print("\n| samples = receivers | tree s | sum s | µs per receiver | s / (n log₂ n) × 10⁶ | ratio |")
    print("|---|---|---|---|---|---|")
    before = None
    for wanted in counts:
        samples, area, spacing = lit(ball(), wanted)
        begin = time.perf_counter()
        sent = emission(samples, area, spacing)
        built = time.perf_counter() - begin
        begin = time.perf_counter()
        sent.exitance(samples)
        summed = time.perf_counter() - begin
        count, whole = len(area), built + summed
        per = whole / (count * math.log2(count)) * 1e6
        ratio = "" if before is None else f"{whole / before:.2f}"
        print(
            f"| {count:,} | {built:.2f} | {summed:.2f} | {summed / count * 1e6:.1f} | {per:.3f} | {ratio} |",
            flush=True,
        )
        before = whole


def errors() -> None:
    """Seconds and relative L2 error to all pairs: normalised, plain sums, and these without widened nodes."""
    samples, area, spacing = lit(ball(), 40_000)
    some = torch.randperm(len(area), generator=torch.Generator().manual_seed(0))[:PAIRS]
    print("\n| ε | s | error | plain sum s | error | nodes not widened s | error |")
    print("|---|---|---|---|---|---|---|")
    for epsilon in (0.05, 0.2, 0.8):
        cells = []
        for normalise, widened in ((True, True), (False, True), (False, False)):
            expected = all_pairs(samples, area, some, normalise)
            sent = emission(samples, area, spacing, normalise=normalise)
            begin = time.perf_counter()
            found = sent.exitance(samples, epsilon=epsilon, widened=widened)[some].double()
            error = float((found - expected).norm() / expected.norm())
            cells.append(f"{time.perf_counter() - begin:.2f} | {error:.3%}")
        print(f"| {epsilon} | {' | '.join(cells)} |", flush=True)


def texels(path: Path) -> None:
    """About 40,000 samples of a head to the texels of its atlas."""
    mesh = read_mesh(path, unit_mm=1.0)[0]
    mesh = mesh.moved(mesh.vertices * (HEAD_MM / mesh.height_mm))
    samples, area, spacing = lit(mesh, 40_000)
    found = rasterise(mesh, make_atlas(mesh, "source", size=1024).uv, (1024, 1024))
    row = torch.zeros(len(found), dtype=torch.int64)
    place = found.points.position(mesh)
    receivers = Surface(
        place,
        found.points.normal(mesh),
        torch.zeros_like(place),
        Weights(STD**2, samples.reflected.table, row),
    )
    for epsilon in (0.05, 0.2):
        begin = time.perf_counter()
        emission(samples, area, spacing).exitance(receivers, epsilon=epsilon)
        print(
            f"\nhead, {len(area):,} samples every {spacing:.2f} mm × {len(found):,} texels, ε = {epsilon}: "
            f"{time.perf_counter() - begin:.1f} s",
            flush=True,
        )


def ball() -> Mesh:
    """A sphere of 100 mm with few faces, so that samples are many or few as asked."""
    shape = trimesh.creation.icosphere(subdivisions=3, radius=100.0)
    return Mesh(torch.tensor(shape.vertices).float(), torch.tensor(shape.faces))


def lit(mesh: Mesh, wanted: int) -> tuple[Surface, Float[Tensor, " P"], float]:
    """About `wanted` samples, their areas and spacing [mm], in striped light, of profiles in 16 rows."""
    low, high = 1e-2, 100.0
    for _ in range(40):
        spacing = math.sqrt(low * high)
        try:
            enough = len(surface_samples(mesh, spacing)[1]) >= wanted
        except ValueError:
            enough = True
        low, high = (spacing, high) if enough else (low, spacing)
    points, area = surface_samples(mesh, low)
    position, normal = points.position(mesh), points.normal(mesh)
    light = (normal @ normal.new_tensor([0.3, 0.4, 0.86])).clamp_min(0)[:, None] * torch.tensor([1, 0.7, 0.5])
    light = light * (1 + torch.sin(position.sum(1, keepdim=True) / 4))
    table = torch.rand(16, len(STD), 3, generator=torch.Generator().manual_seed(0))
    row = (position[:, 1] / 3).long() % 16
    # all Gaussians are summed, whatever the spacing
    return Surface(position, normal, light, Weights(STD**2, table, row)), area, min(low, float(STD[0]))


def all_pairs(
    samples: Surface, area: Float[Tensor, " P"], some: Tensor, normalise: bool
) -> Float[Tensor, "Q 3"]:
    """Σ_p R_p(‖x - p‖) E_p A_p over all samples, in float64; each Gaussian by its Σ_p G A_p, if asked."""
    squared = torch.cdist(samples.position[some].double(), samples.position.double()).square()
    sent = samples.irradiance.double() * area.double()[:, None]
    own = samples.reflected.at().double()
    total = torch.zeros(len(some), 3, dtype=torch.float64)
    for k, std in enumerate(STD.double().tolist()):
        kernel = torch.exp(squared / (-2 * std**2)) / (2 * math.pi * std**2)
        whole = kernel @ area.double()[:, None] if normalise else 1.0
        total += kernel @ (sent * own[:, k]) / whole
    return total


if __name__ == "__main__":
    main()
