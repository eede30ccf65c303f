"""Gaussian sums, projection onto a ladder, and weights per texel."""

import pytest
import torch

from texsss.errors import Cancelled, ConvergenceError, DomainError
from texsss.media.medium import Medium, mix
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.numerics.hankel import inverse_hankel
from texsss.numerics.quadrature import graded
from texsss.profiles.burley import Burley, fit_burley
from texsss.profiles.fit import fit_error, fit_gaussians
from texsss.profiles.gaussians import GaussianSum, human_skin
from texsss.profiles.hankel import as_table, flat_profile, hankel_profiles
from texsss.profiles.project import frequencies, project, radial_error, variance_ladder
from texsss.profiles.weights import weights_for

ZERO = torch.zeros(1, dtype=torch.float64)


def test_gaussian_sums_integrate_to_their_total():
    skin = human_skin()
    r = torch.linspace(1e-6, 30, 60001, dtype=torch.float64)
    total = torch.trapezoid(2 * torch.pi * r[:, None] * skin.evaluate(r), r, dim=0)
    torch.testing.assert_close(total, skin.total, rtol=1e-4, atol=0)
    torch.testing.assert_close(skin.total, torch.ones(3).double(), rtol=2e-3, atol=0)
    torch.testing.assert_close(skin.hankel(ZERO)[0], skin.total)


def test_radius_holds_its_share():
    """Of one Gaussian, 1 - e^(-r²/2v) comes back within r."""
    one = GaussianSum(torch.tensor([2.0]).double(), torch.tensor([[0.3]]).double())
    assert abs(float(one.radius(0.99)) - (4 * torch.log(torch.tensor(100.0).double())) ** 0.5) < 1e-9


def test_gaussian_sums_check_themselves():
    with pytest.raises(DomainError, match="variances >= 0"):
        GaussianSum(-torch.ones(2), torch.ones(2, 1))


@pytest.mark.parametrize(
    ("texel", "extent", "widest"),
    [(0.5, 1000.0, 35.0), (0.2, 100.0, 14.0), (0.02, 20.0, 4.0), (4.0, 20.0, 4.8)],
)
def test_ladders_reach_from_the_texel_to_the_object(texel, extent, widest):
    """Deviations of .6 texels to 3.5 % of the extent; of small ones to 14 mm, a fifth, or twice the first."""
    ladder = variance_ladder(texel, extent).sqrt()
    assert [float(x) for x in ladder[[0, 1, -1]]] == pytest.approx([0.0, 0.6 * texel, widest])


def test_ladders_depend_on_geometry_alone():
    ladder = variance_ladder(0.5, 400.0, 8)
    assert ladder.shape == (8,) and float(ladder[0]) == 0 and bool((ladder.diff() > 0).all())
    steps = ladder[1:].log().diff()
    assert bool((steps[1:].diff() > 0).all()) and float(steps[0] / steps[-1]) == pytest.approx(1)
    assert float(variance_ladder(0.5, 100.0, 4)[-1].sqrt()) == pytest.approx(7)  # few reach less far
    for terms in (1, 2, 3):
        assert variance_ladder(0.5, 400.0, terms).shape == (terms,)
    for bad in ((0.0, 1.0, 8), (1.0, float("nan"), 8), (1.0, 10.0, 0)):
        with pytest.raises(DomainError):
            variance_ladder(*bad)


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
@pytest.mark.parametrize(("texel", "extent"), [(0.2, 300.0), (0.6, 450.0)])
def test_projection_holds_profiles_to_a_percent(model, texel, extent):
    """8 terms over tops of .05 to 8 mm, in the metric of d'Eon et al. 2007; measured .15 to .73 %."""
    thickness = torch.logspace(-1.3, 0.9, 25, dtype=torch.float64)[None]
    stack = Stack([Layer(Medium(0.01, 1.0, 0.0, 1.4), thickness), Layer(Medium(0.3, 1.5, 0.0, 1.4))])
    ladder = variance_ladder(texel, extent, 8)
    s, _ = frequencies(ladder)
    R, _ = hankel_profiles(stack, s, model=model)
    R0, _ = hankel_profiles(stack, ZERO, model=model)
    fitted = GaussianSum(ladder, project(R, R0[..., 0, :], ladder))
    dense, ds = graded(300, torch.pi / texel, 6.0)
    error = radial_error(fitted, hankel_profiles(stack, dense, model=model)[0], dense, ds)
    assert float(error.max()) < 0.008, error
    torch.testing.assert_close(fitted.total, R0[..., 0, :], rtol=1e-12, atol=0)


