"""Fresnel reflection: limits, closed forms, laws."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from texsss.errors import DomainError
from texsss.media import fresnel


def diffuse_from_outside(n: float) -> float:
    """2 C1(1/n), the closed form of Walsh (1926) for n > 1."""
    log = math.log((n - 1) / (n + 1))
    return (
        0.5
        + (n - 1) * (3 * n + 1) / (6 * (n + 1) ** 2)
        + n**2 * (n**2 - 1) ** 2 / (n**2 + 1) ** 3 * log
        - 2 * n**3 * (n**2 + 2 * n - 1) / ((n**2 + 1) * (n**4 - 1))
        + 8 * n**4 * (n**4 + 1) / ((n**2 + 1) * (n**4 - 1) ** 2) * math.log(n)
    )


@pytest.mark.parametrize("eta", [1.01, 1.1, 1.3, 1.4, 1.5, 2.0, 3.0])
def test_first_moment_is_walshs(eta):
    """From outside by the closed form; from inside by reciprocity, 1 - (1 - F) / eta²."""
    outside = diffuse_from_outside(eta)
    # measured 2e-11 at eta 1.01, 1e-15 from 1.3; the closed form itself cancels to 1e-11 near 1
    assert 2 * fresnel.moments(1 / eta)[0] == pytest.approx(outside, abs=1e-9)
    assert 2 * fresnel.moments(eta)[0] == pytest.approx(1 - (1 - outside) / eta**2, abs=1e-9)


def test_published_values():
    """2 C1(1.4) = .5290 and F_dt = .92."""
    assert 2 * fresnel.moments(1.4)[0] == pytest.approx(0.5290, abs=5e-5)
    assert fresnel.F_dt(1.4) == pytest.approx(0.92, abs=5e-3)
    assert fresnel.reflectance(1.0, 1.5) == pytest.approx(0.04, abs=1e-12)


@pytest.mark.parametrize("eta", [0.7, 1.02, 1.4, 1.8])
def test_second_moment_is_the_literal_sum(eta):
    """C2 by a midpoint rule of a million cells."""
    mu = (torch.arange(1_000_000, dtype=torch.float64) + 0.5) / 1_000_000
    literal = (fresnel.reflectance(mu, 1 / eta) * mu**2).mean()
    # measured 2e-8: the midpoint rule at the critical cosine
    assert fresnel.moments(eta)[1] == pytest.approx(float(literal), abs=1e-7)


def test_equal_indices_are_no_interface():
    assert fresnel.moments(1.0) == (0.0, 0.0)
    assert fresnel.A(1.0) == 1.0
    assert fresnel.F_dt(1.0) == 1.0
    assert torch.equal(fresnel.reflectance(torch.linspace(0, 1, 5), 1.0), torch.zeros(5))


def test_total_reflection_begins_at_the_critical_angle():
    critical = math.sqrt(1 - 1 / 1.4**2)
    assert fresnel.reflectance(critical - 1e-6, 1 / 1.4) == 1.0
    assert fresnel.reflectance(critical + 1e-4, 1 / 1.4) < 0.95


@settings(deadline=None)
@given(st.floats(0.05, 1.0), st.floats(1.0, 3.0))
def test_both_directions_reflect_alike(mu, eta):
    """The refracted ray, sent back, loses the same share."""
    inner = math.sqrt(1 - (1 - mu**2) / eta**2)
    assert fresnel.reflectance(inner, 1 / eta) == pytest.approx(fresnel.reflectance(mu, eta), abs=1e-9)


@settings(deadline=None)
@given(st.floats(-2.0, 2.0), st.floats(0.2, 5.0))
def test_share_is_a_share(mu, eta):
    cosine = torch.tensor([mu])
    share = fresnel.reflectance(cosine, eta)
    assert 0 <= float(share) <= 1
    assert torch.equal(fresnel.transmittance(cosine, eta), 1 - share)


def test_tensors_follow_numbers_and_keep_their_dtype():
    eta = torch.tensor([[0.8, 1.0], [1.33, 1.5]])
    for function in (fresnel.A, fresnel.F_dt):
        values = function(eta)
        assert values.dtype == torch.float32 and values.shape == eta.shape
        expected = torch.tensor([[function(float(e)) for e in row] for row in eta])
        torch.testing.assert_close(values, expected)


def test_gradients():
    eta = torch.tensor([0.8, 1.1, 1.4], dtype=torch.float64, requires_grad=True)
    mu = torch.tensor([0.9, 0.5, 0.2], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda e: torch.stack(fresnel.moments(e)), eta)
    assert torch.autograd.gradcheck(fresnel.reflectance, (mu, eta))


@pytest.mark.parametrize("eta", [0.0, -1.3, math.nan, math.inf])
def test_bad_eta_is_refused(eta):
    with pytest.raises(DomainError, match="eta"):
        fresnel.moments(eta)
