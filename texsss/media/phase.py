"""Phase functions: how light that is scattered spreads over directions [1/sr]."""

import math

import numpy as np
import torch

from texsss.errors import DomainError
from texsss.types import Tensor

PHASES = ("isotropic", "henyey-greenstein", "schlick")
"""Names that `phase_function` knows."""


def henyey_greenstein(cosine: float | Tensor, g: Tensor) -> Tensor:
    """Density [1/sr] at the cosine of deflection (1 is straight on), of mean cosine `g`.

    Source: Henyey & Greenstein 1941.
    """
    return (1 - g**2) / (4 * torch.pi * (1 + g**2 - 2 * g * cosine) ** 1.5)


def schlick(cosine: float | Tensor, k: Tensor) -> Tensor:
    """Density [1/sr] at the cosine of deflection (1 is straight on), elongated by `k` in -1..1.

    `k` is not the mean cosine: k = .8 has a mean cosine of .63. Source: Blasi et al. 1993.
    """
    return (1 - k**2) / (4 * torch.pi * (1 - k * cosine) ** 2)


def schlick_k(mean: Tensor) -> Tensor:
    """The k of `schlick` whose mean cosine is `mean`, which lies within -1..1. Without gradients.

    Mean cosine: 1 / k + (1 - k²) / (2 k²) ln((1 - k) / (1 + k)), halved upon until float64 ends.
    """
    wanted = mean.detach().abs().double().clamp_max(1 - 1e-9)
    low, high = torch.zeros_like(wanted), torch.ones_like(wanted)
    for _ in range(60):
        k = ((low + high) / 2).clamp_min(1e-6)
        log = torch.log1p(-k) - torch.log1p(k)
        series = k * (2 / 3 + k**2 * (2 / 15 + k**2 * 2 / 35))  # where differences lose their digits
        reached = torch.where(k < 0.05, series, 1 / k + (1 - k**2) / (2 * k**2) * log)
        low, high = torch.where(reached < wanted, k, low), torch.where(reached < wanted, high, k)
    return (torch.where(wanted > 1e-9, (low + high) / 2, 0) * mean.sign()).to(mean)


def phase_function(name: str, cosine: float | Tensor, g: Tensor) -> Tensor:
    """Density [1/sr] at the cosine of deflection, by name; `g` is the k of schlick, and unused by isotropic.

    Differentiable. Raises DomainError: for an unknown name; the choices are listed.
    """
    if name == "isotropic":
        return torch.full_like(g, 1 / (4 * math.pi))
    if name == "henyey-greenstein":
        return henyey_greenstein(cosine, g)
    if name == "schlick":
        return schlick(cosine, g)
    raise DomainError(f"phase: expected one of {', '.join(PHASES)}, got {name!r}.")


def between_cones(name: str, first: float, second: float, g: Tensor, count: int = 12) -> Tensor:
    """Mean density [1/sr] between directions at cosines `first` and `second` to one axis, over azimuth.

    Both directions are those of travel. Differentiable in `g`.
    """
    across = math.sqrt(max(1 - first**2, 0) * max(1 - second**2, 0))
    if across < 1e-9 or name == "isotropic":
        return phase_function(name, first * second, g)
    turns = (np.arange(count) + 0.5) * math.pi / count
    mean = torch.zeros_like(g)
    for azimuth in turns:
        cosine = first * second + across * math.cos(azimuth)
        mean = mean + phase_function(name, cosine, g) / count
    return mean
