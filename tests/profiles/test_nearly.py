"""Light that is hardly deflected but once: against the Monte Carlo, laws and limits."""

import numpy as np
import pytest
import torch
from profile_stacks import stack_of
from reference.layers import Layer as Row
from reference.stacks import STACKS, S, read_stacks

from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.nearly import aligned, peaked
from texsss.profiles.slab import layers_of

FORWARD = [name for name, layers in STACKS.items() if any(layer.g for layer in layers)]
BEAM, ASLANT = ((1.0, 1.0),), ((0.9, 0.7), (0.5, 0.3))


@pytest.mark.parametrize("name", FORWARD)
def test_profiles_of_forward_scattering_are_as_wide_as_the_monte_carlo_says(name):
    """Of g = .8, to 1/40 mm: radial error .04 to .10, .15 to .25 if all that scatters again spreads alike."""
    truth, weight = read_stacks("normal")[name].hankel, S * np.gradient(S)
    for orders, mean in (("total", truth["R"].mean), ("multiple", truth["R"].mean - truth["R1"].mean)):
        R, _ = hankel_profiles(
            stack_of(STACKS[name]), torch.from_numpy(S), incidence="normal", scattering=orders
        )
        wrong = weight @ (R[:, 0].numpy() - mean) ** 2
        assert (wrong / (weight @ truth["R"].mean ** 2)) ** 0.5 < 0.11


@pytest.mark.parametrize("light", [BEAM, ASLANT])
def test_what_goes_straight_on_changes_no_reduced_coefficient(light):
    """σs (1 - g) and σa are kept, and less extinguishes; where g is 0 or less all is kept."""
    rows = [Row(0.1, 3.0, 0.2, g=0.8), Row(0.0, 2.0, 0.1, g=-0.6), Row(0.2, 1.0, 0.3), Row(0.0, 0.0, g=0.9)]
    layers = layers_of(stack_of(rows).table(torch.float64), reduced=False)
    for layer, made in zip(layers, peaked(layers, light), strict=True):
        torch.testing.assert_close(made.sigma_s * (1 - made.g), layer.sigma_s * (1 - layer.g))
        torch.testing.assert_close(layer.sigma - made.sigma, layer.sigma_s - made.sigma_s)
        straight = aligned(light) * float(layer.g.clamp_min(0)) ** 3
        torch.testing.assert_close(made.sigma_s, layer.sigma_s * (1 - straight))
    assert aligned(BEAM) == 1 and abs(aligned(ASLANT) - 0.642) < 1e-12


@pytest.mark.parametrize("incidence", ["normal", "diffuse"])
@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_profiles_of_forward_scattering_fall_with_frequency(eta, incidence):
    """And stay above 0: slabs of .01 to 3 reduced mean free paths, and two layers; rises: 3e-4 of R(0)."""
    s = torch.cat([torch.zeros(1), torch.logspace(-1, 2, 30)]).double()
    stacks = [[Row(0.1, 10.0, depth, g=0.9, eta=eta)] for depth in (0.01, 0.1, 3.0)]
    stacks.append([Row(0.1, 5.0, 0.1, g=0.8, eta=eta), Row(0.01, 2.0, g=0.3, eta=eta)])
    for layers in stacks:
        R, _ = hankel_profiles(stack_of(layers), s, incidence=incidence)
        assert bool((R > 0).all()) and bool((R.diff(dim=0) < 1e-3 * R[0]).all())
