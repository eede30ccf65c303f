"""Profiles as sums of Gaussians on their own, for plots, engines and comparison."""

import torch

from texsss.errors import DomainError
from texsss.media.stack import LayerTable
from texsss.numerics.quadrature import graded
from texsss.profiles.gaussians import GaussianSum
from texsss.profiles.grid import grid_gaussians
from texsss.profiles.hankel import Material, as_table, choose, flat_profile, unflattened
from texsss.profiles.incidence import Incidence
from texsss.profiles.project import projector, radial_error
from texsss.types import Float, Tensor

FITS = ("project", "grid", "optimise")
NODES = 64
STEPS = 60  # of the optimiser; the error has settled by then


def fit_gaussians(
    material: Material,
    variances: Float[Tensor, " K"] | None = None,
    terms: int = 8,
    *,
    model: str = "layered-sp3",
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    side: str = "reflectance",
    fit: str = "project",
    drop_below_mfp: float | None = None,
) -> GaussianSum:
    """A profile as a sum of `terms` Gaussians whose weights add up to its total, float64.

    `variances` [mm²]: those to use; None spreads them over the scales of the profile. `fit`: project
    (linear, exact total), grid (Mayorga's algebra: multipoles, nine terms of its own, `drop_below_mfp`),
    optimise (variances move too, from the projected ones). Differentiable with project and grid.
    Raises DomainError: for unknown names; ConvergenceError: for variances far from the profile's scale.
    """
    choose("fit", fit, FITS)
    table = as_table(material, torch.float64)
    if fit == "grid":
        return grid_gaussians(table, drop_below_mfp=drop_below_mfp)[0 if side == "reflectance" else 1]
    options = {"side": side, "model": model, "scattering": scattering, "incidence": incidence}
    high = 20 / _mean_free_path(table)
    s, ds = graded(NODES, high, grading=7.0)
    sampled = unflattened(flat_profile(table, torch.cat([s, s.new_zeros(1)]), **options), table)
    if variances is None:
        variances = _spread(sampled, s, high, terms)
    variances = variances.to(sampled)
    if fit == "optimise":
        variances = _optimised(variances, sampled, s, ds)
    return GaussianSum(variances, projector(variances, s, ds) @ sampled)


def fit_error(
    fitted: GaussianSum,
    material: Material,
    *,
    model: str = "layered-sp3",
    incidence: Incidence = "diffuse",
    highest: float | None = None,
) -> Float[Tensor, "*B C"]:
    """√∫ r (R - fit)² dr / √∫ r R² dr, up to `highest` [1/mm], 20 / mean free path unless told."""
    table = as_table(material, torch.float64)
    s, ds = graded(200, highest or 20 / _mean_free_path(table), grading=7.0)
    flat = flat_profile(table, s, side="reflectance", model=model, incidence=incidence)
    return radial_error(fitted, unflattened(flat, table), s, ds)


def _mean_free_path(table: LayerTable) -> float:
    """The shortest one of the first layer [mm]."""
    reduced = table.sigma_s[..., 0, :] * (1 - table.g[..., 0, :])
    return 1 / max(float((table.sigma_a[..., 0, :] + reduced).detach().max()), 1e-6)


def _spread(sampled: Tensor, s: Tensor, high: float, terms: int) -> Float[Tensor, " K"]:
    """Variances from what the highest frequency resolves to where the profile has lost a tenth."""
    if terms < 1:
        raise DomainError(f"fit_gaussians: expected at least one term, got {terms}; 4 to 8 serve well.")
    lost = sampled[..., :-1, :] < 0.9 * sampled[..., -1:, :]
    first = s[lost.flatten(0, -3).any(0).any(-1) if sampled.ndim > 2 else lost.any(-1)]
    widest = 3.0 / float(first.min() if first.numel() else s[-1]) ** 2
    narrowest = (1 / high) ** 2
    if terms == 1:
        return s.new_tensor([(narrowest * widest) ** 0.5])
    return torch.logspace(
        torch.tensor(narrowest).log10().item(),
        torch.tensor(widest).log10().item(),
        terms,
        dtype=torch.float64,
    )


def _optimised(start: Tensor, sampled: Tensor, s: Tensor, ds: Tensor) -> Tensor:
    """Variances that minimise the radial error, the weights following by projection at every step."""
    weight = (s * ds)[:, None]
    sampled = sampled.detach()
    size = (weight * sampled[..., :-1, :] ** 2).sum()
    logarithm = start.detach().clamp_min(1e-8).log().requires_grad_()
    search = torch.optim.LBFGS([logarithm], max_iter=STEPS, line_search_fn="strong_wolfe")

    def step() -> Tensor:
        search.zero_grad()
        v = logarithm.exp()
        fitted = GaussianSum(v, projector(v, s, ds) @ sampled)
        error = (weight * (fitted.hankel(s) - sampled[..., :-1, :]) ** 2).sum() / size
        error.backward()
        return error

    search.step(step)
    return logarithm.detach().exp().sort().values
