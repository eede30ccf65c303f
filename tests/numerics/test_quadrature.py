"""Quadrature and the inverse Hankel transform against closed forms."""

import numpy as np
import pytest
import torch

from texsss.errors import DomainError
from texsss.numerics.exponentials import relexp
from texsss.numerics.hankel import inverse_hankel, within
from texsss.numerics.quadrature import gauss_legendre, gauss_weighted, graded


def test_gauss_legendre_is_exact_for_polynomials():
    x, w = gauss_legendre(5, -1.0, 3.0)
    assert abs(float((w * x**9).sum()) - (3**10 - 1) / 10) < 1e-8


def test_graded_nodes_integrate_across_scales():
    s, ds = graded(16, 50.0)
    for scale in (0.3, 3.0):
        exact = scale * scale * (1 - (1 + 50 / scale) * np.exp(-50 / scale))
        assert abs(float((ds * s * torch.exp(-s / scale)).sum()) / exact - 1) < 1e-3


def test_gauss_nodes_for_a_weight():
    """Against moments of √x on 0..1, which the nodes must meet up to degree 2n - 1."""
    nodes, weights = gauss_weighted(np.sqrt, 0.0, 1.0, 4)
    for degree in range(8):
        assert abs((weights * nodes**degree).sum() - 1 / (degree + 1.5)) < 1e-9


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_quotients_of_exponentials(dtype):
    x = torch.tensor([0.0, 1e-8, 1e-3, 0.0099, 0.0101, 1.0, 50.0, 1e4], dtype=dtype)
    exact = torch.where(x > 0, -torch.expm1(-x.double()) / x.double().clamp_min(1e-300), 1.0)
    for argument in (x, x.clone().requires_grad_()):
        torch.testing.assert_close(relexp(argument).detach().double(), exact, rtol=1e-6, atol=0)
    argument = x.clone().requires_grad_()
    relexp(argument).sum().backward()
    assert abs(float(argument.grad[0]) + 0.5) < 1e-6 and bool(torch.isfinite(argument.grad).all())


def test_inverse_hankel_of_known_pairs():
    r = torch.tensor([0.02, 0.3, 1.0, 2.0], dtype=torch.float64)
    v, z, sigma = 0.4, 0.7, 0.5

    def gaussian(s):
        return torch.exp(-v * s**2 / 2)[:, None]

    def exponential(s):  # of a pole, which has a slow tail
        return torch.exp(-z * torch.sqrt(sigma**2 + s**2))[:, None]

    d = torch.hypot(r, torch.tensor(z).double())
    pole = z * (1 + sigma * d) * torch.exp(-sigma * d) / (2 * torch.pi * d**3)
    expected = torch.exp(-(r**2) / (2 * v)) / (2 * torch.pi * v)
    torch.testing.assert_close(inverse_hankel(gaussian, r)[:, 0], expected, rtol=1e-5, atol=1e-7)
    torch.testing.assert_close(inverse_hankel(exponential, r)[:, 0], pole, rtol=1e-6, atol=1e-8)
    # 1/s decays so slowly that the integral converges by cancellation only
    slow = inverse_hankel(lambda s: 1 / torch.sqrt(1 + s[:, None] ** 2), r)[:, 0]
    torch.testing.assert_close(slow, torch.exp(-r) / (2 * torch.pi * r), rtol=1e-5, atol=1e-7)


def test_inverse_hankel_far_out_and_near():
    """Of e^-s, 1 / 2π(1 + r²)^(3/2), and of e^-s²/2 to 1e-13 / 2πr²."""
    r = torch.tensor([1e-9, 1e-6, 1e-3, 1.0, 30.0, 1000.0], dtype=torch.float64)
    exact = 1 / (2 * torch.pi * (1 + r**2) ** 1.5)
    torch.testing.assert_close(
        inverse_hankel(lambda s: torch.exp(-s)[:, None], r)[:, 0], exact, rtol=1e-9, atol=0
    )
    gaussian = inverse_hankel(lambda s: torch.exp(-(s**2) / 2)[:, None], r)[:, 0]
    wrong = (gaussian - torch.exp(-(r**2) / 2) / (2 * torch.pi)).abs()
    assert bool((wrong * 2 * torch.pi * r**2 < 1e-12).all())


def test_light_within_a_distance():
    r = torch.tensor([1e-6, 0.1, 1.0, 4.0, 50.0], dtype=torch.float64)
    inside = within(lambda s: torch.rsqrt(1 + s[:, None] ** 2), r)[:, 0]
    torch.testing.assert_close(inside, -torch.expm1(-r), rtol=1e-12, atol=1e-13)


def test_distances_are_looked_at():
    spectrum = lambda s: torch.exp(-s)[:, None]  # noqa: E731
    whole = inverse_hankel(spectrum, torch.tensor([1, 3]))
    torch.testing.assert_close(whole, inverse_hankel(spectrum, torch.tensor([1.0, 3.0]).double()))
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        for transform in (inverse_hankel, within):
            with pytest.raises(DomainError, match="distances > 0"):
                transform(spectrum, torch.tensor([1.0, wrong]))
