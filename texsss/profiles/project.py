"""Profiles onto a fixed ladder of Gaussians, by one linear map per ladder."""

import math

import torch

from texsss.errors import ConvergenceError, DomainError
from texsss.numerics.quadrature import graded
from texsss.profiles.gaussians import GaussianSum
from texsss.types import Float, Tensor

NARROWEST_TEXELS = 0.6  # std of the narrowest positive Gaussian [texels]; below it a texel cannot tell
WIDEST_SHARE = 0.035  # std of the widest [extents] on large objects
WIDEST_MM = 14.0  # std of the widest on small ones, which holds what chicken and potato spread ...
WIDEST_SMALL = 0.2  # ... but never more than this share of the extent
ENOUGH = 8  # terms that reach so far; fewer reach less, in proportion, or they would stand too far apart
GROWTH = 1.3  # longest step / shortest, on a logarithmic axis: .2 to .7 of the error of even steps
NODES = 16  # frequencies: more change the fit by less than .02 % of the profile
RIDGE = 1e-6  # relative; keeps weights tame where the ladder is finer than the profile


def variance_ladder(texel_mm: float, extent_mm: float, terms: int = 8) -> Float[Tensor, " K"]:
    """Variances [mm²] of the Gaussians that serve every material on a texture, ascending, float64.

    0 first, for light that comes out within its texel; then deviations from .6 texels to 3.5 % of the
    object's extent, in steps that grow outwards. On small objects they reach to 14 mm, less in proportion
    where terms are fewer than 8, and at most a fifth of the extent. It depends on geometry alone, so that
    blurred lightmaps outlive the material.
    Raises DomainError: for sizes not above zero, or no terms.
    """
    for name, value in (("texel_mm", texel_mm), ("extent_mm", extent_mm)):
        if not (math.isfinite(value) and value > 0):
            raise DomainError(
                f"variance_ladder: expected {name} > 0 [mm], got {value:g}; check the unit of the mesh."
            )
    if terms < 1:
        raise DomainError(f"variance_ladder: expected at least one term, got {terms}; 6 to 10 serve well.")
    low = NARROWEST_TEXELS * texel_mm
    far = WIDEST_MM * min(terms / ENOUGH, 1)
    high = max(min(WIDEST_SMALL * extent_mm, max(WIDEST_SHARE * extent_mm, far)), 2 * low)
    if terms <= 2:  # no room for a sequence: one width between the ends
        positive = torch.full((terms - 1,), low * high, dtype=torch.float64)
    else:
        steps = torch.linspace(1, GROWTH, terms - 2, dtype=torch.float64)
        steps[0] = GROWTH  # beside the variance of 0, which is the tip of every profile
        along = torch.cat([steps.new_zeros(1), steps.cumsum(0)]) / steps.sum()
        positive = (low * (high / low) ** along).square()
    return torch.cat([torch.zeros(1, dtype=torch.float64), positive])


def frequencies(
    variances: Float[Tensor, " K"], count: int = NODES
) -> tuple[Float[Tensor, " S"], Float[Tensor, " S"]]:
    """Hankel frequencies [1/mm] and quadrature weights at which a profile is sampled for a ladder, float64.

    They reach the Nyquist frequency π / texel that belongs to the narrowest positive variance.
    Raises DomainError: for variances that are none.
    """
    check_variances(variances)
    positive = variances[variances > 0]
    narrow = float(positive.min().sqrt()) if positive.numel() else 1.0
    return graded(count, math.pi * NARROWEST_TEXELS / narrow)


def check_variances(variances: Float[Tensor, " K"]) -> None:
    """Raises DomainError: for variances that are none."""
    known = isinstance(variances, Tensor) and variances.ndim == 1 and variances.numel()
    known = known and not variances.is_complex()
    if not known or not bool(((variances >= 0) & (variances < math.inf)).all()):
        what = variances.tolist() if isinstance(variances, Tensor) else variances
        raise DomainError(
            f"Gaussians: expected a tensor (K,) of finite variances >= 0 [mm²], got {what!r:.60}; "
            "variance_ladder makes some."
        )


def projector(
    variances: Float[Tensor, " K"], s: Float[Tensor, " S"], ds: Float[Tensor, " S"]
) -> Float[Tensor, "K S+1"]:
    """The linear map from (R̂(s_1) … R̂(s_S), R̂(0)) to weights, float64.

    Least squares of ∫ s (R̂ - Σ w e^(-v s²/2))² ds, which by Parseval is the radial error
    ∫ r (R - Σ w G)² dr of d'Eon et al. 2007, subject to Σ w = R̂(0) exactly.
    Raises ConvergenceError: when the variances are so far off that nothing determines the weights.
    """
    s, ds, variances = s.double(), ds.double(), variances.double()
    count = variances.shape[0]
    basis = torch.exp(-(s[:, None] ** 2) * variances / 2)
    weighted = basis * (s * ds)[:, None]
    normal = weighted.T @ basis
    normal = normal + RIDGE * normal.diagonal().mean() * torch.eye(count, dtype=normal.dtype)
    # Lagrange's conditions of the constrained problem
    system = torch.ones(count + 1, count + 1, dtype=normal.dtype)
    system[:count, :count] = normal
    system[count, count] = 0
    right = torch.zeros(count + 1, s.shape[0] + 1, dtype=normal.dtype)
    right[:count, :-1] = weighted.T
    right[count, -1] = 1
    try:
        return torch.linalg.solve(system, right)[:count]
    except RuntimeError:  # LinAlgError among them
        raise ConvergenceError(
            f"projector: the profile has nothing in common with Gaussians of {variances.tolist()} mm²; "
            "choose variances of its own scale, or leave them out."
        ) from None


def project(
    spectrum: Float[Tensor, "*B S C"], total: Float[Tensor, "*B C"], variances: Float[Tensor, " K"]
) -> Float[Tensor, "*B K C"]:
    """Weights of the ladder `variances` [mm²] for a profile sampled at `frequencies(variances, S)`.

    `spectrum` (..., S, C) holds R̂(s), `total` (..., C) is R̂(0); the weights sum to it. They may be
    slightly negative, which is right. Linear, hence differentiable, in both.
    """
    s, ds = frequencies(variances, spectrum.shape[-2])
    matrix = projector(variances, s, ds).to(spectrum)
    return matrix @ torch.cat([spectrum, total[..., None, :]], -2)


def radial_error(
    fit: GaussianSum, spectrum: Float[Tensor, "*B S C"], s: Float[Tensor, " S"], ds: Float[Tensor, " S"]
) -> Float[Tensor, "*B C"]:
    """√∫ r (R - fit)² dr / √∫ r R² dr, the metric of d'Eon et al. 2007, by Parseval over `s`, `ds`.

    0 where nothing comes back.
    """
    weight = (s * ds)[:, None]
    wrong = (weight * (fit.hankel(s) - spectrum) ** 2).sum(-2)
    right = (weight * spectrum**2).sum(-2)
    some = right > 0
    return torch.where(some, torch.sqrt(wrong / torch.where(some, right, 1)), 0)
