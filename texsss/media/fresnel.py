"""Unpolarised Fresnel reflection at a smooth interface, and its moments over the hemisphere."""

import math
from typing import overload

import numpy as np
import torch

from texsss.errors import DomainError
from texsss.types import Tensor

# Gauss nodes of (0, 1), crowded towards 0 by t³, where reflectance changes fastest as eta approaches 1
_T, _W = (torch.from_numpy(x) for x in np.polynomial.legendre.leggauss(64))
_MU = ((_T + 1) / 2) ** 3
_DMU = _W / 2 * 3 * ((_T + 1) / 2) ** 2


@overload
def reflectance(cos_theta: Tensor, eta: float | Tensor) -> Tensor: ...
@overload
def reflectance(cos_theta: float, eta: Tensor) -> Tensor: ...
@overload
def reflectance(cos_theta: float, eta: float) -> float: ...
def reflectance(cos_theta: float | Tensor, eta: float | Tensor) -> float | Tensor:
    """Share of unpolarised light that a smooth interface reflects, 0..1.

    `cos_theta`: cosine between the normal and the light on the outside, clamped to 0..1. `eta` =
    inside / outside; below 1 there is total reflection. Light that arrives from inside is the same
    function of the inner cosine at 1 / eta. Numbers or tensors that broadcast; numbers give a number.
    Differentiable in both but at the critical angle. Raises DomainError: when eta is not above 0.
    Source: Born & Wolf, Principles of Optics, 1.5.2.
    """
    if not isinstance(cos_theta, Tensor) and not isinstance(eta, Tensor):
        return float(reflectance(torch.tensor(cos_theta, dtype=torch.float64), eta))
    _check(eta)
    if not isinstance(cos_theta, Tensor):
        assert isinstance(eta, Tensor)
        cos_theta = torch.full_like(eta, cos_theta)
    mu = cos_theta.clamp(0, 1)
    cos2 = 1 - (1 - mu * mu) / (eta * eta)  # of the refracted direction, by Snell
    passes = cos2 > 0
    inner = torch.sqrt(torch.where(passes, cos2, torch.ones_like(cos2)))
    across = (mu - eta * inner) / (mu + eta * inner)
    along = (eta * mu - inner) / (eta * mu + inner)
    share = (across * across + along * along) / 2
    share = torch.where(passes, share, torch.ones_like(share))
    # equal indices are no interface, at grazing too, where the quotients are 0 / 0
    return share * torch.as_tensor(eta != 1, dtype=share.dtype, device=share.device)


@overload
def transmittance(cos_theta: Tensor, eta: float | Tensor) -> Tensor: ...
@overload
def transmittance(cos_theta: float, eta: Tensor) -> Tensor: ...
@overload
def transmittance(cos_theta: float, eta: float) -> float: ...
def transmittance(cos_theta: float | Tensor, eta: float | Tensor) -> float | Tensor:
    """Share of unpolarised light that passes a smooth interface, 0..1: 1 - `reflectance`."""
    return 1 - reflectance(cos_theta, eta)


@overload
def moments(eta: float) -> tuple[float, float]: ...
@overload
def moments(eta: Tensor) -> tuple[Tensor, Tensor]: ...
def moments(eta: float | Tensor) -> tuple[float, float] | tuple[Tensor, Tensor]:
    """C1 = ∫ F μ dμ and C2 = ∫ F μ² dμ over μ in 0..1, of light that arrives from *inside*.

    `eta` = inside / outside, a number or a tensor of any shape; both moments are 0 at eta = 1.
    Computed in float64 (quadrature error below 1e-9), returned in the dtype of `eta`.
    Differentiable in eta. Raises DomainError: when eta is not above 0.
    Source: d'Eon & Irving 2011, appendix.
    """
    if not isinstance(eta, Tensor):
        c1, c2 = moments(torch.tensor(eta, dtype=torch.float64))
        return float(c1), float(c2)
    _check(eta)
    n = eta.double()[..., None]
    nodes, widths = _MU.to(n.device), _DMU.to(n.device)
    # eta ≤ 1: nothing is totally reflected, integrate over the inner cosine
    inner = reflectance(nodes, torch.where(n < 1, 1 / n, torch.ones_like(n))) * widths
    thin1, thin2 = (inner * nodes).sum(-1), (inner * nodes**2).sum(-1)
    # eta > 1: all is reflected up to the critical cosine; beyond it μ dμ = μ_o dμ_o / eta², μ_o outside
    dense = torch.where(n > 1, n, torch.full_like(n, 2.0))
    critical = torch.sqrt(1 - 1 / dense**2)
    mu = torch.sqrt(1 - (1 - nodes**2) / dense**2)
    outer = reflectance(nodes, dense) * widths * nodes / dense**2
    dense1 = critical[..., 0] ** 2 / 2 + outer.sum(-1)
    dense2 = critical[..., 0] ** 3 / 3 + (outer * mu).sum(-1)
    c1, c2 = torch.where(eta > 1, dense1, thin1), torch.where(eta > 1, dense2, thin2)
    return c1.to(eta.dtype), c2.to(eta.dtype)


@overload
def A(eta: float) -> float: ...
@overload
def A(eta: Tensor) -> Tensor: ...
def A(eta: float | Tensor) -> float | Tensor:
    """Boundary factor (1 + 3 C2) / (1 - 2 C1): fluence vanishes at z_b = 2 A D above the surface.

    `eta` = inside / outside; 1 at eta = 1. Differentiable in eta. Source: d'Eon & Irving 2011, eq. 8.
    """
    c1, c2 = moments(eta)
    return (1 + 3 * c2) / (1 - 2 * c1)


@overload
def F_dt(eta: float) -> float: ...
@overload
def F_dt(eta: Tensor) -> Tensor: ...
def F_dt(eta: float | Tensor) -> float | Tensor:
    """Share of diffuse light arriving from *outside* that enters, 1 - 2 C1(1 / eta): .92 at eta 1.4.

    `eta` = inside / outside; 1 at eta = 1. Differentiable in eta.
    Source: Jensen et al. 2001, where the moment from outside is meant.
    """
    c1, _ = moments(1 / eta)
    return 1 - 2 * c1


def _check(eta: float | Tensor) -> None:
    low, high = (float(e) for e in eta.detach().aminmax()) if isinstance(eta, Tensor) else (eta, eta)
    if not (low > 0 and math.isfinite(high)):
        raise DomainError(
            f"Fresnel: expected a finite eta > 0, got {low if not low > 0 else high}; "
            "eta is the refractive index inside / outside, 1.3 to 1.5 for most materials."
        )
