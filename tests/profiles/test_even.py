"""Thin slabs between faces that mirror: dense quadrature, adding-doubling, Monte Carlo."""

import numpy as np
import pytest
import torch
from profile_stacks import ALIKE, dense_multiple, stack_of
from reference import adding, even
from reference.beam import ballistic
from reference.layers import Layer as Row
from reference.stacks import S as MC_S
from reference.stacks import read_stacks

from texsss.profiles.even import prepare
from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.slab import layers_of

S = torch.tensor([0.0, 0.05, 0.3, 1.0, 4.0, 20.0], dtype=torch.float64)


@pytest.mark.parametrize("layers", [ALIKE, ALIKE[:1], [Row(0.01, 1.0, 0.05, eta=1.4)]])
def test_thin_slabs_between_mirroring_faces_are_lit_evenly(layers):
    """Two modes by collocation and even light by dense quadrature, by their shares, up to one factor.

    Measured .18 % of R̂(0), which the four nodes of the closed form leave.
    """
    s, share = S.numpy(), even.share(layers)
    assert 0.2 < share < 0.999
    ours = [x[:, 0] for x in hankel_profiles(stack_of(layers), S, incidence="normal")]
    once = [x[:, 0] for x in hankel_profiles(stack_of(layers), S, incidence="normal", scattering="single")]
    truth = [(1 - share) * x + share * even.scattered(layers, s) for x in dense_multiple(layers, S)]
    factor = float(ours[0][0] - once[0][0]) / truth[0][0]
    assert 0.95 < factor < 1.2
    for total, first, more in zip(ours, once, truth, strict=True):
        np.testing.assert_allclose(total - first, factor * more, rtol=0, atol=0.004 * truth[0][0])


@pytest.mark.parametrize("layers", [ALIKE, ALIKE[:2], [Row(0.2, 0.7, 0.9, eta=1.1)]])
def test_even_light_and_two_modes_share_what_scatters(layers):
    """By optical depth, index and how unlike the layers are; measured 1e-16."""
    known = prepare(layers_of(stack_of(layers).table(torch.float64)), ((1.0, 1.0),))
    assert float(known.rest) == pytest.approx(1 - even.share(layers), rel=1e-9)


@pytest.mark.parametrize("eta", [1.2, 1.4, 1.6])
@pytest.mark.parametrize("depth", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("albedo", [0.6, 0.95])
def test_thin_slabs_meet_adding_doubling(eta, depth, albedo):
    """Scattered light at normal incidence: 1.1 % of R and T, where two modes alone were 25 % too bright."""
    layers = [Row((1 - albedo) * depth, albedo * depth, 1.0, eta=eta)]
    truth, beam = adding.totals(layers, 24), ballistic(layers, "normal")
    ours = hankel_profiles(stack_of(layers), S[:1], incidence="normal")
    for total, straight, value in zip((truth.R, truth.T), beam, ours, strict=True):
        assert abs(float(value) / (total - straight) - 1) < 0.02, (float(value), total - straight)


@pytest.mark.parametrize("depth", [0.1, 0.3, 0.8])
@pytest.mark.parametrize("dark", [0, 1])
def test_thin_slabs_of_dark_and_bright_layers_meet_adding_doubling(depth, dark):
    """One of albedo .01, the other .99: 4 % of what scatters, 7.7 % by two modes alone."""
    layers = [
        Row(0.99 * depth / 4, 0.01 * depth / 4, 1.0, eta=1.4),
        Row(0.0075 * depth, 0.7425 * depth, 1.0, eta=1.4),
    ]
    layers = layers[::-1] if dark else layers
    truth, beam = adding.totals(layers, 24), ballistic(layers, "normal")
    ours = hankel_profiles(stack_of(layers), S[:1], incidence="normal")
    for total, straight, value in zip((truth.R, truth.T), beam, ours, strict=True):
        assert abs(float(value) / (total - straight) - 1) < 0.05, (float(value), total - straight)


@pytest.mark.parametrize(
    "name", ["slab .05 mm, .99, eta 1.5", "slab .1 mm, .98, eta 1.5", "slab .3 mm, .95, eta 1.4"]
)
def test_thin_slabs_spread_light_as_the_monte_carlo_does(name):
    """Multiple R̂ at all s, of the total: 1.2 %, where two modes alone were 7.3 % off."""
    known = read_stacks("normal")[name]
    R, _ = hankel_profiles(
        stack_of(known.layers), torch.as_tensor(MC_S), incidence="normal", scattering="multiple"
    )
    truth, total = known.hankel["R"].mean - known.hankel["R1"].mean, known.totals["R"].mean
    np.testing.assert_allclose(R[:, 0] / total, truth / total, rtol=0, atol=0.02)
