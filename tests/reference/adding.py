"""Totals by adding-doubling (iadpython; Prahl 1995, van de Hulst 1980).

iadpython 0.5.3 supplies the matrices of homogeneous slabs and of boundaries. Two things are done here
instead: the quadrature, whose Radau weights it loses beyond 24 points (they sum to .91 at 40), and the
addition of layers, which its own loop leaves with the reflectance seen from *below* (.320 for .409, a
bright layer over a dark one). Its totals are per unit of incident light and include the mirror reflection;
ours are per unit of light that entered, and still include unscattered light that comes out, with its
bounces (`R_ballistic`, `T_ballistic` in the Monte Carlo).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import iadpython
import numpy as np
from iadpython.combine import add_layers, simple_single_layer_matrices
from iadpython.start import boundary_matrices
from scipy.special import roots_jacobi

from reference.boundary import Array, fresnel
from reference.layers import Layer, check_stack

SEMI_INFINITE = 1e7  # optical thickness from which iadpython doubles until nothing changes


@dataclass(frozen=True)
class Totals:
    """Per unit of entered light, unscattered light included."""

    R: float
    T: float
    R_diffuse: float  # Lambertian light from above
    T_diffuse: float


def totals(layers: Sequence[Layer], quadrature: int = 32) -> Totals:
    """Totals of a stack at normal and diffuse incidence, to about four units of the fifth digit.

    All layers must share one eta and scatter isotropically or by Henyey-Greenstein.
    """
    check_stack(layers)
    eta = layers[0].eta
    if any(layer.eta != eta or layer.phase != "henyey-greenstein" for layer in layers):
        raise ValueError("adding-doubling here knows one eta per stack and Henyey-Greenstein scattering only")
    # clear layers of one index change no totals
    slabs = [_slab(layer, quadrature) for layer in layers if layer.sigma_t > 0]
    sample = slabs[0]
    stack = boundary_matrices(sample, top=True)  # R down, R up, T down, T up
    for slab in slabs:
        r, t = simple_single_layer_matrices(slab)
        stack = add_layers(sample, *stack, r, r, t, t)
    stack = add_layers(sample, *stack, *boundary_matrices(sample, top=False))
    R, T, R_diffuse, T_diffuse = sample.UX1_and_UXU(stack[0], stack[2])

    mirror = float(fresnel(1.0, eta))
    leaves = sample.nu > sample.nu_c()
    # the same quadrature as the totals', so that its error cancels
    outside = np.sqrt(np.maximum(1 - eta**2 * (1 - sample.nu[leaves] ** 2), 0))
    mirror_diffuse = eta**2 * float(sample.twonuw[leaves] @ fresnel(outside, eta))
    return Totals(
        R=(R - mirror) / (1 - mirror),
        T=T / (1 - mirror),
        R_diffuse=(R_diffuse - mirror_diffuse) / (1 - mirror_diffuse),
        T_diffuse=T_diffuse / (1 - mirror_diffuse),
    )


def _slab(layer: Layer, quadrature: int) -> iadpython.Sample:
    depth = min(layer.sigma_t * layer.thickness, SEMI_INFINITE)
    slab = iadpython.Sample(
        a=layer.sigma_s / layer.sigma_t, b=depth, g=layer.g, n=layer.eta, quad_pts=quadrature
    )
    if layer.eta == 1:
        nu, weight = _radau(quadrature, 0, 1)
    else:  # nodes on both sides of the critical cosine, where the reflectance has a corner
        critical = slab.nu_c()
        x, w = np.polynomial.legendre.leggauss(quadrature // 2)
        nu, weight = _radau(quadrature // 2, critical, 1)
        nu, weight = np.append(critical * (x + 1) / 2, nu), np.append(critical * w / 2, weight)
    slab.nu, slab.twonuw = nu, 2 * nu * weight
    return slab


def _radau(n: int, a: float, b: float) -> tuple[Array, Array]:
    """Nodes and weights of n-point Gauss-Radau quadrature on [a, b] that includes b (normal incidence)."""
    x, w = roots_jacobi(n - 1, 1, 0)
    x, w = np.append(x, 1), np.append(w / (1 - x), 2 / n**2)
    return a + (b - a) * (x + 1) / 2, w * (b - a) / 2
