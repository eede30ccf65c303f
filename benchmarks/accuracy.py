"""How far every profile model is from the truth, as a page: docs/accuracy.md.

    PYTHONPATH=tests python benchmarks/accuracy.py [--out docs/accuracy.md]

The truth is the layered Monte Carlo tabulated in tests/reference/stacks.json, with its error bars. The
models are those that `hankel_profiles` offers.
"""

import argparse
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path

import numpy as np
import torch
from reference import layers as plain
from reference.beam import ballistic
from reference.montecarlo import Estimate
from reference.stacks import RINGS, STACKS, S, Tabulated, read_stacks
from scipy.special import j1

from texsss.errors import TexsssError
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.profiles import hankel
from texsss.profiles.hankel import hankel_profiles

PAGE = Path(__file__).resolve().parents[1] / "docs" / "accuracy.md"
Array = np.ndarray
Profile = Callable[[Array, str, str], tuple[Array, Array]]
"""R̂, T̂ at s, by scattering and incidence."""

MISS = 0.05  # relative error that is reported by name
RADIUS = 10.0  # [mm] rings beyond are noise


@dataclass(frozen=True)
class Metric:
    """One column: what it measures, and where it stands in the table."""

    key: str
    title: str
    meaning: str
    distance: bool = False  # of profiles, not a signed relative error


METRICS = (
    Metric("R", "R", "total reflectance R̂(0) at normal incidence, relative"),
    Metric("R_diffuse", "R diffuse", "the same under diffuse light"),
    Metric("T", "T", "T̂(0) and ballistic light together, normal incidence, relative"),
    Metric("T_diffuse", "T diffuse", "the same under diffuse light"),
    Metric(
        "multiple",
        "multiple",
        "largest error of the multiply scattered R̂(s) over all s, relative to the total R̂(0)",
    ),
    Metric(
        "radial",
        "radial",
        "sqrt(∫ s (R̂ - R̂_MC)² ds / ∫ s R̂_MC² ds), s to 40/mm: all of R(r) that is wider than 1/40 mm",
        True,
    ),
    Metric(
        "far", "beyond .3 mm", "sqrt(∫ r (R - R_MC)² dr / ∫ r R_MC² dr) over rings from .3 to 10 mm", True
    ),
)


TITLES = [metric.title for metric in METRICS]
NO_ANSWER = dict.fromkeys((metric.key for metric in METRICS), nan)


def model_names() -> list[str]:
    """What `hankel_profiles` offers, its default first."""
    default = inspect.signature(hankel_profiles).parameters["model"].default
    return sorted(hankel.MODELS, key=lambda name: name != default)


def stack_of(layers: list[plain.Layer]) -> Stack:
    """The same stack in texsss."""
    return Stack([Layer(Medium(l.sigma_a, l.sigma_s, l.g, l.eta), l.thickness) for l in layers])


def profiles_of(layers: list[plain.Layer]) -> dict[str, Profile]:
    """Every model that can be asked about this stack."""
    stack = stack_of(layers)

    def model(name: str) -> Profile:
        def evaluate(s: Array, scattering: str, incidence: str) -> tuple[Array, Array]:
            R, T = hankel_profiles(
                stack, torch.as_tensor(s), model=name, scattering=scattering, incidence=incidence
            )
            return R[..., 0].numpy(), T[..., 0].numpy()

        return evaluate

    half_space = len(layers) == 1 and layers[0].thickness == inf
    return {name: model(name) for name in model_names() if half_space or "dipole" not in name}


def errors(
    profile: Profile, layers: list[plain.Layer], normal: Tabulated, diffuse: Tabulated
) -> dict[str, float]:
    """Every metric of one model on one stack; nan where there is no answer, or nothing to meet."""
    out = dict(NO_ANSWER)
    zero = np.zeros(1)
    for suffix, truth, incidence in (("", normal, "normal"), ("_diffuse", diffuse, "diffuse")):
        try:
            R, T = (float(x[0]) for x in profile(zero, "total", incidence))
        except TexsssError:
            continue
        out["R" + suffix] = R / float(truth.totals["R"].mean) - 1
        if layers[-1].thickness < inf:
            whole = float(truth.totals["T"].mean + truth.totals["T_ballistic"].mean)
            out["T" + suffix] = (T + ballistic(layers, incidence)[1]) / whole - 1
    try:
        truth = normal.hankel["R"].mean - normal.hankel["R1"].mean
        wrong = (profile(S, "multiple", "normal")[0] - truth) / normal.totals["R"].mean
        out["multiple"] = float(wrong[np.argmax(np.abs(wrong))])
    except TexsssError:
        pass  # knows only the total
    try:
        out["radial"] = radial_error(profile(S, "total", "normal")[0], normal.hankel["R"])
        out["far"] = ring_error(profile, normal.rings["R"])
    except TexsssError:
        pass
    return out