@pytest.mark.parametrize(("texel", "extent"), [(0.125, 50.0), (0.25, 100.0), (0.6, 240.0)])
def test_projection_holds_presets_on_objects_wider_than_they_spread(texel, extent):
    """Within a percent; measured .77, .77 and .83 %; even steps to 5 mm had 3.1, 10.8 and 3.7 %."""
    film = torch.logspace(-1.3, 0.9, 5, dtype=torch.float64)[None]
    stacks = [Stack(preset(name)) for name in ("skin1", "marble", "potato", "apple", "wholemilk", "ketchup")]
    stacks += [Stack([Layer(preset("skin1"), film), Layer(preset(name))]) for name in ("marble", "potato")]
    if extent >= 100:  # of which 99 % comes back within 54 mm
        stacks.append(Stack(preset("chicken1")))
    ladder = variance_ladder(texel, extent)
    (s, _), (dense, ds) = frequencies(ladder), graded(100, torch.pi / texel, 6.0)
    for stack in stacks:
        R = hankel_profiles(stack, torch.cat([s, dense, ZERO]))[0]
        met, truth, total = R.split([len(s), len(dense), 1], -2)
        fitted = GaussianSum(ladder, project(met, total[..., 0, :], ladder))
        assert float(radial_error(fitted, truth, dense, ds).max()) < 0.01


@pytest.mark.parametrize("name", ["skin1", "marble", "spectralon", "ketchup"])
def test_weights_of_presets_keep_energy(name):
    """Σ w = R̂(0), also where nothing is absorbed."""
    weights = weights_for(preset(name), variance_ladder(0.4, 400.0, 8), points=5)
    assert weights.table.shape == (1, 8, 3) and weights.at().shape == (5, 8, 3)
    exact = hankel_profiles(preset(name), ZERO)[0]
    torch.testing.assert_close(weights.total, exact.float().expand(5, 3), rtol=2e-5, atol=0)


def _varied(size: int = 24) -> tuple[Stack, torch.Tensor]:
    generator = torch.Generator().manual_seed(2)
    mask = (torch.rand(size, size, generator=generator) * 7).round() / 7
    thickness = (torch.rand(size, size, generator=generator) * 3).round() / 3 * 2
    medium = mix(preset("skin1"), preset("skin2"), mask)
    y, x = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    uv = (torch.stack([x, y], -1).reshape(-1, 2).double() + 0.5) / size
    return Stack([Layer(medium, thickness), Layer(preset("skin1"))]), uv


def test_equal_rows_are_solved_once():
    stack, uv = _varied()
    ladder = variance_ladder(0.4, 400.0, 8)
    shared = weights_for(
        stack, ladder, points_uv=uv, model="layered-diffusion", dtype=torch.float64, levels=None
    )
    assert len(shared.table) <= 8 * 4
    every = hankel_profiles(stack, torch.cat([frequencies(ladder)[0], ZERO]), model="layered-diffusion")[0]
    direct = project(every[..., :-1, :], every[..., -1, :], ladder).reshape(len(uv), 8, 3)
    torch.testing.assert_close(shared.at(), direct, rtol=1e-7, atol=1e-9)


def test_rounding_to_levels_makes_tables():
    generator = torch.Generator().manual_seed(0)
    stack = Stack(
        [Layer(preset("skin1"), torch.rand(64, 64, generator=generator) * 2), Layer(preset("skin2"))]
    )
    ladder = variance_ladder(0.4, 400.0, 6)
    exact = weights_for(stack, ladder, model="layered-diffusion", levels=None)
    rounded = weights_for(stack, ladder, model="layered-diffusion")
    assert len(rounded.table) <= 256 < len(exact.table)
    assert (
        float((exact.total - rounded.total).abs().max()) < 5e-3
    )  # measured 2.2e-3 where the layer is thinnest


