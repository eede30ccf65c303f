"""Films above other layers: absent, clear and dense ones."""

import numpy as np
import pytest
import torch
from profile_stacks import stack_of
from reference.layers import Layer as Row
from reference.stacks import S as MC_S
from reference.stacks import read_stacks

from texsss.media.medium import Medium
from texsss.media.stack import Layer, LayerTable, Stack
from texsss.profiles.hankel import SIDES, flat_profile, hankel_profiles

S = torch.tensor([0.0, 0.05, 0.3, 1.0, 4.0, 20.0], dtype=torch.float64)

# R̂ and T̂ of a Monte Carlo at these frequencies, 120,000 paths, ±.0012 at most
TRUTH_S = [0.0, 0.152342, 0.464159, 0.810197, 1.414214, 2.468534, 4.308869, 9.936869, 30.275959]
SKIN = (0.032, 0.74)
UNDER_CLEAR = [Row(0.0, 0.0, 2.0, eta=1.3), Row(0.5, 5.0, eta=1.3)]
SLAB = [Row(0.0, 0.0, 2.0, eta=1.4), Row(0.05, 1.5, 1.0, eta=1.4)]
UNDER_DENSE = [Row(0.5, 49.5, 0.001), Row(*SKIN)]
BETWEEN = [Row(0.5, 49.5, 0.001), Row(0.0, 0.0, 1.0), Row(0.5, 5.0)]
FILMS = [
    (UNDER_CLEAR, "normal", 0, [0.3091, 0.2627, 0.2002, 0.1559, 0.0626, -0.0043, 0.0, 0.0, 0.0]),
    (
        [Row(0.0, 0.0, 1.0), Row(0.5, 5.0)],
        "diffuse",
        0,
        [0.4955, 0.4587, 0.3217, 0.1891, 0.0634, 0.0086, 0.0009, 0.0, 0.0001],
    ),
    (
        [Row(0.0, 0.0, 8.0, eta=1.5), Row(*SKIN, eta=1.5)],
        "normal",
        0,
        [0.3636, 0.175, 0.0321, -0.0053, 0.0, -0.0003, 0.0, -0.0001, 0.0],
    ),
    (SLAB, "normal", 0, [0.3349, 0.2553, 0.1688, 0.1224, 0.0449, -0.0031, 0.0016, 0.0003, 0.0]),
    (SLAB, "normal", 1, [0.2944, 0.2361, 0.1741, 0.1533, 0.1164, 0.0743, 0.0417, 0.0133, 0.0038]),
    (UNDER_DENSE, "normal", 0, [0.5686, 0.5348, 0.3988, 0.2957, 0.2061, 0.1395, 0.0954, 0.0572, 0.0345]),
    (UNDER_DENSE, "diffuse", 0, [0.6294, 0.5956, 0.4542, 0.3425, 0.2409, 0.1665, 0.1176, 0.0782, 0.0554]),
    (BETWEEN, "diffuse", 0, [0.5043, 0.4715, 0.3463, 0.2239, 0.1057, 0.0525, 0.045, 0.045, 0.0448]),
]


@pytest.mark.parametrize("film", [1.2, 1.4, 1.6])
@pytest.mark.parametrize("base", [1.2, 1.4, 1.6])
def test_absent_layers_of_another_index_leave_light_to_what_lies_beneath(film, base):
    """Nothing jumps at thickness 0, and but for the beam's refraction R is that of an endless base alone.

    Measured .050 (1.6 on 1.2); over slabs of .2 mm up to .24 (1.5 on 1). The Monte Carlo, in
    which such a film keeps its two faces, is within .04 of the model for all of these.
    """
    below = Layer(Medium(0.1, 1.0, 0.0, base))
    bare, absent, thin = (
        hankel_profiles(Stack(layers), S)[0]
        for layers in (
            [below],
            [Layer(Medium(0.3, 1.0, 0.0, film), 0.0), below],
            [Layer(Medium(0.3, 1.0, 0.0, film), 1e-6), below],
        )
    )
    torch.testing.assert_close(absent, thin, rtol=1e-5, atol=0)
    assert abs(float(absent[0] / bare[0]) - 1) < 0.055


def test_clear_films_keep_light_where_it_is():
    """A film of .05 mm over skin that neither scatters nor absorbs, against the Monte Carlo at s to .3/mm.

    Measured .7 % of R̂(0); 80 % where its diffusion coefficient had no limit.
    """
    known = read_stacks("normal")["clear .05 mm on skin1 red"]
    near = MC_S < 0.3
    R, _ = hankel_profiles(stack_of(known.layers), torch.as_tensor(MC_S[near]), incidence="normal")
    truth = known.hankel["R"].mean
    np.testing.assert_allclose(R[:, 0], truth[near], rtol=0, atol=0.012 * truth[0])


@pytest.mark.parametrize(("layers", "incidence", "side", "truth"), FILMS)
def test_light_crosses_rarer_films_straight_and_no_others(layers, incidence, side, truth):
    """At every frequency, against a Monte Carlo; where light diffused through films up to 76 % of R̂(0) off.

    Measured 4.9 % of R̂(0), where a face mirrors light around rings, and 3.7 % of T̂(0). What thin dense
    films reflect stays where it is.
    """
    s = torch.tensor(TRUTH_S, dtype=torch.float64)
    found = hankel_profiles(stack_of(layers), s, incidence=incidence)[side][:, 0]
    assert abs(float(found[0]) / truth[0] - 1) < 0.012
    np.testing.assert_allclose(found, truth, rtol=0, atol=0.05 * truth[0])
    if layers[0].sigma_s:
        assert float(found[-1]) > truth[-1] / 2


@pytest.mark.parametrize("incidence", ["normal", "diffuse"])
@pytest.mark.parametrize("changing", ["thickness", "sigma_s", "base"])
def test_profiles_change_little_as_a_film_grows(incidence, changing):
    """Nothing jumps where a film starts to count, nor where it gets as dense as its base; R̂ and its gradient.

    Thickness to 8 mm, clear or hazy; σs to 50/mm over 5/mm; an intermediate layer from rare to dense.
    Measured .012 per step of 4 %, and .048 of the steepest gradient where σs is that of the base.
    """
    x = torch.logspace(-6, 0.9, 400, dtype=torch.float64)
    if changing != "thickness":
        x = 5 * torch.logspace(-3, 1, 232, dtype=torch.float64)
    x.requires_grad_()
    s, one = torch.tensor(TRUTH_S, dtype=torch.float64), torch.ones_like(x)
    for haze in (0.0, 0.2, 2.0):
        thickness, haze_s, base = {
            "thickness": (x, haze * one, 5 * one),
            "sigma_s": ((0.1 + haze) * one, x, 5 * one),
            "base": ((0.1 + haze) * one, (0.1 + haze) * one, x),
        }[changing]
        sigma_s = torch.stack([haze_s, base], 1)[..., None]
        depth = torch.stack([thickness, torch.inf * one], 1)[..., None]
        table = LayerTable(0.1 * sigma_s, sigma_s, torch.zeros_like(sigma_s), depth, (1.3, 1.3), True)
        R = flat_profile(table, s, side=SIDES[0], model="layered-sp3", incidence=incidence)
        assert float(R.detach().diff(dim=1).abs().max()) < 0.02
        (slope,) = torch.autograd.grad(R.sum(), x)
        slope = slope * x.detach()
        assert bool(torch.isfinite(slope).all())
        assert float(slope.diff().abs().max()) < 0.05 * float(slope.abs().max()) + 1e-3
