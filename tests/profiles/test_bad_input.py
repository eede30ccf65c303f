"""What users may get wrong about layered matter: each has an answer, in one sentence, or a defined result."""

import math

import pytest
import torch

from texsss.errors import DomainError, ShapeError, TexsssError
from texsss.media.depths import stack_from_depths
from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.advice import advice
from texsss.profiles.burley import Burley, fit_burley
from texsss.profiles.fit import fit_gaussians
from texsss.profiles.gaussians import human_skin
from texsss.profiles.hankel import MODELS, hankel_profiles
from texsss.profiles.project import variance_ladder
from texsss.profiles.radial import RadialProfile
from texsss.profiles.weights import weights_for

S = torch.tensor([0.0, 0.5, 4.0], dtype=torch.float64)
SKIN = preset("skin1")
SIX, RADIAL = human_skin(), RadialProfile(SKIN, model="dipole")
BURLEY = Burley(torch.tensor([0.6]), torch.tensor([0.8]))


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: Medium(-0.1, 1.0), "sigma_a.*>= 0"),
        (lambda: Medium(0.1, torch.tensor([[1.0, -1.0]])), "sigma_s.*>= 0"),
        (lambda: Medium(math.nan, 1.0), "finite"),
        (lambda: Medium(0.1, math.inf), "finite"),
        (lambda: Medium(0.1, 1e7), "at most 1e\\+06.*unit"),
        (lambda: Medium(0.1, 1.0, 1.0), "-1 < g < 1.*sigma_s = 0"),
        (lambda: Medium(0.1, 1.0, -1.0), "-1 < g < 1"),
        (lambda: Medium(0.1, 1.0, 0.0, 0.9), "eta >= 1"),
        (lambda: Medium(True, 1.0), "sigma_a.*a number.*got True"),
        (lambda: Layer(SKIN, True), "thickness.*got True"),
        (lambda: SIX.hankel(torch.tensor([-1.0])), "GaussianSum.hankel.*s >= 0.*got -1"),
        (lambda: SIX.hankel(torch.tensor([math.nan])), "GaussianSum.hankel.*finite"),
        (lambda: SIX.evaluate(torch.tensor([math.nan])), "GaussianSum.evaluate.*finite"),
        (lambda: SIX.radius(2.0), "GaussianSum.radius.*between 0 and 1, got 2"),
        (lambda: SIX.radius(0.0), "GaussianSum.radius.*between 0 and 1, got 0"),
        (lambda: RADIAL.hankel(torch.tensor([math.inf])), "RadialProfile.hankel.*finite"),
        (lambda: RADIAL.evaluate(torch.tensor([-1.0])), "distances > 0, got -1"),
        (lambda: RADIAL.radius(1.0), "RadialProfile.radius.*between 0 and 1, got 1"),
        (lambda: RADIAL.radius(math.nan), "RadialProfile.radius.*between 0 and 1, got nan"),
        (lambda: Stack([Layer(SKIN), Layer(SKIN)]), "layer 0 of 2.*only the last"),
        (lambda: BURLEY.evaluate(torch.tensor([0.0, 1.0])), "r > 0.*got 0"),
        (lambda: BURLEY.evaluate(torch.tensor([math.nan])), "r > 0.*got nan"),
        (lambda: BURLEY.hankel(torch.tensor([-1.0])), "s >= 0.*got -1"),
        (lambda: Burley(torch.tensor([0.5]), torch.tensor([0.0])), "d > 0.*got 0"),
        (lambda: Layer(SKIN, -0.5), "thickness.*>= 0"),
        (lambda: Layer(SKIN, torch.tensor([[0.1, math.inf]])), "thickness.*finite"),
        (lambda: stack_from_depths([torch.rand(2, 2, 4)], [SKIN], (1.0, 0.5)), "range.*invert"),
        (lambda: stack_from_depths([torch.full((2, 2, 4), 128.0)], [SKIN], (0.1, 2.0)), "0..1.*by 255"),
        (lambda: stack_from_depths([torch.full((2, 2, 4), math.nan)], [SKIN], (0.1, 2.0)), "0..1.*nan"),
        (lambda: variance_ladder(0.0, 100.0), "texel_mm > 0"),
        (lambda: weights_for(SKIN, torch.tensor([-1.0, 4.0])), "variances >= 0.*-1.0"),
        (lambda: weights_for(SKIN, torch.tensor([math.nan, 4.0])), "variances >= 0.*nan"),
        (lambda: weights_for(SKIN, torch.tensor([1.0, math.inf])), "finite variances.*inf"),
        (lambda: fit_gaussians(SKIN, terms=4, fit="grid"), "terms=None with fit='grid', got 4"),
        (lambda: fit_gaussians(SKIN, torch.tensor([1.0, 4.0]), terms=3), "as many terms as variances, got 3"),
    ],
)
def test_values_that_mean_nothing_are_refused(build, says):
    with pytest.raises(DomainError, match=says) as raised:
        build()
    assert "\n" not in str(raised.value)