def test_maps_that_vary_independently_stay_exact():
    """Three of them never make a table; a mask that mixes two media is one map, its colours included."""
    generator = torch.Generator().manual_seed(4)
    a, b, c = torch.rand(3, 64, 64, generator=generator)
    ladder = variance_ladder(0.4, 400.0, 4)
    free = Stack([Layer(Medium(a, 1 + b), c), Layer(Medium(0.1, 1.0))])
    assert len(weights_for(free, ladder, model="layered-diffusion").table) == 64 * 64
    mixed = Stack([Layer(mix(preset("skin1"), preset("skin2"), a), 0.5), Layer(preset("skin1"))])
    assert len(weights_for(mixed, ladder, model="layered-diffusion").table) <= 256


def test_levels_are_finest_where_little_is_absorbed():
    """σa of 0 to 1/mm, painted smoothly: totals move by .0079 at worst, by .16 on even levels."""
    sigma_a = torch.rand(64, 64, generator=torch.Generator().manual_seed(5))
    sigma_a[0, 0] = 0
    ladder = variance_ladder(0.4, 400.0, 4)
    exact, rounded = (
        weights_for(Medium(sigma_a, 1.0, 0.0, 1.4), ladder, model="layered-diffusion", levels=levels)
        for levels in (None, 256)
    )
    assert len(rounded.table) <= 256 < len(exact.table)
    torch.testing.assert_close(rounded.total, exact.total, rtol=0, atol=0.012)
    bits = weights_for(
        Medium((sigma_a * 255).round() / 255, 1.0, 0.0, 1.4), ladder, model="layered-diffusion"
    )
    even = weights_for(
        Medium((sigma_a * 255).round() / 255, 1.0, 0.0, 1.4), ladder, model="layered-diffusion", levels=None
    )
    assert torch.equal(bits.total, even.total)


@pytest.mark.parametrize("levels", [None, 256])
@pytest.mark.parametrize(
    ("what", "extreme"), [("film", 1e5), ("film", 1000.0), ("ink", 40.0), ("black", 1e5)]
)
def test_a_few_extreme_texels_flatten_no_map(what, extreme, levels):
    """Against every row on its own; worst 5.1e-4, of levels; with steps of the whole range .36."""
    map_ = torch.rand(100, 100, generator=torch.Generator().manual_seed(3))
    map_ = map_ * 0.5 if what == "film" else map_ * 0.05 + 0.001
    map_[:10, :20] = extreme
    if what == "black":  # thicknesses only have no end
        map_[:50] = torch.linspace(6e4, 1.6e5, 5000).view(50, 100)
    if what == "film":
        stack = Stack([Layer(Medium(0.01, 3.0), map_), Layer(Medium(0.5, 5.0))])
    else:
        stack = Stack(Layer(Medium(map_, 2.0)))
    ladder = variance_ladder(0.4, 400.0, 2)
    made = weights_for(stack, ladder, model="layered-diffusion", levels=levels, channels=1)
    own = as_table(stack, torch.float32).expand(1)
    own = own.of([x.reshape(-1, *x.shape[-2:]) for x in own.fields])
    exact = flat_profile(own, ZERO.float(), model="layered-diffusion", side="reflectance")
    torch.testing.assert_close(made.total[:, 0], exact.flatten(), rtol=0, atol=7e-4)


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3"])
def test_weights_are_differentiable_in_maps(model):
    """gradcheck in absorption, scattering, g and thickness maps, along random directions."""
    ladder = variance_ladder(0.5, 100.0, 3)
    uv = torch.tensor([[0.2, 0.3]])

    def table(sigma_a, sigma_s, g, thickness):
        stack = Stack([Layer(Medium(sigma_a, sigma_s, g, 1.4), thickness), Layer(preset("skin1"))])
        weights = weights_for(
            stack, ladder, points_uv=uv, model=model, dtype=torch.float64, nodes=3, channels=1
        )
        return weights.at()

    generator = torch.Generator().manual_seed(1)
    inputs = [
        (low + torch.rand(2, 2, generator=generator, dtype=torch.float64)).requires_grad_()
        for low in (0.05, 1.0, -0.5, 0.2)
    ]
    assert torch.autograd.gradcheck(table, inputs, fast_mode=True)


