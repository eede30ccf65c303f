"""Seconds and memory for the weights of every texel of a layered material, beside the published method.

    python -m benchmarks weights [--texels 1048576]

Two layers, every coefficient and thickness varying, 3 channels, 8 terms, 16 frequencies; peak memory beyond
the result in a process of its own: by torch alone (`eager`), by the loop of numba, as where there is no
C++ compiler, and by the loop in C++ (`compiled`). Mayorga's grid is timed on one sample at a time and on a
batch, his route by FFTs on one; the paper gives .004 s and .118 s per sample for them, on a machine of 2008.
"""

import argparse
import math
import subprocess
import sys
import time
from pathlib import Path
from unittest import mock

import torch

from texsss.media.medium import mix
from texsss.media.presets import preset
from texsss.media.stack import Layer, LayerTable, Stack
from texsss.profiles.blocks import Loops
from texsss.profiles.fft_route import fft_combined
from texsss.profiles.grid import grid_gaussians
from texsss.profiles.project import variance_ladder
from texsss.profiles.weights import Weights, weights_for

TERMS = 8
HOW = ("eager", "numba", "compiled")
PAPER = {"grid": (0.004, 160), "FFT": (0.118, 5000)}  # seconds per sample, and for 40,000
GRID_MM, GRID_POINTS = 0.125, 256  # of the FFTs: a quarter of the shortest mean free path, 32 mm wide


def varied(rows: int, channels: int = 3) -> LayerTable:
    generator = torch.Generator().manual_seed(0)

    def spread(low: float, high: float) -> torch.Tensor:
        return low + (high - low) * torch.rand(rows, 2, channels, generator=generator)

    thickness = spread(0.05, 8.0)
    thickness[:, 1] = math.inf
    g = torch.zeros(rows, 2, channels)
    return LayerTable(spread(0.001, 0.5), spread(0.5, 3.0), g, thickness, (1.4, 1.4), True)


def painted(side: int) -> Stack:
    """Two media mixed by an 8-bit mask, of 8-bit thickness: nearly every pair of values occurs."""
    generator = torch.Generator().manual_seed(1)
    depth = torch.randint(0, 256, (side, side), generator=generator) / 255
    mask = torch.linspace(0, 255, side).round().div(255).expand(side, side).contiguous()
    return Stack([Layer(mix(preset("skin1"), preset("skin2"), mask), depth * 2), Layer(preset("skin1"))])


def best(work, repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def solved(how: str, material: Stack | LayerTable, model: str) -> Weights:
    """Weights by torch alone, numba or C++."""
    ladder = variance_ladder(0.4, 400.0, TERMS)
    if how != "numba":
        return weights_for(material, ladder, model=model, compiled=how == "compiled")
    with (
        mock.patch("texsss.profiles.weights.Fused", lambda *table, **options: None),
        mock.patch("texsss.profiles.weights.Loops", Patient),
    ):
        return weights_for(material, ladder, model=model, compiled=True)


class Patient(Loops):
    """Waits for numba, which bakes do not."""

    def __init__(self):
        super().__init__(wait=True)


def weigh(model: str, how: str, texels: int) -> None:
    """Prints by how much the process grew beyond the result [MB]."""
    table = varied(texels)
    solved(how, varied(10_000), model)  # what is loaded once
    before = peak_mb()
    weights = solved(how, table, model)
    print(peak_mb() - before - (weights.table.nbytes + weights.row.nbytes) / 2**20)


def peak_mb() -> float:
    """Most memory of this process so far [MB]; getrusage would count what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def peak_beyond(model: str, how: str, texels: int) -> float:
    """Peak memory beyond the result [MB], in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.bench_weights", "--texels", str(texels)]
    made = subprocess.run(
        [*command, "--weigh", model, "--how", how], capture_output=True, text=True, check=True
    )
    return float(made.stdout)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--texels", type=int, default=2**20)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--weigh", help="model whose memory is measured, and nothing else")
    parser.add_argument("--how", choices=HOW, default=HOW[0])
    asked = parser.parse_args()
    if asked.weigh:
        weigh(asked.weigh, asked.how, asked.texels)
        return
    table = varied(asked.texels)
    print(f"{asked.texels} texels, {torch.get_num_threads()} threads, best of {asked.repeats}")
    per_texel = {}
    for model in ("layered-diffusion", "layered-sp3"):
        for how in HOW:
            if how != "eager":
                built = best(lambda model=model, how=how: solved(how, table.rows(slice(0, 10_000)), model), 1)
                print(f"{model:18s} {how:16s} {built:8.2f} s until it has built or loaded its loop")
            seconds = best(lambda model=model, how=how: solved(how, table, model), asked.repeats)
            per_texel.setdefault(model, seconds / asked.texels)
            beyond = peak_beyond(model, how, asked.texels)
            print(f"{model:18s} {how:16s} {seconds:8.2f} s  {beyond:5.0f} MB beyond the result", flush=True)
    stack = painted(int(asked.texels**0.5))
    for how in HOW:
        seconds = best(lambda how=how: solved(how, stack, "layered-sp3"), asked.repeats)
        print(f"layered-sp3        8-bit maps, {how:8s} {seconds:5.2f} s", flush=True)
    one, many = varied(1), varied(256)
    routes = {
        "grid, one at a time": best(lambda: grid_gaussians(one), 3),
        "grid, batch of 256": best(lambda: grid_gaussians(many), 1) / 256,
        "FFT, one at a time": best(lambda: fft_combined(one, GRID_MM, GRID_POINTS), 3),
    }
    for name, seconds in routes.items():
        ratios = ", ".join(f"{seconds / x:.0f} x {model}" for model, x in per_texel.items())
        print(
            f"Mayorga's {name:20s} {seconds:8.5f} s per texel, {seconds * 40_000:5.0f} s for 40,000: {ratios}"
        )
    for name, (seconds, total) in PAPER.items():
        print(f"the paper's {name:18s} {seconds:8.3f} s per sample,{total:6d} s for 40,000")


if __name__ == "__main__":
    main()
