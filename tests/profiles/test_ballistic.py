"""Light that is never scattered, and light from below."""

import numpy as np
import pytest
import torch
from profile_stacks import stack_of
from reference import beam
from reference.layers import Layer as Row

from texsss.errors import DomainError
from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.ballistic import ballistic
from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.multipole import stacked

S = torch.tensor([0.0, 0.3, 2.0], dtype=torch.float64)
ROWS = [Row(0.1, 1.0, 0.3, g=0.4, eta=1.5), Row(0.02, 0.5, 0.4, eta=1.0), Row(0.3, 2.0, 0.1, eta=1.3)]


@pytest.mark.parametrize("incidence", ["normal", "diffuse", 1.0])
def test_beams_are_mirrored_and_pass_as_the_literal_sum_says(incidence):
    """64 directions of diffuse light there, 24 here: measured 3e-6 of the light."""
    for rows in (ROWS, ROWS[::-1], ROWS[:1]):
        found = [float(x) for x in ballistic(stack_of(rows), incidence=incidence)]
        np.testing.assert_allclose(found, beam.ballistic(rows, incidence), rtol=0, atol=1e-5)


def test_all_light_is_scattered_mirrored_or_passes():
    """R̂(0) + T̂(0) + both = 1 without absorption, per texel and channel; diffuse light by two nodes: .0042."""
    thickness = torch.tensor([[0.01, 0.3], [2.0, 500.0]], dtype=torch.float64)
    white = Stack([Layer(Medium(0.0, [0.5, 1.0, 2.0], 0.0, 1.4), thickness)])
    for incidence, slack in (("normal", 1e-6), ("diffuse", 0.005)):
        R, T = (x[..., 0, :] for x in hankel_profiles(white, S[:1], incidence=incidence))
        above, below = ballistic(white, incidence=incidence)
        assert above.shape == below.shape == (2, 2, 3) and float(below[1, 1].max()) < 1e-12
        torch.testing.assert_close(R + T + above + below, torch.ones_like(R), rtol=0, atol=slack)


def test_nothing_passes_a_half_space():
    assert all(float(x.abs().max()) == 0 for x in ballistic(preset("skin1")))
    with pytest.raises(DomainError, match=r"from below, got an infinite one; give it a thickness"):
        _ = Stack(preset("skin1")).upside_down


def test_light_from_below_is_that_of_the_stack_upside_down():
    """As multipoles combine layers in both directions."""
    stack = stack_of(ROWS)
    R, T = hankel_profiles(stack.upside_down, S, model="multipole")
    slab = stacked(stack.table(), S)
    torch.testing.assert_close(R, slab.R_minus)
    torch.testing.assert_close(T, slab.T_minus)
    assert float((R / slab.R_plus - 1).abs().max()) > 0.05
