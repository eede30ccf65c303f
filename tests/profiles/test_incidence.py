"""Where the light comes from, as cosines inside."""

import math

import pytest
import torch
from profile_stacks import stack_of
from reference.layers import Layer as Row

from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.incidence import incidence_directions, mean_direction


def test_directions_of_diffuse_light():
    """Means of the cosine inside: 2/3 without refraction, .865 at eta 1.4; shares sum to 1."""
    assert abs(mean_direction("diffuse", 1.0)[0][0] - 2 / 3) < 1e-6
    assert abs(mean_direction("diffuse", 1.4)[0][0] - 0.865) < 1e-3
    for eta in (1.0, 1.1, 1.5):
        shares = [share for _, share in incidence_directions("diffuse", eta)]
        assert len(shares) > 1 and abs(sum(shares) - 1) < 1e-12
    ((cosine, _),) = incidence_directions(math.pi / 4, 1.5)
    assert abs(cosine - math.sqrt(1 - 0.5 / 2.25)) < 1e-12


@pytest.mark.parametrize("model", ["layered-sp3", "layered-diffusion"])
@pytest.mark.parametrize("etas", [(1.0,), (1.5, 1.0), (1.4, 1.0, 1.4)])
def test_light_grazes_layers_of_index_1(etas, model):
    """At a right angle as a hair above, also where it runs along an inner layer."""
    stack, s = stack_of([Row(0.1, 1.0, 0.5, eta=eta) for eta in etas]), torch.tensor([0.0, 1.0]).double()
    flat, steep = (
        hankel_profiles(stack, s, model=model, incidence=x) for x in (math.pi / 2, math.pi / 2 - 1e-3)
    )
    for grazing, beside in zip(flat, steep, strict=True):
        torch.testing.assert_close(grazing, beside, rtol=1e-3, atol=1e-3)