def test_maps_of_different_sizes_meet_at_texture_coordinates_only():
    stack = Stack([Layer(Medium(torch.rand(4, 4), 1.0), torch.rand(8, 2)), Layer(SKIN)])
    ladder = variance_ladder(0.4, 100.0, 4)
    with pytest.raises(ShapeError, match=r"one size.*texture coordinates"):
        weights_for(stack, ladder)
    uv = torch.tensor([[0.2, 0.3], [0.9, 0.1]])
    assert weights_for(stack, ladder, points_uv=uv, model="layered-diffusion").at().shape == (2, 4, 3)


def test_each_map_of_a_stack_is_looked_up_as_if_it_were_alone():
    fine, coarse = torch.rand(8, 6), torch.rand(2, 4)
    uv = torch.rand(50, 2)
    both = Stack([Layer(Medium(fine, 1.0), coarse), Layer(SKIN)]).at(uv)
    for field, alone in (
        (both.sigma_a, Stack([Layer(Medium(fine, 1.0), 1.0), Layer(SKIN)]).at(uv).sigma_a),
        (both.thickness, Stack([Layer(Medium(0.1, 1.0), coarse), Layer(SKIN)]).at(uv).thickness),
    ):
        torch.testing.assert_close(field, alone, rtol=0, atol=0, check_dtype=False)


@pytest.mark.parametrize(
    "layers", [[Layer(Medium(0.0, 2.0))], [Layer(Medium(0.0, 1.0), 0.3), Medium(0.0, 2.0)]]
)
def test_what_absorbs_nothing_returns_everything(layers):
    """By every way from a profile: weights, Gaussians, R(r), Burley's fit; without advice."""
    white = Stack(layers)
    totals = [
        weights_for(white, variance_ladder(0.4, 100.0, 8), points=1).total,
        fit_gaussians(white, terms=8).total,
        fit_burley(white).albedo,
    ]
    for total in totals:
        torch.testing.assert_close(total, torch.ones_like(total), rtol=0, atol=1e-3)
    assert bool(torch.isfinite(RadialProfile(white).radius(0.99)).all())
    assert advice(white, texel_mm=0.2, extent_mm=100.0) == []


@pytest.mark.parametrize("model", MODELS)
def test_every_model_answers_at_the_ends_of_its_domain(model):
    """No absorption, no scattering, nothing at all, hard and soft media, almost all forwards: finite."""
    for medium in (
        Medium(0.0, 1.0),
        Medium(1.0, 0.0),
        Medium(0.0, 0.0),
        Medium(1e4, 1e4),
        Medium(1e-7, 1e-7),
        Medium(0.1, 1.0, 0.999),
        Medium(0.1, 1.0, -0.999),
    ):
        for stack in (Stack(medium), Stack([Layer(medium, 0.0), Layer(SKIN)]), Stack([Layer(medium, 0.5)])):
            R, T = hankel_profiles(stack, S.float(), model=model)
            assert bool(torch.isfinite(R).all() and torch.isfinite(T).all())


@pytest.mark.parametrize(
    ("material", "says"),
    [
        (Medium(50.0, 500.0), "less than a quarter of a texel"),
        (Medium(1e-4, 1e-4), "longer than the object"),
        (Stack([Layer(SKIN, 500.0), Layer(SKIN)]), "deeper than the object"),
    ],
)
def test_scales_that_do_not_fit_are_said_with_numbers(material, says):
    sentences = advice(material, texel_mm=0.5, extent_mm=200.0)
    assert any(says in sentence and any(c.isdigit() for c in sentence) for sentence in sentences)


def test_every_error_is_of_the_project():
    for wrong in ({"model": "magic"}, {"scattering": "some"}, {"incidence": "sideways"}, {"phase": "mie"}):
        with pytest.raises(TexsssError, match="expected"):
            hankel_profiles(SKIN, S, **wrong)


def test_frequencies_are_real_and_not_negative():
    whole, real = (
        hankel_profiles(Medium(0.1, 1.0), torch.arange(3, dtype=d))[0] for d in (torch.int64, torch.float64)
    )
    torch.testing.assert_close(whole, real)
    with pytest.raises(DomainError, match="s >= 0"):
        hankel_profiles(Medium(0.1, 1.0), torch.tensor([-1.0]))


@pytest.mark.parametrize(
    "asked",
    [
        {"model": "photon-beam"},
        {"scattering": "double"},
        {"incidence": "grazing"},
        {"incidence": 2.0},
        {"phase": "rayleigh", "scattering": "single"},
        {"model": "layered-diffusion", "scattering": "single"},
    ],
)
def test_unknown_names_list_the_choices(asked):
    with pytest.raises(DomainError, match=r"expected|knows only"):
        hankel_profiles(preset("skin1"), S, **asked)
    with pytest.raises(DomainError, match=r"1\.\.1\.6"):
        hankel_profiles(Medium(0.1, 1.0, 0.0, 2.0), S)
