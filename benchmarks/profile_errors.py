"""The errors of profile models against the Monte Carlo of tests/reference/stacks.json, less its noise."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import inf, nan

import numpy as np
import torch
from reference import layers as plain
from reference.beam import ballistic
from reference.montecarlo import Estimate
from reference.stacks import RINGS, S, Tabulated
from scipy.special import j1

from texsss.errors import DomainError, TexsssError
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.profiles import hankel
from texsss.profiles.burley import Burley, fit_burley
from texsss.profiles.fit import fit_gaussians
from texsss.profiles.gaussians import GaussianSum
from texsss.profiles.hankel import SIDES, hankel_profiles

Array = np.ndarray
Profile = Callable[[Array, str, str], tuple[Array, Array]]
"""R̂, T̂ at s, by scattering and incidence."""

RADIUS = 10.0  # [mm] rings beyond are noise
BEAMLESS = ("multipole", "grid")  # they hand all light to the source, and leave none to the beam


@dataclass(frozen=True)
class Metric:
    """One column of the tables, and what it measures."""

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
    Metric("radial_diffuse", "radial diffuse", "the same under diffuse light", True),
    Metric(
        "far",
        "beyond .3 mm",
        "sqrt(∫ r (R - R_MC)² dr / ∫ r R_MC² dr) over rings from .3 to 10 mm",
        True,
    ),
)


TITLES = [metric.title for metric in METRICS]
NO_ANSWER = dict.fromkeys((metric.key for metric in METRICS), nan)


def model_names() -> list[str]:
    """What `hankel_profiles` offers, its default first."""
    default = inspect.signature(hankel_profiles).parameters["model"].default
    return sorted(hankel.MODELS, key=lambda name: name != default)


FITTED = {
    "grid": "nine Gaussians by products of multipoles on a grid of variances (Mayorga 2008)",
    "burley": "normalised diffusion (Christensen & Burley 2015), fitted to the default model",
}
NAMES = [*model_names(), *FITTED]


def stack_of(layers: list[plain.Layer]) -> Stack:
    """The same stack in texsss."""
    return Stack([Layer(Medium(l.sigma_a, l.sigma_s, l.g, l.eta), l.thickness) for l in layers])


def profiles_of(layers: list[plain.Layer]) -> dict[str, Profile]:
    """Everything that can be asked about this stack, by name."""
    stack = stack_of(layers)

    def model(name: str) -> Profile:
        def evaluate(s: Array, scattering: str, incidence: str) -> tuple[Array, Array]:
            s = torch.as_tensor(s)
            R, T = hankel_profiles(stack, s, model=name, scattering=scattering, incidence=incidence)
            return R[..., 0].numpy(), T[..., 0].numpy()

        return evaluate

    @cache
    def gaussians() -> list[GaussianSum]:
        return [fit_gaussians(stack, fit="grid", side=side) for side in SIDES]

    @cache
    def normalised(incidence: str) -> Burley:
        return fit_burley(stack, incidence=incidence)

    def grid(s: Array, scattering: str, incidence: str) -> tuple[Array, Array]:
        _only_total(scattering)
        R, T = (terms.hankel(torch.as_tensor(s))[..., 0].numpy() for terms in gaussians())
        return R, T

    def burley(s: Array, scattering: str, incidence: str) -> tuple[Array, Array]:
        _only_total(scattering)
        R = normalised(incidence).hankel(torch.as_tensor(s))[..., 0].numpy()
        return R, np.full_like(R, nan)

    half_space = len(layers) == 1 and layers[0].thickness == inf
    models = {name: model(name) for name in model_names() if half_space or "dipole" not in name}
    return {**models, "grid": grid, "burley": burley}


def _only_total(scattering: str) -> None:
    if scattering != "total":
        raise DomainError(f"a fitted sum knows only the total, not {scattering}")


def errors(
    model: str, profile: Profile, layers: list[plain.Layer], normal: Tabulated, diffuse: Tabulated
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
            beam = 0.0 if model in BEAMLESS else ballistic(layers, incidence)[1]
            whole = float(truth.totals["T"].mean + truth.totals["T_ballistic"].mean)
            out["T" + suffix] = (T + beam) / whole - 1
    try:
        truth = normal.hankel["R"].mean - normal.hankel["R1"].mean
        wrong = (profile(S, "multiple", "normal")[0] - truth) / normal.totals["R"].mean
        out["multiple"] = float(wrong[np.argmax(np.abs(wrong))])
    except TexsssError:
        pass  # the model knows only the total
    try:
        out["radial"] = radial_error(profile(S, "total", "normal")[0], normal.hankel["R"])
        out["radial_diffuse"] = radial_error(profile(S, "total", "diffuse")[0], diffuse.hankel["R"])
        out["far"] = ring_error(profile, normal.rings["R"])
    except TexsssError:
        pass  # the model has no profile over r
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
    beam = 0.0 if model in BEAMLESS else sum(ballistic(layers, incidence))
    return float(R[0] + T[0]) + beam - 1


def white_slabs(g: float) -> list[list[plain.Layer]]:
    """Slabs that absorb nothing; the reduced mean free path is 1 mm."""
    return [
        [plain.Layer(0.0, 1 / (1 - g), thickness, g=g, eta=eta)]
        for eta in (1.0, 1.2, 1.4, 1.5)
        for thickness in (0.05, 0.3, 1.0, 8.0)
    ]
