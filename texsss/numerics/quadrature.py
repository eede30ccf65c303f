"""Gauss nodes and weights, in float64."""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import torch

from texsss.types import Float, Tensor


def gauss_legendre(count: int, low: float = 0.0, high: float = 1.0) -> tuple[Tensor, Tensor]:
    """Nodes and weights (count,) of Gauss-Legendre quadrature on low..high, exact to degree 2·count - 1."""
    x, w = _legendre(count)
    half = (high - low) / 2
    return torch.from_numpy(low + half * (x + 1)), torch.from_numpy(w * half)


def graded(count: int, high: float, grading: float = 5.0) -> tuple[Float[Tensor, " S"], Float[Tensor, " S"]]:
    """Nodes and weights (count,) on 0..high that crowd towards 0 exponentially.

    The widest gap is about e^grading times the narrowest: for functions that vary on every scale
    below `high`, as profiles do in frequency.
    """
    x, w = gauss_legendre(count)
    scale = high / math.expm1(grading)
    return scale * torch.expm1(grading * x), scale * grading * torch.exp(grading * x) * w


def gauss_weighted(
    weight: Callable[[np.ndarray], np.ndarray], low: float, high: float, count: int, grading: float = 3.0
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss nodes and weights (count,) for a weight function on low..high.

    `weight` is evaluated on a fine grid that crowds towards `low`, where it may vanish like a root.
    Source: discretised Stieltjes procedure and Golub & Welsch 1969.
    """
    x, w = _legendre(400)
    t = (x + 1) / 2
    node = low + (high - low) * t**grading
    mass = weight(node) * w / 2 * grading * t ** (grading - 1) * (high - low)
    total = mass.sum()
    alpha, beta = np.zeros(count), np.zeros(count)
    previous, current = np.zeros_like(node), np.full_like(node, 1 / math.sqrt(total))
    for k in range(count):
        alpha[k] = (mass * node * current**2).sum()
        residual = (node - alpha[k]) * current - (beta[k - 1] * previous if k else 0)
        beta[k] = math.sqrt((mass * residual**2).sum())
        previous, current = current, residual / beta[k]
    nodes, vectors = np.linalg.eigh(np.diag(alpha) + np.diag(beta[:-1], 1) + np.diag(beta[:-1], -1))
    return nodes, total * vectors[0] ** 2


@lru_cache(maxsize=64)
def _legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(count)
