"""Seconds for the weights of every texel of a layered material, by model, beside the published method.

    python benchmarks/bench_weights.py [--texels 1048576]

Two layers, every coefficient and thickness varying, 3 channels, 8 terms, 16 frequencies. Mayorga's grid is
timed on one sample at a time and on a batch; the paper gives .004 s per sample for it and .118 s for FFTs.
"""

import argparse
import math
import resource
import time

import torch

from texsss.media.medium import mix
from texsss.media.presets import preset
from texsss.media.stack import Layer, LayerTable, Stack
from texsss.profiles.grid import grid_gaussians
from texsss.profiles.project import variance_ladder
from texsss.profiles.weights import weights_for


def varied(rows: int, channels: int = 3) -> LayerTable:
    generator = torch.Generator().manual_seed(0)

    def spread(low: float, high: float) -> torch.Tensor:
        return low + (high - low) * torch.rand(rows, 2, channels, generator=generator)

    thickness = spread(0.05, 8.0)
    thickness[:, 1] = math.inf
    g = torch.zeros(rows, 2, channels)
    return LayerTable(spread(0.001, 0.5), spread(0.5, 3.0), g, thickness, (1.4, 1.4), True)


def best(work, repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--texels", type=int, default=2**20)
    parser.add_argument("--repeats", type=int, default=3)
    asked = parser.parse_args()
    ladder = variance_ladder(0.4, 400.0, 8)
    table = varied(asked.texels)
    print(f"{asked.texels} texels, {torch.get_num_threads()} threads, best of {asked.repeats}")
    per_texel = {}
    for model in ("layered-diffusion", "layered-sp3"):
        for compiled in (False, True):
            if compiled:
                weights_for(table.rows(slice(0, 8192)), ladder, model=model, compiled=True)
            seconds = best(
                lambda model=model, compiled=compiled: weights_for(
                    table, ladder, model=model, compiled=compiled
                ),
                asked.repeats,
            )
            per_texel.setdefault(model, seconds / asked.texels)
            how = "compiled" if compiled else "eager"
            value = seconds / asked.texels * 1e9 / 48
            print(f"{model:18s} {how:16s} {seconds:8.2f} s  {value:7.1f} ns per value", flush=True)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB of the process")
    side = int(asked.texels**0.5)
    generator = torch.Generator().manual_seed(1)
    mask, depth = (torch.randint(0, 256, (side, side), generator=generator) / 255 for _ in range(2))
    # 8-bit maps as they are painted: smooth, so that few pairs of values meet
    mask = torch.linspace(0, 1, side).mul(255).round().div(255).expand(side, side) * 1.0
    stack = Stack([Layer(mix(preset("skin1"), preset("skin2"), mask), depth * 2), Layer(preset("skin1"))])
    seconds = best(lambda: weights_for(stack, ladder), 1)
    rows = len(weights_for(stack, ladder, model="layered-diffusion").table)
    print(f"layered-sp3        8-bit maps       {seconds:8.2f} s  {rows} distinct rows")
    one, many = varied(1), varied(256)
    seconds = best(lambda: grid_gaussians(one), asked.repeats)
    ratio = seconds / per_texel["layered-diffusion"]
    print(f"Mayorga's grid     one at a time    {seconds:8.4f} s per texel, {ratio:.0f} x layered-diffusion")
    seconds = best(lambda: grid_gaussians(many), 1) / 256
    ratio = seconds / per_texel["layered-diffusion"]
    print(f"Mayorga's grid     batch of 256     {seconds:8.5f} s per texel, {ratio:.0f} x layered-diffusion")
    print("the paper          grid .004 s, FFT .118 s per sample; 160 s and 5000 s for 40,000")


if __name__ == "__main__":
    main()
