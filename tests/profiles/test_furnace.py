"""What absorbs nothing loses nothing."""

import math

import pytest
import torch
from profile_stacks import stack_of
from reference.beam import ballistic
from reference.layers import Layer as Row

from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.hankel import hankel_profiles

S = torch.tensor([0.0, 0.05, 0.3, 1.0, 4.0, 20.0], dtype=torch.float64)


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
@pytest.mark.parametrize("incidence", ["normal", "diffuse", 1.0])
def test_spectralon_returns_everything(model, incidence):
    """White furnace: a half-space that absorbs nothing; both exact by construction."""
    R, _ = hankel_profiles(preset("spectralon"), S, model=model, incidence=incidence)
    assert bool(torch.isfinite(R).all())
    torch.testing.assert_close(R[0], torch.ones(3).double(), rtol=1e-5, atol=0)


@pytest.mark.parametrize("eta", [1.0, 1.33, 1.5])
@pytest.mark.parametrize("thickness", [0.05, 0.5, 3.0])
def test_slabs_that_absorb_nothing_lose_nothing(eta, thickness):
    """R + T + what passes unscattered is 1, exactly."""
    stack = Stack([Layer(Medium(0.0, 1.0, 0.0, eta), thickness)])
    mirror, through = ((eta - 1) / (eta + 1)) ** 2, math.exp(-thickness)
    ballistic = (1 - mirror) * through * (1 + mirror * through) / (1 - (mirror * through) ** 2)
    zero = torch.zeros(1, dtype=torch.float64)
    for model, slack in (("layered-diffusion", 1e-9), ("layered-sp3", 1e-6)):
        R, T = hankel_profiles(stack, zero, model=model, incidence="normal")
        assert abs(float(R + T) + ballistic - 1) < slack


@pytest.mark.parametrize("eta", [1.0, 1.1, 1.5])
@pytest.mark.parametrize("thickness", [0.02, 0.3, 3.0])
def test_slabs_that_absorb_nothing_lose_no_diffuse_light(eta, thickness):
    """All but .34 % at .02 mean free paths; two directions lose 2.7 % too little, and their mean 22 %."""
    layers = [Row(0.0, 1.0, thickness, eta=eta)]
    scattered = 1 - sum(ballistic(layers, "diffuse"))
    for model in ("layered-diffusion", "layered-sp3"):
        R, T = hankel_profiles(stack_of(layers), S[:1], model=model)
        assert abs(float(R + T) / scattered - 1) < 0.005, model


@pytest.mark.parametrize("incidence", ["normal", "diffuse"])
@pytest.mark.parametrize(("first", "last"), [(1.0, 1.2), (1.0, 1.5), (1.2, 1.5), (1.35, 1.5)])
def test_thin_white_slabs_between_unlike_faces_lose_and_make_nothing(first, last, incidence):
    """All light comes out, either way up: 2e-8 under a beam, all but .0083 of diffuse light."""
    for depth in (0.005, 0.01, 0.03, 0.05, 0.1):
        layers = [Row(0.0, 1.0, depth, eta=first), Row(0.0, 1.0, depth, eta=last)]
        for stack in (layers, layers[::-1]):
            R, T = hankel_profiles(stack_of(stack), S[:1], incidence=incidence)
            whole = float(R + T) + sum(ballistic(stack, incidence))
            assert -0.01 < whole - 1 < (1e-6 if incidence == "normal" else 0.005), (depth, whole)


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
def test_what_passes_white_matter_falls_with_its_depth(model):
    """As its inverse, to 3e4 mean free paths; measured 1.2e-3."""
    shallow, deep = (
        float(hankel_profiles(Stack([Layer(Medium(0.0, 1.0, 0.0, 1.4), d)]), S[:1], model=model)[1])
        for d in (3e3, 3e4)
    )
    assert deep / shallow == pytest.approx(0.1, rel=2e-3)


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
def test_what_is_clear_takes_no_light(model):
    """100 mm of it above skin; measured 4e-4."""
    skin = Medium(0.1, 1.0, 0.0, 1.4)
    above = [Layer(Medium(0.0, 0.0, 0.0, 1.4), 100.0), Layer(skin)]
    bare, covered = (
        float(hankel_profiles(stack, S[:1], model=model, incidence="normal")[0])
        for stack in (skin, Stack(above))
    )
    assert covered == pytest.approx(bare, rel=1e-3)
