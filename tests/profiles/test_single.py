"""Light scattered once, against integral transport and Monte Carlo."""

import numpy as np
import pytest
import torch
from profile_stacks import stack_of
from reference.layers import Layer as Row
from reference.transport import read_transport

from texsss.profiles.hankel import hankel_profiles

S = torch.tensor([0.0, 0.05, 0.3, 1.0, 4.0, 20.0], dtype=torch.float64)


def test_single_scattering_meets_integral_transport(shared_data):
    """R1 against the tabulated one: .1 % but for slabs, .6 % by the light's bounces, .75 % at s > 0."""
    s = torch.tensor([0.0, 0.497631, 1.414214], dtype=torch.float64)
    for known in read_transport(shared_data):
        R1, _ = hankel_profiles(stack_of(known.layers), s, incidence="normal", scattering="single")
        index = [int(np.argmin(abs(known.s - float(x)))) for x in s]
        np.testing.assert_allclose(R1[:, 0], known.R1[index], rtol=0.01, err_msg=known.name)
        assert abs(float(R1[0, 0]) / known.R1[0] - 1) < 0.007, known.name


@pytest.mark.parametrize(
    ("first", "last", "incidence", "R1", "T1"),
    [
        (1.0, 1.5, "normal", 0.0326, 0.0220),
        (1.5, 1.0, "normal", 0.0207, 0.0286),
        (1.0, 1.5, "diffuse", 0.0618, 0.0392),
        (1.5, 1.0, "diffuse", 0.0288, 0.0432),
    ],
)
def test_single_scattering_is_mirrored_by_a_far_face_of_another_index(first, last, incidence, R1, T1):
    """Two white layers of .05 mm against `reference.montecarlo`, 200,000 photons, 1.5 %: measured 10 %."""
    stack = stack_of([Row(0.0, 1.0, 0.05, eta=first), Row(0.0, 1.0, 0.05, eta=last)])
    ours = hankel_profiles(stack, S[:1], incidence=incidence, scattering="single")
    assert [float(x) for x in ours] == pytest.approx([R1, T1], rel=0.12)
