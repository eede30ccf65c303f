"""The scattering profile of a scene's material as numbers to plot and to compare."""

from typing import Any

import torch

from texsss import resolve
from texsss.media.presets import PRESETS, preset
from texsss.media.stack import Stack
from texsss.pipeline import Run
from texsss.profiles.fit import fit_error, fit_gaussians
from texsss.profiles.known import Known, known
from texsss.profiles.radial import RadialProfile
from texsss.types import Float, Tensor, check_cancelled

RADII = 96
SHARES = (0.5, 0.9, 0.99)


def curve(run: Run) -> dict:
    """R(r) of the material's layers [1/mm²], its Gaussians and its lengths, as plain values per channel.

    Maps count by their mean. `reflectance_per_mm2` and `radius_mm`, within which a share of the light comes
    back, are the profile's own, by the inverse Hankel transform. `gaussians`: a sum at the profile's scales,
    with what it makes of R(r), and `fit_error` how far it is off, radially weighted. Mean free path and
    diffusion length [mm] are of the outermost layer;
    `monte_carlo`: what photons say, for media where they were asked, else None.
    Raises DomainError: when a medium is unknown.
    """
    scene, methods = run.scene, run.scene.methods
    means = {name: run.image(name).value.mean((0, 1), keepdim=True) for name in resolve.material_maps(scene)}
    stack = resolve.stack(scene, means)
    options: dict[str, Any] = {"model": methods.profile, "incidence": methods.arriving}
    check_cancelled(run.cancel)
    profile = RadialProfile(stack, **options)
    radii = {f"{share:g}": profile.radius(share) for share in SHARES}
    check_cancelled(run.cancel)
    fitted = fit_gaussians(stack, terms=methods.terms, **options)
    check_cancelled(run.cancel)
    farthest = float(radii[f"{SHARES[-1]:g}"].max().clamp_min(1e-3))
    r = torch.linspace(0, 1, RADII + 1, dtype=torch.float64)[1:] ** 2 * farthest  # dense where it is steep
    medium = stack.layers[0].medium
    return {
        "r_mm": r.tolist(),
        "reflectance_per_mm2": profile.evaluate(r).tolist(),
        "total": _row(fitted.total),
        "gaussians": {
            "variances_mm2": fitted.variances.tolist(),
            "weights": _rows(fitted.weights),
            "reflectance_per_mm2": _rows(fitted.evaluate(r)),
        },
        "radius_mm": {share: radius.tolist() for share, radius in radii.items()},
        "mean_free_path_mm": _finite(medium.mean_free_path),
        "diffusion_length_mm": _finite(medium.diffusion_length),
        "fit_error": _row(fit_error(fitted, stack, **options)),
        "monte_carlo": [_rings(one) for one in known(stack, methods.arriving)],
        "layers": _layers(stack),
        "methods": methods.model_dump(include={"profile", "incidence", "terms"}),
    }


def presets() -> list[dict]:
    """Every medium that a scene may name: its coefficients [1/mm] and mean free path [mm] per channel."""
    found = []
    for name in PRESETS:
        medium = preset(name)
        entry = {
            "name": name,
            "sigma_a_per_mm": _finite(medium.sigma_a),
            "sigma_s_per_mm": _finite(medium.sigma_s),
        }
        entry |= {"g": _finite(medium.g), "eta": float(medium.eta)}
        found.append(entry | {"mean_free_path_mm": _finite(medium.mean_free_path)})
    return found


def _rows(values: Float[Tensor, "*B N C"]) -> list[list[float]]:
    """A single table, whatever the batch: everything in it is uniform."""
    return values.reshape(-1, *values.shape[-2:])[0].tolist()


def _row(values: Float[Tensor, "*B C"]) -> list[float]:
    return values.reshape(-1, values.shape[-1])[0].tolist()


def _rings(one: Known | None) -> dict[str, list[float]] | None:
    if one is None:
        return None
    return {
        "r_mm": one.r.tolist(),
        "reflectance_per_mm2": one.reflectance.tolist(),
        "error_per_mm2": one.error.tolist(),
    }


def _finite(values: Tensor) -> list[float | None]:
    """One number per channel; None for lengths without end."""
    flat = values.reshape(-1, values.shape[-1])[0].tolist()
    return [value if abs(value) < float("inf") else None for value in flat]


def _layers(stack: Stack) -> list[dict]:
    return [
        {
            "sigma_a_per_mm": _finite(layer.medium.sigma_a),
            "sigma_s_per_mm": _finite(layer.medium.sigma_s),
            "g": _finite(layer.medium.g),
            "eta": float(layer.medium.eta),
            "thickness_mm": None if layer.thickness is None else _finite(layer.thickness)[0],
        }
        for layer in stack.layers
    ]
