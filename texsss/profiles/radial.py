"""A profile over distance, by the inverse Hankel transform: what sums of Gaussians are held against."""

from functools import cached_property
from typing import Any

import numpy as np
import scipy  # its parts are loaded where they are first used
import torch

from texsss.errors import DomainError
from texsss.media.medium import expect
from texsss.numerics.hankel import inverse_hankel, within
from texsss.profiles.bands import extinction
from texsss.profiles.gaussians import part_of_light
from texsss.profiles.hankel import Material, as_table, flat_profile, real_frequencies
from texsss.profiles.incidence import Incidence
from texsss.types import Float, Tensor

PER_DECADE = 32  # samples of R̂, between which a cubic in log s is within 1e-7 of the total
LOWEST, HIGHEST = -7, 6  # powers of ten of s times the mean free path
NEAREST, FARTHEST = 1e-4, 1e5  # mean free paths between which radii are looked for
RADII = 160  # between which the light within them is a cubic in log r
FINE = 100


class RadialProfile:
    """R(r) of a uniform material, or T(r), by `side`, and how far light goes; float64, not differentiable.

    `material`: a stack, layer or medium without maps. Light that is never scattered (`ballistic`) is not in
    it. Raises DomainError: for maps, and unknown names.
    """

    def __init__(
        self,
        material: Material,
        *,
        model: str = "layered-sp3",
        incidence: Incidence = "diffuse",
        side: str = "reflectance",
    ):
        table = as_table(material, torch.float64)
        if table.batch.numel() > 1:
            raise DomainError(
                f"RadialProfile: expected a uniform material, got maps of {tuple(table.batch)}; take the "
                "mean of each, or hankel_profiles, which knows every texel."
            )
        options: dict[str, Any] = {"side": side, "model": model, "incidence": incidence}
        self._path = 1 / float(extinction(table).max())
        count = (HIGHEST - LOWEST) * PER_DECADE + 1
        s = torch.logspace(LOWEST, HIGHEST, count, dtype=torch.float64) / self._path
        self._ends = float(s[0]), float(s[-1])
        self._sampled = (s, flat_profile(table, s, **options).detach())

    @property
    def total(self) -> Float[Tensor, " C"]:
        """R̂(0), or T̂(0)."""
        return self._sampled[1][0]

    @cached_property
    def _spline(self):
        s, R = self._sampled
        return scipy.interpolate.CubicSpline(s.log().numpy(), R.numpy())

    def hankel(self, s: Float[Tensor, " S"]) -> Float[Tensor, "S C"]:
        """R̂(s) or T̂(s), `s` >= 0 [1/mm]; beyond what was sampled as 1/s, as single scattering.

        Raises DomainError: for frequencies that are negative or not finite.
        """
        return self._at(real_frequencies("RadialProfile.hankel", s))

    def _at(self, s: Float[Tensor, " S"]) -> Float[Tensor, "S C"]:
        low, high = self._ends
        R = torch.from_numpy(self._spline(s.clamp(low, high).log().numpy()))
        return R * (high / s.clamp_min(high))[:, None]

    def evaluate(self, r: Float[Tensor, " R"]) -> Float[Tensor, "R C"]:
        """R(r) or T(r) at distances `r` > 0 [mm], in 1/mm².

        Raises DomainError: for what is no tensor of finite distances > 0.
        """
        expect("RadialProfile.evaluate", r, Tensor, "distances (R,) as a tensor")
        return inverse_hankel(self._at, r)

    def radius(self, share: float = 0.99) -> Float[Tensor, " C"]:
        """Distance within which `share` of this light leaves [mm]; 0 where none does.

        Raises DomainError: for shares outside 0..1, which no distance holds.
        """
        share = part_of_light("RadialProfile.radius", share)
        logarithm, within_them = self._cumulated
        wanted = share * self.total.numpy()
        found = [np.interp(one, inside, logarithm) for one, inside in zip(wanted, within_them.T, strict=True)]
        return torch.where(self.total > 0, torch.from_numpy(np.exp(found)), 0)

    @cached_property
    def _cumulated(self) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms of radii, and the light within them (·, C), which never falls."""
        nearest, farthest = np.log(NEAREST * self._path), np.log(FARTHEST * self._path)
        coarse = np.linspace(nearest, farthest, RADII)
        inside = within(self._at, torch.from_numpy(np.exp(coarse))).numpy()
        fine = np.linspace(nearest, farthest, FINE * RADII)
        smooth = scipy.interpolate.CubicSpline(coarse, inside)(fine)
        return fine, np.maximum.accumulate(smooth)
