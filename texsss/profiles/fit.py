"""Profiles as sums of Gaussians on their own, for plots, engines and comparison."""

from numbers import Integral
from typing import Any

import numpy as np
import torch

from texsss.errors import DomainError
from texsss.media.medium import number, told
from texsss.profiles.bands import Band, bands, gathered
from texsss.profiles.gaussians import GaussianSum
from texsss.profiles.grid import grid_gaussians
from texsss.profiles.hankel import SIDES, Material, as_table, choose
from texsss.profiles.incidence import Incidence, incidence_directions
from texsss.profiles.project import check_variances, projector, radial_error
from texsss.types import Float, Tensor

FITS = ("project", "grid", "optimise")
MODEL = "layered-sp3"
TERMS = 8
NODES = 64
NODES_CHECKED = 200
STEPS = 60  # of the optimiser; the error has settled by then
LOST = 0.9  # of the total: where a profile has fallen so far, the widest Gaussian is looked for


def fit_gaussians(
    material: Material,
    variances: Float[Tensor, " K"] | None = None,
    terms: int | None = None,
    *,
    model: str | None = None,
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    side: str = "reflectance",
    fit: str = "project",
    drop_below_mfp: float | None = None,
) -> GaussianSum:
    """A profile as a sum of `terms` Gaussians, 8 unless told, whose weights add up to its total, float64.

    `variances` [mm²]: those to use; None spreads them over the scales of the profile, of all rows where it
    varies. `model`: layered-sp3 unless told. `fit`: project (linear, exact total), optimise (variances move,
    too, from the projected ones), grid (Mayorga's algebra: the total of multipoles, whatever the incidence,
    by nine terms of its own; `drop_below_mfp` is for it alone). Gaussians meet what is wider than a twentieth
    of the mean free path that light finds first, row by row. Differentiable with project and grid.
    Raises DomainError: for unknown names, and what a fit does not know; ConvergenceError: for variances far
    from the profile's scale.
    """
    choose("fit", fit, FITS)
    table = as_table(material, torch.float64)
    if fit == "grid":
        choose("side", side, SIDES)
        incidence_directions(incidence, table.eta[0])
        for name, given, known in (
            ("model", model or "multipole", "multipole"),
            ("scattering", scattering, "total"),
            ("variances", "some" if variances is not None else None, None),
            ("terms", terms, None),
        ):
            if given != known:
                raise DomainError(
                    f"fit_gaussians: expected {name}={known!r} with fit='grid', got {given!r}; "
                    "leave it out, as the grid has its own, or take fit='project'."
                )
        if drop_below_mfp is not None and not number("fit_gaussians.drop_below_mfp", drop_below_mfp) >= 0:
            raise DomainError(
                f"fit_gaussians: expected drop_below_mfp >= 0, got {told(drop_below_mfp)}; take 1.5."
            )
        return grid_gaussians(table, drop_below_mfp=drop_below_mfp)[SIDES.index(side)]
    if drop_below_mfp is not None:
        raise DomainError(
            f"fit_gaussians: expected no drop_below_mfp with fit={fit!r}, got {told(drop_below_mfp)}; "
            "it is for fit='grid', thin layers do no harm here."
        )
    if variances is not None:
        check_variances(variances)
    if terms is not None and not (isinstance(terms, Integral) and terms >= 1):
        raise DomainError(
            f"fit_gaussians: expected a whole number of terms >= 1, got {told(terms)}; 4 to 8 serve well."
        )
    options: dict[str, Any] = {"side": side, "model": model or MODEL}
    options |= {"scattering": scattering, "incidence": incidence}
    found = list(bands(table, NODES, **options))
    if variances is None:
        variances = _spread(found, TERMS if terms is None else terms)
    elif terms not in (None, len(variances)):
        raise DomainError(
            f"fit_gaussians: expected as many terms as variances, got {terms} and {len(variances)}; leave "
            "one out."
        )
    variances = variances.to(found[0].sampled)
    if fit == "optimise":
        variances = _optimised(variances, found)
    weights = [projector(variances, band.s, band.ds) @ band.sampled for band in found]
    return GaussianSum(variances, gathered(found, weights, table))


