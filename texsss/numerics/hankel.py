"""Back from Hankel space to the plane: f(r) = 1/2π ∫ f̂(s) J0(s r) s ds, and what lies within r."""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import scipy  # its parts are loaded where they are first used
import torch

from texsss.errors import DomainError
from texsss.numerics.quadrature import gauss_legendre
from texsss.types import Float, Int, Tensor

WAVES = 40  # half-waves of the Bessel function that are summed
MEANS = 24  # the last of their sums, whose limit is taken
INSIDE = 12  # Gauss nodes per half-wave
OCTAVES = 36  # of the first half-wave, in which the spectrum may do all it does
PER_OCTAVE = 10
AT_ONCE = 16  # distances

Spectrum = Callable[[Float[Tensor, " S"]], Float[Tensor, "S C"]]
Distances = Float[Tensor, " R"] | Int[Tensor, " R"]


def inverse_hankel(spectrum: Spectrum, r: Distances) -> Float[Tensor, "R C"]:
    """f(r) at distances `r` > 0, from its Hankel transform as a function.

    Integrated between the zeros of J0(s r); the alternating sums of half-waves are accelerated by
    Euler's transformation, so that spectra which fall as slowly as 1/s still converge. Computed in
    float64, which whole numbers become. The error is about 1e-14 f̂(0) / 2πr² and grows to 1e-13 of it: all
    there is where f has fallen exponentially, 1 % of a dipole of (.1, 1)/mm at 50 mm, and noise beyond.
    Differentiable in whatever `spectrum` depends on.
    Raises DomainError: for distances that are not above 0 and finite.
    Source: Longman 1956 for integrals between zeros.
    """
    distance = _distances("inverse_hankel", r)
    f = _transformed(spectrum, distance, 0) / (2 * math.pi * distance[:, None] ** 2)
    return f.to(r.dtype if r.is_floating_point() else torch.float64)


def within(spectrum: Spectrum, r: Distances) -> Float[Tensor, "R C"]:
    """∫ f 2πr dr from 0 to each `r` > 0, r ∫ f̂(s) J1(s r) ds, as `inverse_hankel`; to 1e-14 f̂(0)."""
    inside = _transformed(spectrum, _distances("within", r), 1)
    return inside.to(r.dtype if r.is_floating_point() else torch.float64)


def _distances(who: str, r: Tensor) -> Float[Tensor, " R"]:
    distance = r.detach().double()
    wrong = distance[~((distance > 0) & distance.isfinite())]
    if len(wrong):
        raise DomainError(
            f"{who}: expected finite distances > 0, got {float(wrong[0]):g}; profiles may be infinite at 0, "
            "so ask for a small distance."
        )
    return distance


def _transformed(spectrum: Spectrum, r: Float[Tensor, " R"], order: int) -> Float[Tensor, "R C"]:
    """∫ f̂(x / r) J(x) x^(1 - order) dx of the Bessel function of an order, 0 or 1."""
    x, weights, ends = _nodes(order)
    results = []
    for some in r.split(AT_ONCE):
        values = spectrum((x / some[:, None]).flatten()).unflatten(0, (len(some), len(x)))
        sums = torch.cumsum(values * weights[:, None], 1)[:, ends]
        results.append(_accelerated(sums))
    return torch.cat(results)


@lru_cache(maxsize=2)
def _nodes(order: int) -> tuple[Tensor, Tensor, Tensor]:
    """Nodes, weights with the Bessel function in them, and where half-waves end."""
    zeros = np.concatenate([[0.0], scipy.special.jn_zeros(order, WAVES)])
    # spectra may end anywhere in the first half-wave, however near to 0
    octaves = zeros[1] * 0.5 ** np.arange(OCTAVES, -1, -1.0)
    edges = np.concatenate([[0.0], octaves, zeros[2:]])
    counts = np.where(edges[1:] <= zeros[1], PER_OCTAVE, INSIDE)
    pieces = [gauss_legendre(*piece) for piece in zip(counts.tolist(), edges[:-1], edges[1:], strict=True)]
    x, dx = (torch.cat(part) for part in zip(*pieces, strict=True))
    # not torch's, whose errors of 1e-7 would be all that is left far out
    bessel = torch.from_numpy(scipy.special.jv(order, x.numpy()))
    return x, bessel * x ** (1 - order) * dx, torch.from_numpy(counts.cumsum()[OCTAVES:] - 1)


def _accelerated(sums: Float[Tensor, "R N C"]) -> Float[Tensor, "R C"]:
    """The limit of alternating partial sums, by repeated means (Euler's transformation)."""
    tail = sums[:, -MEANS:]
    while tail.shape[1] > 1:
        tail = (tail[:, 1:] + tail[:, :-1]) / 2
    return tail[:, 0]
