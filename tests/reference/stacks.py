"""The stacks of the accuracy table, and what the Monte Carlo found for them.

    nice -n 10 python -m reference.stacks          (from tests/; writes stacks.json, 6 minutes of one core)

Every entry of stacks.json says how many photons, with which seed, gave it; `[mean, standard error]` each.
"""

import json
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from reference.boundary import Array
from reference.layers import Layer
from reference.montecarlo import BOTTOM, TOP, Estimate, trace

TABLE = Path(__file__).with_name("stacks.json")
S = np.append(0.0, np.geomspace(0.05, 40, 33))  # [1/mm]
RINGS = np.geomspace(0.3, 30, 25)  # [mm] edges
SIDES = {"R": TOP, "T": BOTTOM}
COLLISIONS = 60_000_000  # per run
PHOTONS = (60_000, 1_000_000)  # least and most per run
PILOT = 2_000  # photons that measure the collisions per photon


def half_space(albedo: float, eta: float, sigma_t: float = 1.0) -> list[Layer]:
    return [Layer((1 - albedo) * sigma_t, albedo * sigma_t, eta=eta)]


def slab(albedo: float, eta: float, thickness: float, sigma_t: float = 1.0) -> list[Layer]:
    return [Layer((1 - albedo) * sigma_t, albedo * sigma_t, thickness, eta=eta)]


def coated(eta: float, thickness: float) -> list[Layer]:
    """A bright layer over a dark half-space."""
    return [Layer(0.01, 1.0, thickness, eta=eta), Layer(0.3, 1.5, eta=eta)]


