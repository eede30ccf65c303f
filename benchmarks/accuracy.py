"""How far every profile model is from the truth, as a page: docs/accuracy.md.

PYTHONPATH=tests python -m benchmarks.accuracy [--out docs/accuracy.md]
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from reference.adding import totals
from reference.beam import ballistic
from reference.layers import Layer
from reference.stacks import STACKS, Tabulated, read_stacks

from benchmarks import more_stacks
from benchmarks.other_truths import ADDING, INTEGRAL, ONE_INDEX, adding_errors, transport_errors
from benchmarks.profile_errors import (
    FITTED,
    METRICS,
    NAMES,
    NO_ANSWER,
    TITLES,
    Array,
    Metric,
    errors,
    furnace_error,
    profiles_of,
    white_slabs,
)

PAGE = Path(__file__).resolve().parents[1] / "docs" / "accuracy.md"
FORWARD_DEPTHS = (0.05, 0.1, 0.3, 1.0, 3.0, 10.0)  # reduced mean free paths
MISS = 0.05  # relative error that is reported by name


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

    def column(self, model: str, metric: Metric, forward: bool) -> Array:
        """Over the stacks that scatter forwards, or over the isotropic ones."""
        names = [name for name, layers in STACKS.items() if any(layer.g for layer in layers) == forward]
        return np.array([self.errors[name][model][metric.key] for name in names])


def measure() -> Findings:
    normal, diffuse = read_stacks("normal"), read_stacks("diffuse")
    found = {}
    for name, layers in STACKS.items():
        profiles = profiles_of(layers)
        found[name] = {
            model: errors(model, profiles[model], layers, normal[name], diffuse[name])
            if model in profiles
            else NO_ANSWER
            for model in NAMES
        }
    return Findings(normal, diffuse, found, NAMES)


def misses(found: Findings, model: str) -> str:
    """Every signed error above MISS, by name."""
    lines = [
        f"- {name}: {metric.title} {100 * found.errors[name][model][metric.key]:+.1f} %"
        for name in STACKS
        for metric in METRICS
        if not metric.distance and abs(found.errors[name][model][metric.key]) > MISS
    ]
    return "\n".join(lines) or "Nowhere."


def summary_table(found: Findings, forward: bool) -> str:
    rows = [
        [f"`{model}`", *(summary(found.column(model, metric, forward), metric) for metric in METRICS)]
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
        if "dipole" not in model and model != "burley"
    ]
    return table(["model", *(f"{incidence}, g {g:g}" for incidence, g in cases)], rows)


def others_table(models: list[str]) -> str:
    """Mean and worst against integral transport, then against adding-doubling."""
    metrics = {metric.key: metric for metric in METRICS}
    columns = [metrics[key] for key in (*INTEGRAL, *ADDING)]
    rows = []
    for model in models:
        found = [*transport_errors(model), *adding_errors(model)]
        cells = (summary(values, metric) for values, metric in zip(found, columns, strict=True))
        rows.append([f"`{model}`", *cells])
    return table(["model", *(metric.title for metric in columns)], rows)


def forward_table(model: str) -> str:
    """Errors of totals in slabs of g .8, all light that comes out counted, held against adding-doubling."""

    def cells(layers: list[Layer]) -> str:
        truth, profile = totals(layers, 24), profiles_of(layers)[model]
        out = []
        for incidence, R, T in (("normal", truth.R, truth.T), ("diffuse", truth.R_diffuse, truth.T_diffuse)):
            have = profile(np.zeros(1), "total", incidence)
            beam = ballistic(layers, incidence)
            out += [(float(h[0]) + b) / x - 1 for h, b, x in zip(have, beam, (R, T), strict=True)]
        return " ".join(f"{100 * x:+.0f}" for x in out)

    rows = [
        [f"{albedo:g}, eta {eta:g}", *(cells(forward_slab(albedo, tau, eta)) for tau in FORWARD_DEPTHS)]
        for eta in (1.0, 1.2, 1.4, 1.6)
        for albedo in (0.9, 0.99)
    ]
    return table(["albedo", *(f"{tau:g}" for tau in FORWARD_DEPTHS)], rows)


def forward_slab(albedo: float, tau: float, eta: float, g: float = 0.8) -> list[Layer]:
    """A slab of reduced albedo and reduced optical thickness, 1 mm thick."""
    return [Layer((1 - albedo) * tau, albedo * tau / (1 - g), 1.0, g=g, eta=eta)]


def page(found: Findings) -> str:
    """The whole of docs/accuracy.md."""
    default = found.models[0]
    runs = [*found.normal.values(), *found.diffuse.values()]
    noise = max(float(run.totals["R"].error / run.totals["R"].mean) for run in runs)
    few, many = min(run.photons for run in runs), max(run.photons for run in runs)
    fitted = "\n".join(f"- `{name}`: {what}" for name, what in FITTED.items())
    legend = "\n".join(f"- **{metric.title}**: {metric.meaning}" for metric in METRICS)
    return f"""# Accuracy of the profile models

Made by `PYTHONPATH=tests python -m benchmarks.accuracy`. The truth is a layered Monte Carlo
(`tests/reference/montecarlo.py`, {few:,} to {many:,} photons per stack and incidence; the standard error of
R is at most {100 * noise:.2f} % of it) that meets van de Hulst's and Giovanelli's published values, the H
function, adding-doubling and a solution of the integral transport equation.

