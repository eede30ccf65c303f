"""Layered diffusion and the two-mode model against dense solutions, limits and laws."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from profile_stacks import random_table, stack_of
from reference import adding, diffusion, even, sp3
from reference.beam import ballistic
from reference.layers import Layer as Row
from reference.stacks import S as MC_S
from reference.stacks import read_stacks
from reference.transport import read_transport

from texsss.errors import DomainError
from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles import layered_diffusion, layered_sp3
from texsss.profiles.four_streams import lacking
from texsss.profiles.hankel import SIDES, flat_profile, hankel_profiles
from texsss.profiles.incidence import incidence_directions, mean_direction
from texsss.profiles.slab import layers_of

S = torch.tensor([0.0, 0.05, 0.3, 1.0, 4.0, 20.0], dtype=torch.float64)

TWO = [Row(0.01, 1.0, 0.05, eta=1.4), Row(0.3, 1.5, eta=1.3)]
THREE = [Row(0.01, 1.0, 0.5, eta=1.5), Row(0.3, 1.5, 2.0, eta=1.2), Row(0.02, 4.0, 0.4, eta=1.4)]
FOUR = [Row(0.0, 2.0, 0.1), Row(0.4, 1.0, 0.2, eta=1.3), Row(0.05, 1.5, 1.0), Row(0.01, 3.0, 4.0, eta=1.45)]
# the twin knows the extinction of the outermost layers only: thick ones, or all alike
MATCHED = [Row(0.01, 1.0, 6.0, eta=1.4), Row(0.3, 1.5, 0.5, eta=1.4), Row(0.02, 4.0, 4.0, eta=1.4)]
ALIKE = [Row(0.1, 1.0, 0.2, eta=1.5), Row(0.4, 0.7, 0.1, eta=1.5), Row(0.01, 1.09, 0.4, eta=1.5)]
PLAIN = [replace(layer, eta=1.0) for layer in ALIKE]
FILMED = [Row(0.01, 1.0, 6.0, eta=1.4), Row(0.002, 0.03, 0.3, eta=1.4), Row(0.02, 4.0, 4.0, eta=1.4)]


@pytest.mark.parametrize("layers", [TWO, THREE, FOUR, FOUR[:1]], ids=["two", "three", "four", "one"])
@pytest.mark.parametrize("cosine", [1.0, 0.6])
def test_layered_diffusion_solves_its_equation(layers, cosine):
    """A dense solution of the boundary-value problem, unequal indices; measured 1e-9."""
    table = stack_of(layers).table()
    cosine = max(cosine, math.sqrt(1 - 1 / layers[0].eta ** 2) + 0.05)  # what refraction leaves possible
    R, T = diffusion.hankel(layers, S.numpy(), cosine=cosine)
    light = [(cosine, 1.0)]
    for side, exact in zip(SIDES, (R, T), strict=True):
        ours = layered_diffusion.profile(table, S, light, side=side)[:, 0]
        np.testing.assert_allclose(ours, exact, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    "layers", [MATCHED, FILMED, PLAIN, PLAIN[:1], [*ALIKE, Row(0.5, 0.6, eta=1.5)], [Row(0.1, 0.9)]]
)
def test_layered_sp3_solves_its_equations(layers):
    """R_c - R_u of the closed form against the same two modes by collocation; measured 1e-8.

    Up to one factor for both sides, which keeps the energy of the stack without absorption.
    """
    assert even.share(layers) < 1e-9
    table, s = stack_of(layers).table(), S.numpy()
    coupled, alone = sp3.collided(layers, s), sp3.collided(layers, s, scattering=False)
    light = ((1.0, 1.0),)
    ours = [layered_sp3.profile(table, S, light, side=side, scattering="multiple")[:, 0] for side in SIDES]
    factor = float(ours[0][0] / (coupled[0] - alone[0])[0])
    assert 0.95 < factor < 1.2
    for mine, with_, without in zip(ours, coupled, alone, strict=True):
        np.testing.assert_allclose(mine, factor * (with_ - without), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("layers", [ALIKE, ALIKE[:1], TWO[:1]])
def test_thin_slabs_between_mirroring_faces_are_lit_evenly(layers):
    """Two modes by collocation and even light by dense quadrature, by their shares, up to one factor.

    Measured .18 % of R̂(0), which the four nodes of the closed form leave.
    """
    s, share = S.numpy(), even.share(layers)
    assert 0.2 < share < 0.999
    coupled, alone = sp3.collided(layers, s), sp3.collided(layers, s, scattering=False)
    ours = [x[:, 0] for x in hankel_profiles(stack_of(layers), S, incidence="normal")]
    once = [x[:, 0] for x in hankel_profiles(stack_of(layers), S, incidence="normal", scattering="single")]
    truth = [
        (1 - share) * (a - b) + share * even.scattered(layers, s) for a, b in zip(coupled, alone, strict=True)
    ]
    factor = float(ours[0][0] - once[0][0]) / truth[0][0]
    assert 0.95 < factor < 1.2
    for total, first, more in zip(ours, once, truth, strict=True):
        np.testing.assert_allclose(total - first, factor * more, rtol=0, atol=0.004 * truth[0][0])


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


def test_layered_sp3_meets_integral_transport(shared_data):
    """Totals of 19 stacks: mean error .9 %, worst 3.9 % (three layers at eta 1.5)."""
    errors = {}
    for known in read_transport(shared_data):
        R, T = hankel_profiles(
            stack_of(known.layers), torch.zeros(1, dtype=torch.float64), incidence="normal"
        )
        errors[known.name] = abs(float(R) / known.R[0] - 1)
        if known.T[0] > 0:
            errors[known.name + " T"] = abs(float(T) / known.T[0] - 1)
    assert sum(errors.values()) / len(errors) < 0.0115, errors
    assert max(errors.values()) < 0.045, errors


def test_single_scattering_meets_integral_transport(shared_data):
    """R1 against the tabulated one: .1 % but for slabs, .6 % by the light's bounces, .75 % at s > 0."""
    s = torch.tensor([0.0, 0.497631, 1.414214], dtype=torch.float64)
    for known in read_transport(shared_data):
        R1, _ = hankel_profiles(stack_of(known.layers), s, incidence="normal", scattering="single")
        index = [int(np.argmin(abs(known.s - float(x)))) for x in s]
        np.testing.assert_allclose(R1[:, 0], known.R1[index], rtol=0.01, err_msg=known.name)
        assert abs(float(R1[0, 0]) / known.R1[0] - 1) < 0.007, known.name


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
@pytest.mark.parametrize("bottom", [None, 0.4])
def test_cutting_a_layer_changes_nothing(model, bottom):
    """N identical layers are one, diffusive scattering to rounding; layered single scattering to 2 %."""
    medium = Medium(0.1, 1.0, 0.0, 1.4)
    one = Stack([Layer(medium, None if bottom is None else bottom + 0.6)])
    cut = Stack([Layer(medium, 0.1), Layer(medium, 0.5), Layer(medium, bottom)])
    scattering = "multiple" if model == "layered-sp3" else "total"
    for a, b in zip(
        *(hankel_profiles(x, S, model=model, scattering=scattering) for x in (one, cut)), strict=True
    ):
        torch.testing.assert_close(a, b, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
def test_limits_of_thickness(model):
    """A thick layer is a half-space, an absent one is not there, and nothing jumps between."""
    top, below = Medium(0.3, 1.0, 0.0, 1.4), Medium(0.02, 2.0, 0.0, 1.4)
    thick, _ = hankel_profiles(Stack([Layer(top, 60.0)]), S, model=model)
    half, _ = hankel_profiles(Stack([Layer(top)]), S, model=model)
    torch.testing.assert_close(thick, half, rtol=1e-7, atol=1e-9)
    bare, _ = hankel_profiles(Stack([Layer(below)]), S, model=model)
    for thickness, tolerance in ((0.0, 1e-10), (1e-6, 1e-5), (1e-3, 1e-2)):  # measured 2e-11, ...
        R, _ = hankel_profiles(Stack([Layer(top, thickness), Layer(below)]), S, model=model)
        torch.testing.assert_close(R, bare, rtol=tolerance, atol=tolerance)
    nothing, through = hankel_profiles(Stack([Layer(top, 0.0)]), S, model=model)
    assert float(nothing.abs().max()) == 0 and float(through.abs().max()) == 0


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


@pytest.mark.parametrize("eta", [1.0, 1.2, 1.33, 1.5])
@pytest.mark.parametrize("depth", [0.05, 0.3, 2.0])
def test_thin_slabs_that_scatter_forwards_meet_adding_doubling(eta, depth):
    """R and T of g = .8, normal and diffuse, unscattered light included; by reduced mean free paths.

    Measured 13 % of R at normal incidence, 9.1 % of R under diffuse light, 3 % of T; 78, 28 and 18 % by
    similarity alone. With three layers of one medium it is the same.
    """
    layers = [Row(0.02 * depth, 0.98 * depth / 0.2, 1.0, g=0.8, eta=eta)]
    truth = adding.totals(layers, 24)
    for incidence, R, T, slack in (
        ("normal", truth.R, truth.T, 0.15),
        ("diffuse", truth.R_diffuse, truth.T_diffuse, 0.095),
    ):
        beam = ballistic(layers, incidence)
        cut = [replace(layers[0], thickness=part) for part in (0.2, 0.5, 0.3)]
        for stack in (layers, cut):
            ours = hankel_profiles(stack_of(stack), S[:1], incidence=incidence)
            above, below = (float(x) + b for x, b in zip(ours, beam, strict=True))
            assert abs(above / R - 1) < slack and abs(below / T - 1) < 0.04, (above / R, below / T)


@pytest.mark.parametrize("eta", [1.0, 1.4])
@pytest.mark.parametrize("g", [-0.5, 0.5, 0.9])
@pytest.mark.parametrize("incidence", ["normal", "diffuse"])
def test_forward_scattering_loses_nothing(eta, g, incidence):
    """All light comes out of two layers that absorb nothing; all but 4e-5 under diffuse light."""
    layers = [Row(0.0, 2.0, 0.1, g=g, eta=eta), Row(0.0, 5.0, 0.4, g=0.3, eta=eta)]
    R, T = hankel_profiles(stack_of(layers), S[:1], incidence=incidence)
    assert abs(float(R + T) + sum(ballistic(layers, incidence)) - 1) < (
        1e-6 if incidence == "normal" else 2e-4
    )


@pytest.mark.parametrize("side", SIDES)
def test_what_similarity_lacks_vanishes_without_forward_scattering(side):
    """0 at g = 0, in proportion to g beside it, and little where layers are thick and absorb little."""
    light = incidence_directions("diffuse", 1.4)

    def lacks(g, thickness, dtype=torch.float64):
        layers = [Row(0.001, 1 / (1 - g), thickness, g=g, eta=1.4), Row(0.002, 2.0, 0.3, eta=1.3)]
        return float(lacking(layers_of(stack_of(layers).table(dtype)), light, side))

    assert abs(lacks(0.0, 0.2)) < 1e-12
    small = lacks(1e-4, 0.2) / 1e-4
    assert abs(small / (lacks(2e-4, 0.2) / 2e-4) - 1) < 1e-2 and abs(small) > 1e-3
    assert abs(lacks(0.8, 0.2)) > 5 * abs(lacks(0.8, 20.0))
    assert abs(lacks(0.8, 0.2, torch.float32) - lacks(0.8, 0.2)) < 1e-6


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


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
@pytest.mark.parametrize("bottomless", [True, False])
@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_single_precision_suffices(model, bottomless, eta):
    """float32 against float64 over random stacks of three layers: 1e-4 of R(0), and never NaN."""
    table = random_table(200, 3, bottomless, eta, seed=3)
    s = torch.cat([torch.zeros(1), torch.logspace(-2, 2, 12)])
    exact = hankel_profiles(table, s.double(), model=model)
    rough = hankel_profiles(table, s, model=model)
    for a, b in zip(exact, rough, strict=True):
        assert bool(torch.isfinite(b).all())
        scale = exact[0].amax(-2, keepdim=True).clamp_min(1e-3)
        assert float(((a - b).abs() / scale).max()) < 1e-4


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
@pytest.mark.parametrize("bottomless", [True, False])
def test_profiles_are_differentiable(model, bottomless):
    """gradcheck in all coefficients, also in g where it is 0 everywhere."""
    table = random_table(2, 2, bottomless, 1.4, seed=5).rows(slice(0, 1))
    fields = [x[..., :1].clone() for x in table.fields]
    finite = slice(0, 1) if bottomless else slice(0, 2)

    def profiles(sigma_a, sigma_s, g, thickness):
        depth = torch.cat([thickness, fields[3][:, 1:]], 1) if bottomless else thickness
        rows = table.of([sigma_a, sigma_s, g, depth])
        side = "reflectance" if bottomless else "transmittance"
        return flat_profile(rows, S[2:4], side=side, model=model, incidence="normal")

    for g in (fields[2] + 0.2, torch.zeros_like(fields[2])):
        inputs = [fields[0] + 0.1, fields[1], g, fields[3][:, finite]]
        given = [x.detach().clone().requires_grad_() for x in inputs]
        assert torch.autograd.gradcheck(profiles, given, fast_mode=True)


def test_gradients_stay_finite_where_nothing_is_absorbed():
    for model in ("layered-diffusion", "layered-sp3"):
        sigma_a = torch.zeros(1, requires_grad=True)
        thickness = torch.zeros(1, requires_grad=True)
        stack = Stack([Layer(Medium(sigma_a, 1.0), thickness), Layer(Medium(sigma_a, 2.0))])
        R, _ = hankel_profiles(stack, torch.tensor([0.0, 1.0]), model=model)
        R.sum().backward()
        assert bool(torch.isfinite(sigma_a.grad).all() and torch.isfinite(thickness.grad).all())


@pytest.mark.parametrize("scattering", ["single", "multiple"])
@pytest.mark.parametrize("phase", ["henyey-greenstein", "schlick"])
def test_phase_functions_shift_light_between_orders(scattering, phase):
    """R1 and the rest add up to R, which no phase function changes without absorption; g = 0 is isotropic."""
    medium = Medium(0.05, 4.0, 0.8, 1.4)
    total, _ = hankel_profiles(medium, S, phase=phase)
    parts = [hankel_profiles(medium, S, scattering=x, phase=phase)[0] for x in ("single", "multiple")]
    torch.testing.assert_close(sum(parts), total)
    reduced, _ = hankel_profiles(Medium(0.05, 0.8, 0.0, 1.4), S)
    assert 0.9 * float(reduced[0]) < float(total[0]) < float(reduced[0]), "turned back later, if at all"
    white = [hankel_profiles(Medium(0.0, *x, 1.4), S, phase=phase)[0][0] for x in ((4.0, 0.8), (0.8, 0.0))]
    torch.testing.assert_close(*white)
    assert float(parts[0][0]) < 0.3 * float(total[0])
    round_ = Medium(0.05, 4.0, 0.0, 1.4)
    for side in zip(
        hankel_profiles(round_, S, scattering=scattering, phase=phase),
        hankel_profiles(round_, S, scattering=scattering),
        strict=True,
    ):
        torch.testing.assert_close(*side)


def test_directions_of_diffuse_light():
    """Means of the cosine inside: 2/3 without refraction, .865 at eta 1.4; shares sum to 1."""
    assert abs(mean_direction("diffuse", 1.0)[0][0] - 2 / 3) < 1e-6
    assert abs(mean_direction("diffuse", 1.4)[0][0] - 0.865) < 1e-3
    for eta in (1.0, 1.1, 1.5):
        shares = [share for _, share in incidence_directions("diffuse", eta)]
        assert len(shares) > 1 and abs(sum(shares) - 1) < 1e-12
    ((cosine, _),) = incidence_directions(math.pi / 4, 1.5)
    assert abs(cosine - math.sqrt(1 - 0.5 / 2.25)) < 1e-12


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