def test_a_white_half_space_can_be_darkened_from_exactly_0():
    """Adam reaches a total of .7 in 100 steps; a first derivative of 1e12 would have stopped it for good."""
    ladder = variance_ladder(0.5, 100.0, 3)
    sigma_a, total = torch.zeros(1, dtype=torch.float64, requires_grad=True), torch.ones(1)
    search = torch.optim.Adam([sigma_a], lr=0.01)
    for step in range(100):
        medium = Medium(sigma_a, 1.0)
        total = weights_for(medium, ladder, points=1, dtype=torch.float64, nodes=3, channels=1).total
        if step == 0:
            torch.testing.assert_close(total, torch.ones_like(total), rtol=1e-6, atol=0)
            (slope,) = torch.autograd.grad(fit_gaussians(medium).total.sum(), sigma_a)
            assert -1e3 < float(slope) < -100
        search.zero_grad()
        (total - 0.7).square().sum().backward()
        search.step()
        sigma_a.data.clamp_min_(0)
    assert float(total.detach()) == pytest.approx(0.7, abs=0.02)


def test_white_half_spaces_have_the_other_derivatives_of_white_ones():
    """All light comes back, however it scatters; and none of a clear half-space, however dark it is."""
    sigma_a, sigma_s = (torch.tensor([x], dtype=torch.float64, requires_grad=True) for x in (0.0, 1.0))
    total = fit_gaussians(Medium(sigma_a, sigma_s)).total.sum()
    assert float(torch.autograd.grad(total, sigma_s)[0]) == pytest.approx(0, abs=1e-6)
    clear = Stack([Layer(Medium(0.01, 1.0), 0.5), Layer(Medium(sigma_a, 0.0))])
    assert float(torch.autograd.grad(fit_gaussians(clear).total.sum(), sigma_a)[0]) == 0


def test_weights_stop_when_asked():
    with pytest.raises(Cancelled):
        weights_for(preset("skin1"), variance_ladder(0.5, 100.0), cancel=lambda: True)


def test_grey_materials_have_three_channels():
    assert weights_for(Medium(0.1, 1.0), variance_ladder(0.5, 100.0, 4)).table.shape == (1, 4, 3)


def test_fits_agree_with_the_profile():
    """Six terms: projected 2.5 %, optimised .6 % of skin1; the optimiser must not lose."""
    medium = preset("skin1")
    errors = {
        fit: float(fit_error(fit_gaussians(medium, terms=6, fit=fit), medium).max())
        for fit in ("project", "optimise")
    }
    assert errors["optimise"] < 0.01 and errors["optimise"] < errors["project"] < 0.04
    with pytest.raises(ConvergenceError, match="of its own scale"):
        fit_gaussians(preset("skin1"), torch.tensor([1e30, 2e30]), fit="optimise")
    with pytest.raises(DomainError, match="project, grid, optimise"):
        fit_gaussians(medium, fit="guess")


def test_burley_fits_what_it_is():
    r = torch.linspace(1e-4, 60, 400001, dtype=torch.float64)
    shape = Burley(torch.tensor([0.6]).double(), torch.tensor([0.8]).double())
    total = torch.trapezoid(2 * torch.pi * r[:, None] * shape.evaluate(r), r, dim=0)
    assert abs(float(total) / 0.6 - 1) < 1e-3
    far = torch.tensor([0.5, 3.0], dtype=torch.float64)
    torch.testing.assert_close(inverse_hankel(shape.hankel, far), shape.evaluate(far), rtol=1e-6, atol=0)
    fitted = fit_burley(preset("skin1"))
    exact = hankel_profiles(preset("skin1"), ZERO)[0][0]
    torch.testing.assert_close(fitted.albedo, exact)
    # fitted to the Monte Carlo's profile of red
    assert float(fitted.d[0]) == pytest.approx(1.086, rel=0.02)
    # by hand: black, where the square of Christensen & Burley 2015 vanishes, and white
    three = torch.tensor([0.0, 0.8, 1.0])
    times = Burley(three, torch.ones(3)).mean_free_path
    torch.testing.assert_close(times, torch.tensor([4.14, 1.1, 1.04]))
