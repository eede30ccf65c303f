"""Diffusion in texture space: the bank of a head, and of a uniform square against kornia's separable blur.

python benchmarks/bench_diffusion.py [HEAD.obj] [--size 1024]
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import kornia
import torch

from texsss.io.meshes import read_mesh
from texsss.profiles.weights import Weights
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points, TexelMaps
from texsss.surface.raster import rasterise
from texsss.transport.bank import build_bank, exitance
from texsss.transport.uv import diffuse_uv
from texsss.types import Tensor

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "LeePerrySmith.obj"
HEAD_MM = 240.0
SQUARE_STD = torch.logspace(0, 2, 8)  # texels
HEAD_STD = torch.logspace(-0.7, 1, 8)  # mm
Result = TypeVar("Result")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("head", nargs="?", type=Path, default=HEAD)
    parser.add_argument("--size", type=int, default=1024)
    arguments = parser.parse_args()
    print(f"threads: {torch.get_num_threads()}, atlas: {arguments.size}²")
    against_kornia(arguments.size)
    if arguments.head.is_file():
        on_a_head(arguments.head, arguments.size)
    else:
        print(f"head: skipped, {arguments.head} is absent")


def against_kornia(size: int) -> None:
    """A bank of 8 Gaussians, 1 to 100 texels wide, 3 channels, uniform metric, on noise and stripes."""
    texels = uniform_square(size)
    image = torch.rand(size, size, 3, generator=torch.Generator().manual_seed(0))
    image[..., 1] = (torch.arange(size) // 37 % 2).float()
    values = texels.from_image(image)
    variances = SQUARE_STD**2  # texels of 1 mm

    seconds, ours = best(lambda: diffuse_uv(values, texels, variances), 3)
    first = image.permute(2, 0, 1)[None]
    kornia_seconds, theirs = best(lambda: [separable(first, float(std)) for std in SQUARE_STD], 3)
    print(
        f"square, bank of 8: {seconds:.2f} s, kornia {kornia_seconds:.2f} s, {kornia_seconds / seconds:.1f}×"
    )
    for std, copy, blurred in zip(SQUARE_STD.tolist(), ours, theirs, strict=True):
        inside = slice(round(4 * std), size - round(4 * std))  # nearer the edge the two mean other things
        if inside.stop <= inside.start:
            continue
        expected = blurred[0].permute(1, 2, 0)[inside, inside]
        copy = texels.to_image(copy)[inside, inside]
        largest = float((copy - expected).abs().max() / expected.max())
        relative = float((copy - expected).norm() / expected.norm())
        print(f"  std {std:6.2f} texels: largest difference {largest:.1e} of the maximum, L2 {relative:.1e}")


def on_a_head(path: Path, size: int) -> None:
    """Time, energy and the exitance of an edited material on a scanned head with the author's atlas."""
    mesh = read_mesh(path, unit_mm=1.0)[0]
    mesh = mesh.moved(mesh.vertices * (HEAD_MM / mesh.height_mm))
    assert mesh.source_uv is not None
    texels = rasterise(mesh, mesh.source_uv, (size, size))
    facing = texels.points.normal(mesh) @ torch.tensor([0.36, 0.48, 0.8])
    light = facing.clamp_min(0)[:, None].expand(-1, 3).contiguous()
    variances = HEAD_STD**2
    seconds, bank = best(lambda: build_bank(light, texels, variances), 3)
    tinted = light * torch.tensor([1.0, 0.9, 0.8])  # white light is blurred once for all channels
    coloured = best(lambda: build_bank(tinted, texels, variances), 3)[0]
    print(f"head, under coloured light: {coloured:.2f} s; under white light:")
    print(f"head, {texels.covered_count} texels of {texels.texel_mm:.2f} mm, bank of 8: {seconds:.2f} s")
    area = texels.area[:, None]
    energy = (bank.values * area).sum(1)[:, 0] / (light * area).sum(0)[0] - 1
    print("  energy, Σ M dA / Σ E dA - 1: " + " ".join(f"{float(e):+.2%}" for e in energy))
    constant = diffuse_uv(torch.ones_like(light), texels, variances)
    print(f"  constant light, largest difference: {float((constant - 1).abs().max()):.1e}")

    weights = Weights(variances, torch.full((1, 8, 3), 0.125), torch.zeros(len(texels), dtype=torch.int32))
    print(f"  exitance of an edited material: {best(lambda: exitance(bank, weights), 5)[0]:.3f} s")
    rows = torch.arange(len(texels), dtype=torch.int32) % 256
    weights = Weights(variances, torch.rand(256, 8, 3), rows)
    print(f"  the same with a table of 256 rows: {best(lambda: exitance(bank, weights), 5)[0]:.3f} s")


def uniform_square(size: int) -> TexelMaps:
    """Texels of 1 mm on a flat square."""
    corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    i, j = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    v, u = (i.flatten() + 0.5) / size, (j.flatten() + 0.5) / size
    first = torch.stack([1 - u, u - v, v], -1)
    second = torch.stack([1 - v, u, v - u], -1)
    bary = torch.where((u >= v)[:, None], first, second)
    points = Points((u < v).int(), bary, torch.arange(size * size, dtype=torch.int32))
    covered = torch.ones(size * size, dtype=torch.bool)
    return TexelMaps(Mesh(corners * size, faces), corners[faces][..., :2], points, covered, (size, size))


def separable(image: Tensor, std: float) -> Tensor:
    """kornia's Gaussian blur to 4 standard deviations, dark outside."""
    reach = 2 * round(4 * std) + 1
    return kornia.filters.gaussian_blur2d(image, (reach, reach), (std, std), border_type="constant")


def best(work: Callable[[], Result], repeats: int) -> tuple[float, Result]:
    """The shortest of several runs [s] and the last result."""
    seconds = float("inf")
    result = None
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        seconds = min(seconds, time.perf_counter() - start)
    assert result is not None
    return seconds, result


if __name__ == "__main__":
    main()