STACKS: dict[str, list[Layer]] = {
    "half-space .4, eta 1": half_space(0.4, 1.0),
    "half-space .4, eta 1.33": half_space(0.4, 1.33),
    "half-space .7, eta 1.5": half_space(0.7, 1.5),
    "half-space .9, eta 1": half_space(0.9, 1.0),
    "half-space .9, eta 1.1": half_space(0.9, 1.1),
    "half-space .9, eta 1.33": half_space(0.9, 1.33),
    "half-space .9, eta 1.6": half_space(0.9, 1.6),
    "half-space .96, eta 1.3 (skin1 red)": [Layer(0.032, 0.74, eta=1.3)],
    "half-space .99, eta 1.2": half_space(0.99, 1.2, 3.0),
    "half-space .99, eta 1.45": half_space(0.99, 1.45),
    "half-space .999, eta 1": half_space(0.999, 1.0, 2.0),
    "half-space .999, eta 1.5 (marble red)": [Layer(0.0021, 2.19, eta=1.5)],
    "slab .05 mm, .99, eta 1.5": slab(0.99, 1.5, 0.05),
    "slab .1 mm, .98, eta 1.5": slab(0.98, 1.5, 0.1, 2.0),
    "slab .1 mm, .9, eta 1": slab(0.9, 1.0, 0.1),
    "slab .3 mm, .95, eta 1.4": slab(0.95, 1.4, 0.3),
    "slab .5 mm, .7, eta 1": slab(0.7, 1.0, 0.5),
    "slab .5 mm, .99, eta 1.6": slab(0.99, 1.6, 0.5, 3.0),
    "slab 1 mm, .96, eta 1.33": slab(0.96, 1.33, 1.0),
    "slab 2 mm, .999, eta 1.2": slab(0.999, 1.2, 2.0),
    "slab 8 mm, .995, eta 1.4": slab(0.995, 1.4, 8.0),
    "bright .05 mm on dark, eta 1": coated(1.0, 0.05),
    "bright .05 mm on dark, eta 1.4": coated(1.4, 0.05),
    "bright .5 mm on dark, eta 1": coated(1.0, 0.5),
    "bright .5 mm on dark, eta 1.4": coated(1.4, 0.5),
    "bright 2 mm on dark, eta 1.4": coated(1.4, 2.0),
    "dark .2 mm on bright, eta 1.33": [Layer(0.5, 0.8, 0.2, eta=1.33), Layer(0.01, 2.0, eta=1.33)],
    "two layers, .6 mm, eta 1.5": [Layer(0.02, 2.0, 0.2, eta=1.5), Layer(0.1, 1.0, 0.4, eta=1.5)],
    "three layers, .65 mm, eta 1": [Layer(0.05, 2.0, 0.1), Layer(0.6, 1.5, 0.15), Layer(0.02, 1.0, 0.4)],
    "three layers, .6 mm, eta 1.4": [
        Layer(0.05, 2.0, 0.1, eta=1.4),
        Layer(0.3, 3.0, 0.1, eta=1.4),
        Layer(0.02, 1.0, 0.4, eta=1.4),
    ],
    "three layers, half-space, eta 1.5": [
        Layer(0.1, 1.0, 0.2, eta=1.5),
        Layer(0.01, 3.0, 0.3, eta=1.5),
        Layer(0.5, 1.0, eta=1.5),
    ],
    "four layers, half-space, eta 1.3": [
        Layer(0.02, 2.0, 0.1, eta=1.3),
        Layer(0.4, 1.0, 0.2, eta=1.3),
        Layer(0.05, 1.5, 1.0, eta=1.3),
        Layer(0.01, 3.0, eta=1.3),
    ],
    "four layers, 5.4 mm, eta 1.45": [
        Layer(0.01, 3.0, 0.1, eta=1.45),
        Layer(0.1, 1.0, 0.3, eta=1.45),
        Layer(0.005, 2.0, 1.0, eta=1.45),
        Layer(0.05, 0.5, 4.0, eta=1.45),
    ],
    "eta 1.4 over 1.3": [Layer(0.02, 1.0, 0.5, eta=1.4), Layer(0.1, 1.5, eta=1.3)],
    "eta 1.3 over 1.5": [Layer(0.02, 1.0, 0.5, eta=1.3), Layer(0.1, 1.5, eta=1.5)],
    "eta 1.5, 1.2, 1.4, 1.4 mm": [
        Layer(0.05, 1.0, 0.2, eta=1.5),
        Layer(0.01, 1.0, 0.2, eta=1.2),
        Layer(0.05, 2.0, 1.0, eta=1.4),
    ],
    "half-space .9, g .8, eta 1.4": [Layer(0.1, 4.5, g=0.8, eta=1.4)],
    "slab 3 mm, .95, g .8, eta 1.4": [Layer(0.05, 4.75, 3.0, g=0.8, eta=1.4)],
    "slab .3 mm, .99, g .8, eta 1": [Layer(0.01, 4.95, 0.3, g=0.8)],
    "g .8 .5 mm on isotropic, eta 1.3": [Layer(0.02, 6.0, 0.5, g=0.8, eta=1.3), Layer(0.2, 1.0, eta=1.3)],
    "eta 1.4, 1.2, 1.3 mm": [Layer(0.01, 2.0, 0.3, eta=1.4), Layer(0.02, 2.0, 1.0, eta=1.2)],
    "eta 1.5, 1.1, 1.3 mm": [Layer(0.01, 2.0, 0.3, eta=1.5), Layer(0.02, 2.0, 1.0, eta=1.1)],
    "eta 1, 1.5, 1.3 mm": [Layer(0.02, 2.0, 1.0), Layer(0.01, 2.0, 0.3, eta=1.5)],
    "clear .05 mm on skin1 red": [Layer(0.0, 0.0, 0.05, eta=1.3), Layer(0.032, 0.74, eta=1.3)],
    "clear .5 mm on skin1 red": [Layer(0.0, 0.0, 0.5, eta=1.3), Layer(0.032, 0.74, eta=1.3)],
    "clear .2 mm, eta 1.5 on 1.3": [Layer(0.0, 0.0, 0.2, eta=1.5), Layer(0.032, 0.74, eta=1.3)],
    "clear .2 mm between, eta 1.4": [
        Layer(0.02, 2.0, 0.3, eta=1.4),
        Layer(0.0, 0.0, 0.2, eta=1.4),
        Layer(0.05, 1.5, eta=1.4),
    ],
    "eta 1.3, 0 mm, on 1.5": [Layer(0.01, 1.0, 0.0, eta=1.3), Layer(0.1, 1.0, eta=1.5)],
    "eta 1.5, 0 mm, on 1.3": [Layer(0.01, 1.0, 0.0, eta=1.5), Layer(0.1, 1.0, eta=1.3)],
}


