"""Normalised diffusion: the two exponentials that engines use, fitted to any profile."""

from dataclasses import dataclass

import torch

from texsss.numerics.quadrature import graded
from texsss.profiles.hankel import Material, as_table, flat_profile, unflattened
from texsss.profiles.incidence import Incidence
from texsss.types import Float, Tensor


@dataclass(frozen=True, eq=False)
class Burley:
    """R(r) = A (e^(-r/d) + e^(-r/3d)) / (8π d r), which integrates to A.

    `albedo` (..., C), `d` (..., C) [mm]. Source: Christensen & Burley 2015.
    """

    albedo: Float[Tensor, "*B C"]
    d: Float[Tensor, "*B C"]

    @property
    def mean_free_path(self) -> Float[Tensor, "*B C"]:
        """That of a half-space so wide under diffuse light [mm]: d (1.9 - A + 3.5 (A - .8)²)."""
        return self.d * (1.9 - self.albedo + 3.5 * (self.albedo - 0.8) ** 2)

    def evaluate(self, r: Float[Tensor, " R"]) -> Float[Tensor, "*B R C"]:
        """R(r) at distances `r` > 0 [mm], in 1/mm²."""
        d, x = self.d[..., None, :], r[:, None]
        both = torch.exp(-x / d) + torch.exp(-x / (3 * d))
        return self.albedo[..., None, :] * both / (8 * torch.pi * d * x)

    def hankel(self, s: Float[Tensor, " S"]) -> Float[Tensor, "*B S C"]:
        """R̂(s) at frequencies `s` [1/mm]."""
        x = (self.d[..., None, :] * s[:, None]) ** 2
        return self.albedo[..., None, :] * (torch.rsqrt(1 + x) + 3 * torch.rsqrt(1 + 9 * x)) / 4


def fit_burley(material: Material, *, model: str = "layered-sp3", incidence: Incidence = "diffuse") -> Burley:
    """Normalised diffusion of the same total and the least radial error, per channel, float64.

    Golden-section search over d, not differentiable. `material`: as for `hankel_profiles`.
    """
    table = as_table(material, torch.float64)
    reduced = table.sigma_s[..., 0, :] * (1 - table.g[..., 0, :])
    path = 1 / (table.sigma_a[..., 0, :] + reduced).clamp_min(1e-6)
    s, ds = graded(64, 20 / float(path.min()), grading=7.0)
    s = torch.cat([s, s.new_zeros(1)])
    sampled = unflattened(flat_profile(table, s, side="reflectance", model=model, incidence=incidence), table)
    sampled = sampled.detach()
    albedo, weight = sampled[..., -1, :], (s[:-1] * ds)[:, None]

    def error(logarithm: Tensor) -> Tensor:
        fitted = Burley(albedo, logarithm.exp()).hankel(s[:-1])
        return (weight * (fitted - sampled[..., :-1, :]) ** 2).sum(-2)

    golden = (5**0.5 - 1) / 2
    low, high = (path * 0.003).log(), (path * 300).log()
    for _ in range(60):
        left, right = high - golden * (high - low), low + golden * (high - low)
        better = error(left) < error(right)
        low, high = torch.where(better, low, left), torch.where(better, right, high)
    return Burley(albedo, ((low + high) / 2).exp())
