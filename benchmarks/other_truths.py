"""The errors of profile models against two truths that are no Monte Carlo."""

from pathlib import Path

import numpy as np
from reference.adding import totals
from reference.beam import ballistic
from reference.stacks import STACKS
from reference.transport import read_transport

from benchmarks.profile_errors import BEAMLESS, Array, profiles_of
from texsss.errors import TexsssError

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"  # beside the project
INTEGRAL = ("R", "T", "multiple", "radial")
ADDING = ("R", "R_diffuse", "T", "T_diffuse")
ONE_INDEX = {  # what adding-doubling knows
    name: layers
    for name, layers in STACKS.items()
    if len({layer.eta for layer in layers}) == 1 and not any(layer.g for layer in layers)
}


def transport_errors(model: str) -> Array:
    """Errors of a model at normal incidence, columns as INTEGRAL; a row for each stack that it answers."""
    rows = []
    for known in read_transport(SHARED):
        profile = profiles_of(known.layers).get(model)
        if profile is None:
            continue
        R, T = profile(known.s, "total", "normal")
        through = ballistic(known.layers, "normal")[1]
        whole = known.T[0] + through
        have = T[0] + (0 if model in BEAMLESS else through)
        try:
            multiple = np.abs(profile(known.s, "multiple", "normal")[0] - known.Rm).max() / known.R[0]
        except TexsssError:
            multiple = np.nan  # the model knows only the total
        wrong = np.trapezoid(known.s * (R - known.R) ** 2, known.s)
        radial = np.sqrt(wrong / np.trapezoid(known.s * known.R**2, known.s))
        rows.append([R[0] / known.R[0] - 1, have / whole - 1 if whole > 0 else np.nan, multiple, radial])
    return np.array(rows).T


def adding_errors(model: str) -> Array:
    """Errors of totals, unscattered light included, columns as ADDING; a row for each of ONE_INDEX."""
    rows = []
    for layers in ONE_INDEX.values():
        profile = profiles_of(layers).get(model)
        if profile is None:
            continue
        truth, row = totals(layers), []
        for incidence, known in (
            ("normal", (truth.R, truth.T)),
            ("diffuse", (truth.R_diffuse, truth.T_diffuse)),
        ):
            beam = (0.0, 0.0) if model in BEAMLESS else ballistic(layers, incidence)
            have = (x[0] + b for x, b in zip(profile(np.zeros(1), "total", incidence), beam, strict=True))
            row.append([h / k - 1 for h, k in zip(have, known, strict=True)])
        (R, T), (R_diffuse, T_diffuse) = row
        passes = layers[-1].thickness < np.inf
        rows.append([R, R_diffuse, *((T, T_diffuse) if passes else (np.nan, np.nan))])
    return np.array(rows).T
