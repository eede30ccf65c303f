"""The classical dipole of a half-space, at a distance and in Hankel space: `dipole`."""

import torch

from texsss.errors import DomainError
from texsss.media.medium import Medium
from texsss.media.stack import LayerTable
from texsss.profiles.slab import TINY, layers_of
from texsss.types import Float, Tensor


def egan_A(eta: float) -> float:
    """Boundary factor (1 + F_dr) / (1 - F_dr) with the polynomial fit of the diffuse reflectance.

    Source: Egan et al. 1973, as in Jensen et al. 2001. Either fit is .0017 at eta 1, where 0 takes its place.
    """
    if eta < 1:
        F_dr = -0.4399 + 0.7099 / eta - 0.3319 / eta**2 + 0.0636 / eta**3
    elif eta == 1:
        F_dr = 0.0
    else:
        F_dr = -1.4399 / eta**2 + 0.7099 / eta + 0.6681 + 0.0636 * eta
    return (1 + F_dr) / (1 - F_dr)


def pole(r: Tensor, z: Tensor, sigma_tr: Tensor) -> Tensor:
    """Flux through the surface from a source at depth z, z (1 + σ d) e^(-σ d) / (2π d³) [1/mm²]."""
    d = torch.hypot(r, z)
    x = sigma_tr * d
    return z * (1 + x) * torch.exp(-x) / (2 * torch.pi * d**3)


def dipole(r: Float[Tensor, " R"], medium: Medium) -> Float[Tensor, "R C"]:
    """Diffuse reflectance R_d(r) of a half-space under a pencil beam [1/mm²].

    `r` [mm] is the distance from entry to exit point. `medium` is uniform, with D = 1 / (3 sigma_t').
    Differentiable in both. Raises DomainError: when a coefficient is a map.
    Source: Jensen et al. 2001, eq. 4.
    """
    if max(x.ndim for x in (medium.sigma_a, medium.sigma_s, medium.g)) > 1:
        raise DomainError("dipole: expected uniform coefficients, got a map; use hankel_profiles for maps.")
    z_r = medium.mean_free_path  # depth of the real source
    z_v = z_r + 4 * egan_A(medium.eta) * medium.D_classical  # height of its mirror image
    flux = pole(r[:, None], z_r, medium.sigma_tr_classical) + pole(r[:, None], z_v, medium.sigma_tr_classical)
    return medium.albedo_prime / 2 * flux


def dipole_hankel(table: LayerTable, s: Float[Tensor, " S"]) -> Float[Tensor, "S N"]:
    """R̂(s) of the first layer as a half-space, per channel and row, flattened to N.

    Layers beneath are ignored: a dipole knows none. Differentiable.
    """
    layer = layers_of(table.first)[0]
    kappa = torch.sqrt(3 * layer.sigma_a * layer.sigma + s[:, None] ** 2 + TINY)
    mirrored = (1 + 4 / 3 * egan_A(layer.eta)) / layer.sigma
    reached = torch.exp(-kappa / layer.sigma) + torch.exp(-kappa * mirrored)
    return layer.sigma_s / layer.sigma / 2 * reached
