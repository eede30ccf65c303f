"""Spectral solution of layered diffusion-like systems, for any number of coupled components.

In every region, for the component vector φ(z), z counted from the top of the stack,

    -D φ'' + M φ = q(z)              D a positive diagonal, M a matrix

    at the top        D φ' = B_top φ
    between regions   φ / n and D φ' continuous         (n = eta² in diffusion theory)
    at the bottom     -D φ' = B_bottom φ, or φ → 0 where the last region is infinite

Regions are cut into elements of a few decay lengths; in each, φ is a polynomial through Chebyshev-Lobatto
points. The result converges geometrically in the number of points, to about 1e-12.

An infinite region is cut where a source at that depth can no longer be felt at its top, and closed there by
the exact condition for decaying solutions, -D φ' = D sqrt(D⁻¹ M) φ. No exponential is ever multiplied out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import sqrtm
from scipy.sparse import block_array, coo_array
from scipy.sparse.linalg import spsolve

from reference.boundary import Array

POINTS = 22  # per element
ELEMENT = 5.0  # longest element, in units of its shortest decay length
DEEP = 42.0  # e^-42 = 6e-19: what lies deeper is not felt


@dataclass(frozen=True)
class Region:
    """One homogeneous region; J components."""

    D: Array  # (J,)
    M: Array  # (J, J)
    source: Callable[[float], Array]  # q (J,) at a depth [mm] below the region's top
    rate: float  # at which the source decays or grows at most [1/mm]
    thickness: float  # [mm]
    n: float = 1.0


def solve(regions: Sequence[Region], top: Array, bottom: Array | None) -> tuple[Array, Array]:
    """φ at the top and at the bottom, (J,) each; the latter 0 for an infinite last region.

    top, bottom (J,): diagonals of B; bottom None when the last region is infinite.
    """
    J = len(regions[0].D)
    first, second = _derivatives(POINTS)
    elements = _elements(regions)
    size = POINTS * J  # unknowns of an element: all components at its first point, at its second, ...
    upper, lower = (
        slice(0, J),
        slice(size - J, size),
    )  # its rows for the conditions at its upper and lower end
    blocks: dict[tuple[int, int], Array] = {}  # (element of the equations, element of the unknowns)
    right = np.zeros((len(elements), size))

    for e, (region, start, length) in enumerate(elements):
        block = np.kron(np.eye(POINTS), region.M) - np.kron(second * 4 / length**2, np.diag(region.D))
        depths = start + length * (1 + _nodes(POINTS)) / 2
        right[e] = np.concatenate([region.source(float(z)) for z in depths])
        flux = np.kron(first * 2 / length, np.diag(region.D))  # D φ' at every point
        right[e, upper] = right[e, lower] = 0

        block[upper] = flux[upper] if e == 0 else 0
        if e == 0:
            block[upper, upper] -= np.diag(top)
        else:  # φ / n continuous with the element above, and D φ' in that one's last rows
            block[upper, upper] = np.eye(J) / region.n
            blocks[e, e - 1] = np.zeros((size, size))
            blocks[e, e - 1][upper, lower] = -np.eye(J) / elements[e - 1][0].n
            blocks[e - 1, e] = np.zeros((size, size))
            blocks[e - 1, e][lower] = -flux[upper]

        block[lower] = flux[lower]
        if e == len(elements) - 1:
            decay = np.diag(region.D) @ np.real(sqrtm(region.M / region.D[:, None]))
            block[lower, lower] += decay if bottom is None else np.diag(bottom)
        blocks[e, e] = block

    count = range(len(elements))
    grid = [[coo_array(blocks[r, c]) if (r, c) in blocks else None for c in count] for r in count]
    phi = spsolve(block_array(grid, format="csc"), right.ravel()).reshape(-1, J)
    return phi[0], phi[-1] if bottom is not None else np.zeros(J)


def _elements(regions: Sequence[Region]) -> list[tuple[Region, float, float]]:
    """(region, start, length) of every element, start counted from the region's top [mm]."""
    out = []
    for region in regions:
        decays = np.sqrt(np.abs(np.linalg.eigvals(region.M / region.D[:, None])))
        thickness = region.thickness
        if np.isinf(thickness):
            thickness = DEEP / (region.rate + decays.min())
        count = int(np.ceil(max(region.rate, decays.max()) * thickness / ELEMENT)) or 1
        out += [(region, i * thickness / count, thickness / count) for i in range(count)]
    return out


@cache
def _nodes(points: int) -> Array:
    """Chebyshev-Lobatto points, ascending from -1 to 1."""
    return -np.cos(np.pi * np.arange(points) / (points - 1))


@cache
def _derivatives(points: int) -> tuple[Array, Array]:
    """First and second differentiation matrices on those points (Trefethen 2000, chapter 6)."""
    x = _nodes(points)
    c = np.ones(points)
    c[[0, -1]] = 2
    c *= (-1.0) ** np.arange(points)
    difference = x[:, None] - x[None, :] + np.eye(points)
    first = np.outer(c, 1 / c) / difference
    first -= np.diag(first.sum(1))
    return first, first @ first
