"""Profiles of the presets by Monte Carlo: `PYTHONPATH=tests python -m benchmarks.known_profiles`.

Writes texsss/profiles/known.json, which the page draws beside the models.
"""

import json

import numpy as np
from reference.layers import Layer
from reference.montecarlo import TOP, trace

from texsss.media.presets import PRESETS, preset
from texsss.profiles.known import TABLE

PHOTONS = 200_000
EDGES = np.geomspace(0.02, 80, 31)  # mean free paths


def half_space(albedo: float, eta: float, incidence: str, seed: int) -> dict:
    """R over rings, lengths in mean free paths."""
    layer = Layer(sigma_a=1 - albedo, sigma_s=albedo, thickness=np.inf, g=0.0, eta=eta)
    rings = trace([layer], PHOTONS, seed, incidence).histogram(TOP, "scattered", EDGES)
    digits = lambda values: [float(f"{value:.3g}") for value in values]  # noqa: E731
    found = {"albedo": round(albedo, 6), "eta": eta, "incidence": incidence}
    return found | {"reflectance": digits(rings.mean), "error": digits(rings.error)}


def main() -> None:
    """Every isotropic preset, each albedo once."""
    wanted = set()
    for name in PRESETS:
        medium = preset(name)
        albedo = (medium.sigma_s / (medium.sigma_a + medium.sigma_s)).double().reshape(-1).tolist()
        if not bool((medium.g != 0).any()):
            wanted |= {(round(one, 6), float(medium.eta)) for one in albedo if one < 1}
    rows = []
    for seed, (albedo, eta) in enumerate(sorted(wanted)):
        for incidence in ("normal", "diffuse"):
            rows.append(half_space(albedo, eta, incidence, seed))
            print(f"{seed + 1}/{len(wanted)}: albedo {albedo}, eta {eta}, {incidence}", flush=True)
    made = {
        "what": "R of half-spaces per unit of light that entered; lengths in mean free paths",
        "made by": f"python -m benchmarks.known_profiles, {PHOTONS} photons each",
        "edges": [float(f"{edge:.5g}") for edge in EDGES],
        "half_spaces": rows,
    }
    TABLE.write_text(json.dumps(made).replace('{"albedo', '\n{"albedo') + "\n")


if __name__ == "__main__":
    main()