{len(STACKS)} stacks: reduced albedo .4 to .999 (the number after
"half-space" and "slab"), eta 1 to 1.6, one to four layers of .05 to 8 mm, isotropic unless g is named.

{legend}

## Mean / worst error of every model

In percent; distances (radial, beyond .3 mm) as they are. A dot: the model does not answer. Dipoles know
half-spaces of one medium and are asked about those only. Beside the models of `hankel_profiles`:

{fitted}

Isotropic scattering:

{summary_table(found, forward=False)}

Where some layer has g = .8 (the models reduce their coefficients, σs' = σs (1 - g)):

{summary_table(found, forward=True)}

## Against other truths

Mean / worst as above, isotropic scattering. The first four columns: against 19 solutions of the integral
transport equation at normal incidence, themselves good to 1 to 1.5 % (`tests/reference/transport.py`).
The other four: against adding-doubling (`iadpython`), on the {len(ONE_INDEX)} stacks whose layers share an
index.

{others_table(found.models)}

## Where `{default}` misses {100 * MISS:.0f} %

{misses(found, default)}

Where light is scattered forwards, reduced coefficients, σs' = σs (1 - g), turn at once what in truth keeps
its direction for a while. The totals of four streams in the true medium less those in the reduced one are
added (`texsss/profiles/four_streams.py`): the slab of .3 reduced mean free paths is 39 % too bright without.
Light that is hardly deflected but once leaves near where it entered: it is counted as if it had scattered
once, in a medium that scatters less (`texsss/profiles/nearly.py`). On 48 random stacks beside those of the
table, twelve of g .3, .6, .8 and .9 each, one to four layers, eta 1 to 1.6, the radial error of R̂(s) at
normal incidence is .06, .10, .09 and .16 on average, by g; .07, .17, .24 and .29 if all that scatters again
spreads alike. Under diffuse light it is .08, .15, .11 and .17.

Diffuse light is displaced on its way in, too, before it scatters. For light that scatters once both ways
count together, at one azimuth between them for every pair of cosines (`texsss/profiles/single.py`); left out,
the radial error under diffuse light would be .22 on average and .52 at worst in the isotropic stacks, almost
all of it single scattering. What scatters again remembers little of that, but under films
(`texsss/profiles/films.py`). In light that gets through, the way in is left out.

In thin slabs whose faces mirror totally light is everywhere alike, and what scatters again and what leaves
is known ray by ray (`texsss/profiles/even.py`); the two modes take over as slabs become thick, or their
layers unlike. With two modes alone multiple scattering would be wrong by up to 7.3 % of the total at some s
in slabs of .05 to .3 mm, and the total up to 25 % too high in such as absorb much (adding-doubling, eta 1.6,
.05 mean free paths; with even light 1.1 %).

What two modes make of light that scattered once, beside what that truly is, which is known, tells of the
light that scattered again, too: its last way out is much the same. With ρ = truth over modes, and 1 at s = 0,
R̂(s) of it is multiplied by (1 + 3 ρ) / (3 + ρ), about √ρ, T̂(s) by (1 + 1.5 ρ) / (1.5 + ρ) (`led_out` in
`texsss/profiles/led_out.py`); totals stay as they are. Where matter scatters forwards it is less, for
that ρ does not know.

Light crosses a clear film straight, on its way out and where the face mirrors it back, by the angles that
the face lets out and mirrors (`texsss/profiles/straight.py`), and so it does, by as much as they are rarer
than what lies beneath, other layers; along them it spreads only as far as it flew since it last scattered.
Such films, and layers of thickness 0, leave what gets out to the indices beneath, as in truth, whatever their
own. If light diffused through films, R̂(s) of a beam would be wrong by up to 76 % of R̂(0) under clear ones,
and by 34 % under dense ones on a clear one. Under clear ones R̂ may fall below 0 by 1.7 % of R̂(0), and rise by
1.2 %: light that scattered once goes around rings, in truth too.

Of the isotropic stacks below four are beyond 3 % in `multiple`: the total of three layers of eta 1.5, indices
that differ by .2 and more, and a clear film of .5 mm.

## More stacks

{more_stacks.section()}

## Thin slabs that scatter forwards

Slabs of g = .8 by reduced albedo, index and thickness [reduced mean free paths]. Errors in percent of R
normal, T normal, R diffuse, T diffuse, unscattered light included, of `{default}` against adding-doubling
(`tests/reference/adding.py`):

{forward_table(default)}

By similarity alone R is 78 % too high to 28 % too low there, and T up to 29 % too high. Two cosines per
hemisphere know the first few scatterings only so well: what is left is at most 13 % of R at normal incidence,
where a tenth of the light comes back, and 11 % under diffuse light.

## `{default}`, stack by stack

{stack_table(found, default)}

## Total reflectance at normal incidence, all models

Errors in percent.

{totals_table(found)}

## White furnace

Worst R̂(0) + T̂(0) + ballistic light (none with multipole and grid) - 1, in percent, of slabs that
absorb nothing: .05, .3, 1 and 8 reduced
mean free paths, eta 1, 1.2, 1.4 and 1.5.

{furnace_table(found)}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description="Writes how far every profile model is from the truth.")
    parser.add_argument("--out", type=Path, default=PAGE)
    parser.parse_args().out.write_text(page(measure()))


if __name__ == "__main__":
    main()
