"""Back from Hankel space to the plane: f(r) = 1/2π ∫ f̂(s) J0(s r) s ds."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import scipy  # its parts are loaded where they are first used
import torch

from texsss.numerics.quadrature import gauss_legendre
from texsss.types import Float, Tensor

PIECES = 40  # half-waves of J0 that are summed
INSIDE = 24  # Gauss nodes per half-wave


def inverse_hankel(
    spectrum: Callable[[Float[Tensor, " S"]], Float[Tensor, "S C"]], r: Float[Tensor, " R"]
) -> Float[Tensor, "R C"]:
    """f(r) at distances `r` > 0, from its Hankel transform as a function.

    Integrated between the zeros of J0(s r); the alternating sums of half-waves are accelerated by
    Euler's transformation, so that spectra which fall as slowly as 1/s still converge. Computed in
    float64. Differentiable in whatever `spectrum` depends on.
    Source: Longman 1956 for integrals between zeros.
    """
    zeros = np.concatenate([[0.0], scipy.special.jn_zeros(0, PIECES)])
    results = []
    for distance in r.detach().double().tolist():
        # the first half-wave holds most of the structure: nodes crowd towards s = 0
        nodes, widths = [], []
        for low, high in pairwise(zeros):
            t, w = gauss_legendre(4 * INSIDE if low == 0 else INSIDE)
            if low == 0:
                nodes.append(high * torch.expm1(8 * t) / math.expm1(8))
                widths.append(high * 8 * torch.exp(8 * t) / math.expm1(8) * w)
            else:
                nodes.append(low + (high - low) * t)
                widths.append((high - low) * w)
        x, dx = torch.cat(nodes), torch.cat(widths)
        values = spectrum(x / distance) * (torch.special.bessel_j0(x) * x * dx)[:, None]
        waves = torch.stack([part.sum(0) for part in values.split([len(n) for n in nodes])])
        results.append(_accelerated(torch.cumsum(waves, 0)) / (2 * math.pi * distance**2))
    return torch.stack(results).to(r.dtype)


def _accelerated(sums: Float[Tensor, "N C"]) -> Float[Tensor, " C"]:
    """The limit of alternating partial sums, by repeated means (Euler's transformation)."""
    tail = sums[-16:]
    while tail.shape[0] > 1:
        tail = (tail[1:] + tail[:-1]) / 2
    return tail[0]