def fit_error(
    fitted: GaussianSum,
    material: Material,
    *,
    model: str = MODEL,
    incidence: Incidence = "diffuse",
    highest: float | None = None,
) -> Float[Tensor, "*B C"]:
    """√∫ r (R - fit)² dr / √∫ r R² dr, up to `highest` [1/mm]; unless told, 20 / mean free path.

    The mean free path is what light finds first in the row's layers, so that clear, black and absent ones do
    not count. What is finer than its twentieth is not looked at.
    """
    table = as_table(material, torch.float64)
    options: dict[str, Any] = {"side": "reflectance", "model": model, "incidence": incidence}
    found = list(bands(table, NODES_CHECKED, highest=highest, **options))
    weights = fitted.weights.expand(*table.batch, *fitted.weights.shape[-2:])
    weights = weights.reshape(-1, *fitted.weights.shape[-2:])
    wrong = []
    for band in found:
        sums = GaussianSum(fitted.variances, weights[band.rows])
        wrong.append(radial_error(sums, band.sampled[:, :-1], band.s, band.ds))
    return gathered(found, wrong, table)


def _spread(found: list[Band], terms: int) -> Float[Tensor, " K"]:
    """Variances from what the highest frequency resolves to where the profile has lost a tenth.

    They divide evenly what the rows of which light comes back ask for, on a logarithmic axis: scales that no
    row has get none, and a few extreme rows get few.
    """
    narrowest, widest = [], []
    for band in found:
        sampled, s = band.sampled.detach(), band.s
        lost = (sampled[:, :-1] < LOST * sampled[:, -1:]).any(-1)
        first = torch.where(lost, s, s[-1]).amin(-1)
        some = (sampled[:, -1] > 0).any(-1)
        some = some if bool(some.any()) else torch.ones_like(some)
        widest.append((3.0 / first[some] ** 2).log())
        narrowest.append(torch.full_like(widest[-1], -2 * float(s[-1].log())))
    low, high = torch.cat(narrowest), torch.cat(widest)
    edges, order = torch.cat([low, high]).sort()
    share = 1 / (high - low)
    density = torch.cat([share, -share])[order].cumsum(0).clamp_min(0)
    mass = torch.cat([low.new_zeros(1), (density[:-1] * edges.diff()).cumsum(0)])
    wanted = np.linspace(0, 1, terms) if terms > 1 else np.array([0.5])
    return torch.from_numpy(np.exp(np.interp(wanted * float(mass[-1]), mass.numpy(), edges.numpy())))


def _optimised(start: Tensor, found: list[Band]) -> Tensor:
    """Variances of the least radial error, as a mean square; the weights follow by projection."""
    found = [band._replace(sampled=band.sampled.detach()) for band in found]
    count = sum(int((band.energy(band.sampled[:, :-1]) > 0).sum()) for band in found)
    if count == 0:
        return start
    logarithm = start.detach().clamp_min(1e-8).log().requires_grad_()
    search = torch.optim.LBFGS([logarithm], max_iter=STEPS, line_search_fn="strong_wolfe")

    def step() -> Tensor:
        search.zero_grad()
        v = logarithm.exp()
        error = torch.zeros((), dtype=v.dtype)
        for band in found:
            fitted = GaussianSum(v, projector(v, band.s, band.ds) @ band.sampled)
            wrong = band.energy(fitted.hankel(band.s) - band.sampled[:, :-1])
            right = band.energy(band.sampled[:, :-1])
            some = right > 0
            error = error + (wrong[some] / right[some]).sum() / count
        # the optimiser's tolerances are absolute: in the logarithm they are relative
        loss = torch.log(error + 1e-20)
        loss.backward()
        return loss

    search.step(step)
    return logarithm.detach().exp().sort().values
