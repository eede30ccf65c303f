"""Error of both marches by their steps, over a map of veins and one of sudden steps: RMSE over the mean.

    python -m benchmarks.bench_convergence [PLOT.png]

The close-up of `bench_march`, every fourth point of it, one light; the truth is 512 exact steps.
"""

import sys
from pathlib import Path

import torch

from benchmarks.bench_march import FISH, Prepared, close_up, fish, fish_media, three_lights, vein_depths
from texsss.light.visibility import Occluder
from texsss.transport.march.gatherer import Gatherer, Method
from texsss.transport.march.interior import from_depths
from texsss.transport.march.planes import fit_planes
from texsss.types import Float, Tensor

COUNTS = (1, 2, 3, 4, 5, 10, 16, 25, 50, 100)
TRUTH = 512  # exact steps
TEXTURE = 1024
METHODS: tuple[Method, ...] = ("exact", "uniform")


def step_depths(size: int) -> Float[Tensor, "H W 3"]:
    """Three boundaries [mm]: a chequer of sudden steps above a flat floor."""
    cell = torch.arange(size) * 16 // size
    up = ((cell[:, None] + cell[None]) % 2).float()
    return torch.stack([0.25 + 0.1 * up, 0.5 + 0.7 * up, torch.full_like(up, 2.2)], -1)


def main() -> None:
    model = fish(FISH)
    mesh = model.mesh
    planes, light = fit_planes(mesh, model.planes_mm), three_lights(mesh)[:1]
    points, eye, _ = close_up(model, Occluder(mesh))
    errors: dict[tuple[str, str], list[float]] = {}
    for name, depths in (("veins", vein_depths(TEXTURE)), ("steps", step_depths(TEXTURE))):
        interior = from_depths(depths, fish_media()).to(mesh.vertices)
        prepared = Prepared(points[::4], mesh, planes, interior, light, eye)
        truth = prepared.run(Gatherer(interior, "exact", TRUTH, "schlick", True))
        for method in METHODS:
            seen = [prepared.run(Gatherer(interior, method, n, "schlick", True)) for n in COUNTS]
            wrong = [float((x - truth).square().mean().sqrt() / truth.mean()) for x in seen]
            errors[name, method] = wrong
            print(f"| {name}, {method} | " + " | ".join(f"{100 * x:.2g} %" for x in wrong) + " |", flush=True)
    if len(sys.argv) > 1:
        plot(errors, Path(sys.argv[1]))


def plot(errors: dict[tuple[str, str], list[float]], path: Path) -> None:
    """Draws the errors over the number of steps, both logarithmic."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4), dpi=120, layout="constrained")
    for (name, method), wrong in errors.items():
        colour = {"veins": "tab:red", "steps": "tab:blue"}[name]
        axes.loglog(
            COUNTS, wrong, "o-" if method == "exact" else "s--", color=colour, label=f"{method}, {name}"
        )
    first = [errors["veins", "uniform"][-1] * COUNTS[-1] / n for n in COUNTS]
    axes.loglog(COUNTS, first, ":", color="grey", label="first order")
    axes.set(xlabel="steps, or samples", ylabel="RMSE / mean")
    axes.grid(which="major", alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path)


if __name__ == "__main__":
    main()
