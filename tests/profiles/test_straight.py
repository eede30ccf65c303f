"""How light that crosses a clear film straight fades: closed form, integral, no jumps between indices."""

import math

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from scipy.special import j0, k1

from texsss.media import fresnel
from texsss.profiles.straight import faded, leaving, returning

X = torch.logspace(-2, 1.3, 60, dtype=torch.float64)


def test_without_refraction_it_is_a_bessel_function():
    """x K1(x), x = s d."""
    x = X.numpy()
    np.testing.assert_allclose(faded(leaving(1.0), X).numpy(), x * k1(x), rtol=0, atol=0.02)


@pytest.mark.parametrize("eta", [1.2, 1.4, 1.5])
@pytest.mark.parametrize(("side", "within"), [(leaving, 0.065), (returning, 0.18)])
def test_fadings_are_means_over_what_the_face_does(side, within, eta):
    """By adaptive quadrature over the angle; means go below 0 by up to .06 and .17, the fit does not."""

    def share(mu: float) -> float:
        mirrored = float(fresnel.reflectance(torch.tensor(mu, dtype=torch.float64), 1 / eta))
        return mu * (mirrored if side is returning else 1 - mirrored)

    critical = [math.sqrt(1 - 1 / eta**2)]
    whole = quad(share, 0, 1, points=critical, limit=200)[0]
    for x in (0.1, 0.3, 0.7, 1.5):
        means = quad(
            lambda mu, x=x: share(mu) * j0(x * math.sqrt(1 / mu**2 - 1)), 1e-3, 1, points=critical, limit=2000
        )
        assert abs(float(faded(side(eta), torch.tensor(x))) - means[0] / whole) < within


@pytest.mark.parametrize("side", [leaving, returning])
def test_fadings_change_little_with_the_index(side):
    """Per .01 of eta."""
    made = torch.stack([faded(side(float(eta)), X) for eta in np.linspace(1.3, 1.6, 31)])
    assert float(made.diff(dim=0).abs().max()) < 0.015