def radial_error(R: Array, truth: Estimate) -> float:
    """Distance in the metric ∫ r (f - g)² dr, by Parseval, less the energy of the Monte Carlo's noise."""
    weights = S * np.gradient(S)
    noise = weights @ truth.error**2
    wrong = max(float(weights @ (R - truth.mean) ** 2 - noise), 0)
    return (wrong / float(weights @ truth.mean**2 - noise)) ** 0.5


def ring_error(profile: Profile, truth: Estimate) -> float:
    """The same from .3 mm on, between mean values over rings."""
    inside = RINGS[1:] <= RADIUS
    weights = np.diff(RINGS**2)[inside]
    mean, error = truth.mean[inside], truth.error[inside]
    wrong = max(float(weights @ ((ring_means(profile)[inside] - mean) ** 2 - error**2)), 0)
    return (wrong / float(weights @ (mean**2 - error**2))) ** 0.5


def ring_means(profile: Profile) -> Array:
    """R(r) averaged over the RINGS [1/mm²], by ∫ R̂(s) [r J1(s r)] ds between their edges.

    R̂ is damped by a Gaussian of 20 µm, which changes nothing beyond .3 mm and ends the integral.
    """
    edges = np.concatenate([[0, 0.01, 0.03, 0.1, 0.3], np.arange(0.5, 20, 0.5), np.arange(20, 251, 2)])
    x, w = np.polynomial.legendre.leggauss(16)
    half = np.diff(edges)[:, None] / 2
    s, weight = (edges[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()
    R = profile(s, "total", "normal")[0] * np.exp(-((0.02 * s) ** 2) / 2)
    within = (RINGS[:, None] * j1(RINGS[:, None] * s)) @ (weight * R)  # light within each radius
    return np.diff(within) / (np.pi * np.diff(RINGS**2))


def furnace_error(model: str, layers: list[plain.Layer], incidence: str) -> float:
    """R̂(0) + T̂(0) + ballistic light - 1 of a stack that absorbs nothing."""
    R, T = profiles_of(layers)[model](np.zeros(1), "total", incidence)
    return float(R[0] + T[0]) + sum(ballistic(layers, incidence)) - 1


def white_slabs(g: float) -> list[list[plain.Layer]]:
    """Slabs that absorb nothing; the reduced mean free path is 1 mm."""
    return [
        [plain.Layer(0.0, 1 / (1 - g), thickness, g=g, eta=eta)]
        for eta in (1.0, 1.2, 1.4, 1.5)
        for thickness in (0.05, 0.3, 1.0, 8.0)
    ]


def cell(metric: Metric, x: float) -> str:
    """A signed percentage, or a distance; misses in bold."""
    if np.isnan(x):
        return "·"
    if metric.distance:
        return f"{x:.2f}"
    return f"**{100 * x:+.1f}**" if abs(x) > MISS else f"{100 * x:+.1f}"


def summary(values: Array, metric: Metric) -> str:
    """Mean and worst magnitude over all stacks that answer."""
    size = np.abs(values[~np.isnan(values)])
    if not len(size):
        return "·"
    return (
        f"{size.mean():.2f} / {size.max():.2f}"
        if metric.distance
        else f"{100 * size.mean():.1f} / {100 * size.max():.1f}"
    )


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


@dataclass(frozen=True)
class Findings:
    """Every error of every model on every stack."""

    normal: dict[str, Tabulated]
    diffuse: dict[str, Tabulated]
    errors: dict[str, dict[str, dict[str, float]]]  # stack, model, metric
    models: list[str]  # the default first

    def column(self, model: str, metric: Metric) -> Array:
        return np.array([self.errors[name][model][metric.key] for name in STACKS])


def measure() -> Findings:
    normal, diffuse = read_stacks("normal"), read_stacks("diffuse")
    found = {}
    for name, layers in STACKS.items():
        profiles = profiles_of(layers)
        found[name] = {
            model: errors(profiles[model], layers, normal[name], diffuse[name])
            if model in profiles
            else NO_ANSWER
            for model in model_names()
        }
    return Findings(normal, diffuse, found, model_names())


def misses(found: Findings, model: str) -> str:
    """Every signed error above MISS, by name."""
    lines = [
        f"- {name}: {metric.title} {100 * found.errors[name][model][metric.key]:+.1f} %"
        for name in STACKS
        for metric in METRICS
        if not metric.distance and abs(found.errors[name][model][metric.key]) > MISS
    ]
    return "\n".join(lines) or "Nowhere."


def summary_table(found: Findings) -> str:
    rows = [
        [f"`{model}`", *(summary(found.column(model, metric), metric) for metric in METRICS)]
        for model in found.models
    ]
    return table(["model", *TITLES], rows)


def stack_table(found: Findings, model: str) -> str:
    rows = [
        [name, *(cell(metric, found.errors[name][model][metric.key]) for metric in METRICS)]
        for name in STACKS
    ]
    return table(["stack", *TITLES], rows)


def totals_table(found: Findings) -> str:
    def row(name: str) -> list[str]:
        R = found.normal[name].totals["R"]
        cells = (cell(METRICS[0], found.errors[name][model]["R"]) for model in found.models)
        return [name, f"{R.mean:.4f} ± {R.error:.4f}", *cells]

    return table(["stack", "Monte Carlo", *(f"`{m}`" for m in found.models)], [row(name) for name in STACKS])


def furnace_table(found: Findings) -> str:
    def worst(model: str, incidence: str, g: float) -> str:
        lost = [furnace_error(model, layers, incidence) for layers in white_slabs(g)]
        return f"{100 * max(lost, key=abs):+.2f}"

    cases = [(incidence, g) for incidence in ("normal", "diffuse") for g in (0.0, 0.8)]
    rows = [
        [f"`{model}`", *(worst(model, *case) for case in cases)]
        for model in found.models
        if "dipole" not in model
    ]
    return table(["model", *(f"{incidence}, g {g:g}" for incidence, g in cases)], rows)


def page(found: Findings) -> str:
    """The whole of docs/accuracy.md."""
    default = found.models[0]
    runs = [*found.normal.values(), *found.diffuse.values()]
    noise = max(float(run.totals["R"].error / run.totals["R"].mean) for run in runs)
    few, many = min(run.photons for run in runs), max(run.photons for run in runs)
    legend = "\n".join(f"- **{metric.title}**: {metric.meaning}" for metric in METRICS)
    return f"""# Accuracy of the profile models

Made by `PYTHONPATH=tests python benchmarks/accuracy.py`. The truth is a layered Monte Carlo
(`tests/reference/montecarlo.py`,
{few:,} to {many:,} photons per stack and incidence; the standard error of R is at most {100 * noise:.2f} %
of it) that meets van de Hulst's and Giovanelli's published values, the H function, adding-doubling and a
solution of the integral transport equation. {len(STACKS)} stacks: reduced albedo .4 to .999 (the number after
"half-space" and "slab"), eta 1 to 1.6, one to four layers of .05 to 8 mm, isotropic unless g is named.

{legend}

## Mean / worst error of every model

In percent; distances (radial, beyond .3 mm) as they are. A dot: the model does not answer. Dipoles know
half-spaces of one medium and are asked about those only.

{summary_table(found)}

## Where `{default}` misses {100 * MISS:.0f} %

{misses(found, default)}

## `{default}`, stack by stack

{stack_table(found, default)}

## Total reflectance at normal incidence, all models

Errors in percent.

{totals_table(found)}

## White furnace

Worst R̂(0) + T̂(0) + ballistic light - 1, in percent, of slabs that absorb nothing: .05, .3, 1 and 8 reduced
mean free paths, eta 1, 1.2, 1.4 and 1.5.

{furnace_table(found)}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description="Writes how far every profile model is from the truth.")
    parser.add_argument("--out", type=Path, default=PAGE)
    parser.parse_args().out.write_text(page(measure()))


if __name__ == "__main__":
    main()
