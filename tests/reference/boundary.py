"""Fresnel reflectance at a smooth dielectric boundary, and its moments, by quadrature."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def fresnel(mu: Array | float, eta: float) -> Array:
    """Unpolarised reflectance at cosine `mu`, from index 1 into index `eta`; 1 when all is reflected."""
    mu = np.asarray(mu, dtype=float)
    sin2 = (1 - mu**2) / eta**2
    cos_t = np.sqrt(np.maximum(1 - sin2, 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        perpendicular = (mu - eta * cos_t) / (mu + eta * cos_t)
        parallel = (eta * mu - cos_t) / (eta * mu + cos_t)
    partial = (perpendicular**2 + parallel**2) / 2
    return np.where((sin2 >= 1) | (mu <= 0), 1.0, partial)


def internal_moment(eta: float, power: int) -> float:
    """∫₀¹ F(μ) μ^power dμ for light that meets the outside from within; 0 when eta = 1.

    Split at the critical cosine, below which F = 1, with the substitution μ = μ_c + (1 - μ_c) t² that removes
    the square-root singularity there.
    """
    if eta == 1:
        return 0.0
    critical = np.sqrt(max(1 - 1 / eta**2, 0.0))
    t, weight = np.polynomial.legendre.leggauss(200)
    t, weight = (t + 1) / 2, weight / 2
    mu = critical + (1 - critical) * t**2
    partial = np.sum(weight * 2 * t * (1 - critical) * fresnel(mu, 1 / eta) * mu**power)
    return float(critical ** (power + 1) / (power + 1) + partial)


def diffuse_entry(eta: float) -> float:
    """Share of diffuse light from outside that enters, 1 - 2 ∫ F μ dμ (.92 at eta 1.4)."""
    t, weight = np.polynomial.legendre.leggauss(200)
    mu = ((t + 1) / 2) ** 2
    return float(1 - 2 * np.sum(weight / 2 * (t + 1) * fresnel(mu, eta) * mu))


def impedance(eta: float) -> float:
    """A of the diffusion boundary condition φ = 2 A D φ', (1 + 3 C₂) / (1 - 2 C₁)."""
    return (1 + 3 * internal_moment(eta, 2)) / (1 - 2 * internal_moment(eta, 1))