@dataclass(frozen=True)
class Tabulated:
    """What the Monte Carlo found for one stack under one incidence."""

    layers: list[Layer]
    photons: int
    seed: int
    totals: dict[str, Estimate]  # R R1 R_ballistic T T1 T_ballistic
    hankel: dict[str, Estimate]  # R R1 at S, and at normal incidence T T1
    rings: dict[str, Estimate]  # R T averaged between RINGS [1/mm²]; normal incidence only


def read_stacks(incidence: str) -> dict[str, Tabulated]:
    """All stacks of stacks.json under "normal" or "diffuse" light."""
    rows = json.loads(TABLE.read_text())["stacks"]
    return {
        name: Tabulated(
            STACKS[name],
            row[incidence]["photons"],
            row[incidence]["seed"],
            *(
                {key: Estimate(*np.array(pair)) for key, pair in row[incidence].get(group, {}).items()}
                for group in ("totals", "hankel", "rings")
            ),
        )
        for name, row in rows.items()
    }


def photons_for(layers: list[Layer], incidence: str) -> int:
    """As many photons as COLLISIONS allow, in round numbers."""
    each = float(trace(layers, PILOT, seed=0, incidence=incidence).order.mean())
    return int(np.clip(round(COLLISIONS / (each + 1), -4), *PHOTONS))


def measure(layers: list[Layer], incidence: str, photons: int, seed: int) -> dict:
    """One run, ready for JSON."""
    ends = trace(layers, photons, seed, incidence)
    out: dict = {"photons": photons, "seed": seed, "totals": _pairs(ends.totals)}
    both = incidence == "normal" and layers[-1].thickness < inf
    sides = [(name, side) for name, side in SIDES.items() if name == "R" or both]
    hankel = {name: ends.hankel(side, "scattered", S) for name, side in sides}
    hankel |= {name + "1": ends.hankel(side, "single", S) for name, side in sides}
    out["hankel"] = _pairs(hankel)
    if incidence == "normal":
        out["rings"] = _pairs({name: ends.histogram(side, "scattered", RINGS) for name, side in sides})
    return out


def _pairs(estimates: dict[str, Estimate]) -> dict[str, list]:
    def rounded(x: Array) -> list | float:
        return [float(f"{v:.4g}") for v in x] if np.ndim(x) else float(f"{x:.5g}")

    return {key: [rounded(e.mean), rounded(e.error)] for key, e in estimates.items()}


def main() -> None:
    rows = {}
    for seed, (name, layers) in enumerate(STACKS.items(), start=1):
        rows[name] = {
            incidence: measure(layers, incidence, photons_for(layers, incidence), seed)
            for incidence in ("normal", "diffuse")
        }
        print(f"{name}: {rows[name]['normal']['photons']} photons", flush=True)
    about = {
        "what": "layered Monte Carlo per unit of entered light, [mean, standard error]; R, T: scattered",
        "made by": "python -m reference.stacks, in tests/",
        "s": [float(f"{s:.6g}") for s in S],
        "ring_edges_mm": [float(f"{r:.6g}") for r in RINGS],
    }
    lines = ",\n".join(
        f"{json.dumps(name)}: {json.dumps(row, separators=(',', ':'))}" for name, row in rows.items()
    )
    TABLE.write_text(f'{json.dumps(about)[:-1]}, "stacks": {{\n{lines}\n}}}}\n')


if __name__ == "__main__":
    main()
