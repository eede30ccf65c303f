"""Normalised diffusion: the two exponentials that engines use, fitted to any profile."""

from dataclasses import dataclass
from typing import Any

import torch

from texsss.errors import DomainError, ShapeError
from texsss.media.medium import expect
from texsss.profiles.bands import Band, bands, gathered
from texsss.profiles.hankel import Material, as_table, real_frequencies
from texsss.profiles.incidence import Incidence
from texsss.types import Float, Tensor

NODES = 64
STEPS = 60  # of the search: d is known to 1e-9 of itself
ENDS = (0.06, 6000.0)  # of d, over the finest that is met


@dataclass(frozen=True, eq=False)
class Burley:
    """R(r) = A (e^(-r/d) + e^(-r/3d)) / (8π d r), which integrates to A.

    `albedo` (..., C), `d` (..., C) [mm]. Raises DomainError: unless d > 0. Source: Christensen & Burley 2015.
    """

    albedo: Float[Tensor, "*B C"]
    d: Float[Tensor, "*B C"]

    def __post_init__(self):
        low = float(self.d.detach().amin())
        if not low > 0:
            raise DomainError(f"Burley: expected widths d > 0 [mm], got {low:g}; fit_burley finds them.")

    @property
    def mean_free_path(self) -> Float[Tensor, "*B C"]:
        """That of a half-space so wide under diffuse light [mm]: d (1.9 - A + 3.5 (A - .8)²)."""
        return self.d * (1.9 - self.albedo + 3.5 * (self.albedo - 0.8) ** 2)

    def evaluate(self, r: Float[Tensor, " R"]) -> Float[Tensor, "*B R C"]:
        """R(r) at distances `r` > 0 [mm], in 1/mm². Raises DomainError, ShapeError: for what are none."""
        expect("Burley.evaluate", r, Tensor, "distances (R,) as a tensor")
        if r.ndim != 1 or r.is_complex():
            raise ShapeError(
                f"Burley.evaluate: expected real distances (R,), got shape {tuple(r.shape)} of {r.dtype}; "
                "reshape them, or take their real part."
            )
        if not bool((r.detach() > 0).all()):
            raise DomainError(
                f"Burley.evaluate: expected distances r > 0 [mm], got {float(r.detach().amin()):g}; R has no "
                "bound at 0, so begin beside it."
            )
        d, x = self.d[..., None, :], r[:, None]
        both = torch.exp(-x / d) + torch.exp(-x / (3 * d))
        return self.albedo[..., None, :] * both / (8 * torch.pi * d * x)

    def hankel(self, s: Float[Tensor, " S"]) -> Float[Tensor, "*B S C"]:
        """R̂(s) at frequencies `s` [1/mm]. Raises DomainError, ShapeError: for what are none."""
        s = real_frequencies("Burley.hankel", s)
        x = (self.d[..., None, :] * s[:, None]) ** 2
        return self.albedo[..., None, :] * (torch.rsqrt(1 + x) + 3 * torch.rsqrt(1 + 9 * x)) / 4


def fit_burley(material: Material, *, model: str = "layered-sp3", incidence: Incidence = "diffuse") -> Burley:
    """Normalised diffusion of the same total and the least radial error, per channel, float64.

    Golden-section search over d, not differentiable. `material`: as for `hankel_profiles`.
    """
    table = as_table(material, torch.float64)
    options: dict[str, Any] = {"side": "reflectance", "model": model, "incidence": incidence}
    found = list(bands(table, NODES, **options))
    fits = [_fitted(band) for band in found]
    albedo = gathered(found, [fit.albedo for fit in fits], table)
    return Burley(albedo, gathered(found, [fit.d for fit in fits], table))


def _fitted(band: Band) -> Burley:
    """What fits the rows of a band, (U, C)."""
    sampled = band.sampled.detach()
    albedo = sampled[:, -1]

    def error(logarithm: Tensor) -> Tensor:
        return band.energy(Burley(albedo, logarithm.exp()).hankel(band.s) - sampled[:, :-1])

    golden = (5**0.5 - 1) / 2
    low, high = (torch.full_like(albedo, end / float(band.s[-1])).log() for end in ENDS)
    for _ in range(STEPS):
        left, right = high - golden * (high - low), low + golden * (high - low)
        better = error(left) < error(right)
        low, high = torch.where(better, low, left), torch.where(better, right, high)
    return Burley(albedo, ((low + high) / 2).exp())
