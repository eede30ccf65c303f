"""Sums of Gaussians: the form in which profiles reach the texture."""

from dataclasses import dataclass

import torch

from texsss.errors import DomainError, ShapeError
from texsss.media.medium import check_at_least_zero, expect, number
from texsss.profiles.hankel import real_frequencies
from texsss.types import Float, Tensor


@dataclass(frozen=True, eq=False)
class GaussianSum:
    """Σ_k w_k G(v_k, r) with G(v, r) = e^(-r²/2v) / (2π v), which integrates to 1 over the plane.

    `variances` (K,) [mm²], not negative; 0 is light that comes out where it went in. `weights`
    (..., K, C), of any sign; their sum over K is the total. A value: equal variances are allowed.
    """

    variances: Float[Tensor, " K"]
    weights: Float[Tensor, "*B K C"]

    def __post_init__(self):
        if self.variances.shape[0] != self.weights.shape[-2]:
            raise ShapeError(
                f"GaussianSum: expected one weight per variance, got {self.weights.shape[-2]} for "
                f"{self.variances.shape[0]}; weights are (..., K, C)."
            )
        if not bool((self.variances >= 0).all()):
            raise DomainError(
                "GaussianSum: expected variances >= 0 [mm²], got others; variance_ladder makes some."
            )

    @property
    def total(self) -> Float[Tensor, "*B C"]:
        """Share of the light that comes back, R̂(0)."""
        return self.weights.sum(-2)

    def evaluate(self, r: Float[Tensor, " R"]) -> Float[Tensor, "*B R C"]:
        """R(r) at distances `r` [mm], in 1/mm²; terms of variance 0, all at r = 0, are left out.

        Raises DomainError: for what is no tensor of finite distances >= 0.
        """
        expect("GaussianSum.evaluate", r, Tensor, "distances (R,) as a tensor")
        if r.numel():
            check_at_least_zero("GaussianSum.evaluate", r, "mm")
            if not bool(torch.isfinite(r.detach()).all()):
                raise DomainError(
                    "GaussianSum.evaluate: expected finite distances [mm], got NaN or infinity; drop those."
                )
        wide = self.variances > 0
        v = torch.where(wide, self.variances, torch.ones_like(self.variances))
        basis = torch.exp(-(r[:, None] ** 2) / (2 * v)) / (2 * torch.pi * v) * wide
        return basis @ self.weights

    def hankel(self, s: Float[Tensor, " S"]) -> Float[Tensor, "*B S C"]:
        """R̂(s) at frequencies `s` [1/mm]. Raises DomainError: for such as are negative or not finite."""
        s = real_frequencies("GaussianSum.hankel", s)
        return torch.exp(-(s[:, None] ** 2) * self.variances / 2) @ self.weights

    def radius(self, share: float = 0.99) -> Float[Tensor, "*B C"]:
        """Distance within which `share` of the light comes back [mm]. Not differentiable.

        Raises DomainError: for shares outside 0..1, which no distance holds.
        """
        share = part_of_light("GaussianSum.radius", share)
        low = torch.zeros_like(self.total)
        high = torch.full_like(low, float(self.variances.max().sqrt()) * 12)
        v = torch.where(self.variances > 0, self.variances, torch.full_like(self.variances, 1e-30))[:, None]
        for _ in range(60):
            middle = (low + high) / 2
            outside = (self.weights * torch.exp(-(middle[..., None, :] ** 2) / (2 * v))).sum(-2)
            inside = outside <= (1 - share) * self.total
            low, high = torch.where(inside, low, middle), torch.where(inside, middle, high)
        return high


def part_of_light(name: str, share: float) -> float:
    """A share of the light above 0 and below 1. Raises DomainError: for others."""
    share = number(name, share)
    if not 0 < share < 1:
        raise DomainError(
            f"{name}: expected a share of the light between 0 and 1, got {share:g}; take .99, as no distance "
            "holds all of it."
        )
    return share


# variances [mm²] and weights per RGB of a three-layer skin model
_SKIN_VARIANCES = (0.0064, 0.0484, 0.187, 0.567, 1.99, 7.41)
_SKIN_WEIGHTS = (
    (0.233, 0.455, 0.649),
    (0.100, 0.336, 0.344),
    (0.118, 0.198, 0.0),
    (0.113, 0.007, 0.007),
    (0.358, 0.004, 0.0),
    (0.078, 0.0, 0.0),
)


def human_skin() -> GaussianSum:
    """The six Gaussians fitted to a multipole model of human skin, total 1 per channel.

    Source: d'Eon, Luebke & Enderton 2007, table 1.
    """
    return GaussianSum(
        torch.tensor(_SKIN_VARIANCES, dtype=torch.float64), torch.tensor(_SKIN_WEIGHTS, dtype=torch.float64)
    )
