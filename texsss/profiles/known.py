"""Profiles of half-spaces that are known by Monte Carlo, to hold models against."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import torch

from texsss.media.stack import Stack
from texsss.profiles.incidence import Incidence
from texsss.types import Float, Tensor

TABLE = Path(__file__).with_name("known.json")
SAME = 1e-4  # of the albedo and of eta


@dataclass(frozen=True, eq=False)
class Known:
    """R [1/mm²] over rings of mean radius r [mm], with its standard error."""

    r: Float[Tensor, " R"]
    reflectance: Float[Tensor, " R"]
    error: Float[Tensor, " R"]


def known(stack: Stack, incidence: Incidence) -> list[Known | None]:
    """What Monte Carlo says of each channel of a stack; None where it was not asked.

    Known are half-spaces of isotropic media with the albedos of the presets: with lengths in mean free
    paths, a half-space is its albedo and its refractive index. Rings without photons are left out.
    Source: `python -m benchmarks.known_profiles`, 200,000 photons each.
    """
    medium = stack.layers[0].medium
    sigma_t, albedo = medium.sigma_a + medium.sigma_s, medium.sigma_s / (medium.sigma_a + medium.sigma_s)
    channels = sigma_t.shape[-1]
    endless = len(stack.layers) == 1 and stack.layers[0].thickness is None
    if not endless or stack.varies or bool((medium.g != 0).any()):
        return [None] * channels
    rows = zip(sigma_t.reshape(-1).tolist(), albedo.reshape(-1).tolist(), strict=True)
    return [_found(alpha, float(medium.eta), incidence, per_mm) for per_mm, alpha in rows]


def _found(albedo: float, eta: float, incidence: Incidence, per_mm: float) -> Known | None:
    table = _table()
    for one in table["half_spaces"]:
        near = abs(one["albedo"] - albedo) < SAME and abs(one["eta"] - eta) < SAME
        if near and one["incidence"] == incidence:
            edges = torch.tensor(table["edges"], dtype=torch.float64)
            reflectance = torch.tensor(one["reflectance"], dtype=torch.float64)
            error = torch.tensor(one["error"], dtype=torch.float64)
            some = reflectance > 0
            r = (edges[1:] * edges[:-1]).sqrt() / per_mm
            return Known(r[some], reflectance[some] * per_mm**2, error[some] * per_mm**2)
    return None


@cache
def _table() -> dict:
    return json.loads(TABLE.read_text())
