"""Spectral solution of layered diffusion-like systems, for any number of coupled components.

In every region, for the component vector φ(z), z counted from the top of the stack,

    -D φ'' + M φ = q e^{-a z}        D a positive diagonal, M a matrix, a > 0

    at the top        D φ' = B_top φ
    between regions   φ / n and D φ' continuous         (n = eta² in diffusion theory)
    at the bottom     -D φ' = B_bottom φ, or φ → 0 where the last region is infinite

Regions are cut into elements of a few decay lengths; in each, φ is a polynomial through Chebyshev-Lobatto
points. The result converges geometrically in the number of points, to about 1e-12.

An infinite region is cut where a source at that depth can no longer be felt at its top, and closed there by
the exact condition for decaying solutions, -D φ' = D sqrt(D⁻¹ M) φ. No exponential is ever multiplied out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import sqrtm
from scipy.sparse import coo_array
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
    source: Array  # (J,) q at the top of this region, attenuation above it included
    rate: float  # a [1/mm]
    thickness: float  # [mm]
    n: float = 1.0


def solve(regions: Sequence[Region], top: Array, bottom: Array | None) -> tuple[Array, Array]:
    """φ at the top and at the bottom, (J,) each; the latter 0 for an infinite last region.

    top, bottom (J,): diagonals of B; bottom None when the last region is infinite.
    """
    J = len(regions[0].D)
    first, second = _derivatives(POINTS)
    elements = _elements(regions)
    unknowns = len(elements) * POINTS * J
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    right = np.zeros(unknowns)

    def index(element: int, point: int, component: int) -> int:
        return (element * POINTS + point) * J + component

    def put(row: int, column: int, value: float) -> None:
        rows.append(row)
        columns.append(column)
        values.append(value)

    def put_flux(row: int, element: int, point: int, component: int, sign: float) -> None:
        region, _, length = elements[element]
        for p in range(POINTS):
            put(row, index(element, p, component), sign * region.D[component] * first[point, p] * 2 / length)

    for e, (region, start, length) in enumerate(elements):
        z = start + length * (1 + _nodes(POINTS)) / 2  # depth below the region's top
        for p in range(1, POINTS - 1):
            for j in range(J):
                row = index(e, p, j)
                right[row] = region.source[j] * np.exp(-region.rate * z[p])
                for q in range(POINTS):
                    put(row, index(e, q, j), -region.D[j] * second[p, q] * 4 / length**2)
                for i in range(J):
                    put(row, index(e, p, i), region.M[j, i])
        for j in range(J):
            row = index(e, 0, j)
            if e == 0:
                put_flux(row, e, 0, j, 1)
                put(row, index(e, 0, j), -top[j])
            else:  # φ / n continuous with the element above
                put(row, index(e, 0, j), 1 / region.n)
                put(row, index(e - 1, POINTS - 1, j), -1 / elements[e - 1][0].n)
            row = index(e, POINTS - 1, j)
            put_flux(row, e, POINTS - 1, j, 1)
            if e < len(elements) - 1:  # D φ' continuous with the element below
                put_flux(row, e + 1, 0, j, -1)
            elif bottom is not None:
                put(row, index(e, POINTS - 1, j), bottom[j])
            else:
                decay = np.real(sqrtm(region.M / region.D[:, None]))
                for i in range(J):
                    put(row, index(e, POINTS - 1, i), region.D[j] * decay[j, i])

    system = coo_array((values, (rows, columns)), shape=(unknowns, unknowns)).tocsc()
    phi = spsolve(system, right).reshape(-1, J)
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
