"""The published models: their closed forms, limits and the algebra on the grid."""

import math

import numpy as np
import pytest
import torch
from profile_stacks import random_table, stack_of
from reference import multipole
from reference.layers import Layer as Row

from texsss.errors import DomainError
from texsss.media import fresnel
from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.numerics.hankel import inverse_hankel
from texsss.numerics.quadrature import graded
from texsss.profiles.dipole import dipole, egan_A
from texsss.profiles.fit import fit_gaussians
from texsss.profiles.gaussians import GaussianSum
from texsss.profiles.grid import CAP, grid_gaussians, multiply, pole_gaussians, pole_weights, split
from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.multipole import stacked
from texsss.profiles.project import radial_error

S = torch.tensor([0.0, 0.2, 1.0, 5.0], dtype=torch.float64)
WIDE = torch.tensor([0.3, 1.0], dtype=torch.float64)


def test_dipole_integrates_to_its_albedo():
    """∫ R_d(r) 2πr dr = α'/2 (e^-σz_r + e^-σz_v)."""
    medium = Medium(sigma_a=[0.1, 0.5], sigma_s=[1.0, 1.0])
    r = torch.logspace(-4, 2, 4001, dtype=torch.float64)
    total = torch.trapezoid(2 * torch.pi * r[:, None] * dipole(r, medium), r, dim=0)
    z_r = medium.mean_free_path
    z_v = z_r + 4 * egan_A(medium.eta) * medium.D_classical
    decay = torch.exp(-medium.sigma_tr_classical * torch.stack([z_r, z_v])).sum(0)
    # trapezoid error, O(h²)
    torch.testing.assert_close(total, medium.albedo_prime / 2 * decay, rtol=1e-5, atol=0)


@pytest.mark.parametrize("eta", [0.7, 0.85, 1.0, 1.1, 1.3, 1.5])
def test_egans_fit_is_the_reflectance_of_diffuse_light(eta):
    """2 ∫ F μ dμ from inside, by quadrature; measured 9.3e-4 (1.1)."""
    A = egan_A(eta)
    assert abs((A - 1) / (A + 1) - 2 * fresnel.moments(eta)[0]) < 1.5e-3


DIFFUSE = {  # reflectance, RGB
    "apple": (0.85, 0.84, 0.53),
    "chicken1": (0.31, 0.15, 0.10),
    "cream": (0.98, 0.90, 0.73),
    "ketchup": (0.16, 0.01, 0.00),
    "marble": (0.83, 0.79, 0.75),
    "potato": (0.77, 0.62, 0.21),
    "skin1": (0.44, 0.22, 0.13),
    "skin2": (0.63, 0.44, 0.34),
    "spectralon": (1.00, 1.00, 1.00),
    "wholemilk": (0.91, 0.88, 0.76),
}


@pytest.mark.parametrize("name", DIFFUSE)
def test_presets_reflect_what_their_table_says(name):
    """The column of diffuse reflectance in Jensen et al. 2001, figure 5: within .008, chicken's blue .026."""
    R, _ = hankel_profiles(preset(name), S[:1], model="dipole")
    off = (R[0] - torch.tensor(DIFFUSE[name])).abs()
    assert float(off.max()) < (0.027 if name == "chicken1" else 0.0085)


def test_dipole_at_a_distance_is_the_inverse_of_its_transform():
    medium = preset("skin1")
    r = torch.tensor([0.01, 0.3, 2.0], dtype=torch.float64)
    back = inverse_hankel(lambda s: hankel_profiles(medium, s, model="dipole")[0], r)
    torch.testing.assert_close(back, dipole(r, medium), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("depth", [1.0, 1.5, 4.0])
def test_closed_form_is_the_sum_of_all_poles(depth):
    """Against ±50 pairs for slabs of at least a mean free path; unequal indices; measured 2e-16."""
    medium = Medium([0.02, 0.1], [1.0, 1.4], 0.0, 1.4)
    stack = Stack([Layer(medium, depth), Layer(Medium(0.02, 2.0, 0.0, 1.2), depth)])
    for closed, explicit in zip(stacked(stack.table(), S), stacked(stack.table(), S, 50), strict=True):
        torch.testing.assert_close(closed, explicit, rtol=0, atol=1e-10)


@pytest.mark.parametrize("sigma_t", [1.0, 0.7, 1.3])
def test_a_slab_of_one_mean_free_path_has_its_source_at_the_bottom(sigma_t):
    """The closed form and the sum of all poles, where d = l but for rounding; measured 2e-16."""
    table = Stack([Layer(Medium(0.1 * sigma_t, 0.9 * sigma_t, 0.0, 1.5), 1 / sigma_t)]).table()
    for closed, explicit in zip(stacked(table, S), stacked(table, S, 50), strict=True):
        torch.testing.assert_close(closed, explicit, rtol=0, atol=1e-10)


def test_slab_at_a_distance_is_the_inverse_of_its_transform():
    slab = Row(0.05, 1.0, 1.5, eta=1.4)
    table, r = stack_of([slab]).table(), torch.tensor([0.2, 1.0, 3.0], dtype=torch.float64)
    for k, side in enumerate(multipole.at_distance(slab, r.numpy())):
        back = inverse_hankel(lambda s, k=k: stacked(table, s)[k], r)
        np.testing.assert_allclose(back[:, 0], side, rtol=1e-5, atol=1e-9)


def test_thick_slab_is_a_dipole():
    medium = Medium(0.3, 1.0, 0.0, 1.4)
    thick, _ = hankel_profiles(Stack([Layer(medium, 60.0)]), S, model="multipole")
    torch.testing.assert_close(thick, hankel_profiles(medium, S, model="dipole")[0], rtol=1e-9, atol=0)


@pytest.mark.parametrize("bottomless", [True, False])
def test_random_multipoles_are_finite_and_lose_light(bottomless):
    table = random_table(300, 3, bottomless, 1.4, seed=1)
    slab = stacked(table.to(torch.float32), S.float())
    assert all(bool(torch.isfinite(x).all()) for x in slab)
    for R, T in ((slab.R_plus, slab.T_plus), (slab.R_minus, slab.T_minus)):
        assert float(R.min()) > -1e-6 and float(T.min()) > -1e-6
        assert float((R + T).max()) < 1 + 1e-5  # measured


def test_transmission_is_the_same_both_ways_through_one_slab():
    """T+ = T- only with equal boundaries; R+ = R- then, too."""
    table = Stack([Layer(Medium(0.05, 1.0, 0.0, 1.3), 2.0)]).table()
    slab = stacked(table, S)
    torch.testing.assert_close(slab.T_plus, slab.T_minus)
    torch.testing.assert_close(slab.R_plus, slab.R_minus)


def test_better_dipole_is_single_plus_multiple():
    medium = preset("skin2")
    total, single, multiple = (
        hankel_profiles(medium, S, model="better-dipole", scattering=x)[0]
        for x in ("total", "single", "multiple")
    )
    torch.testing.assert_close(total, single + multiple)
    # within a tenth of the accurate model, on skin
    accurate = hankel_profiles(medium, S[:1], incidence="normal")[0]
    better = hankel_profiles(medium, S[:1], model="better-dipole", incidence="normal")[0]
    assert float((better / accurate - 1).abs().max()) < 0.12


def test_poles_keep_their_power():
    """The four weights add up to 2π within 3 % (d'Eon et al. 2007)."""
    x = torch.tensor([0.001, 0.1, 0.5, 1.0, 2.0, 4.0], dtype=torch.float64)
    assert float((sum(pole_weights(x)) / (2 * math.pi) - 1).abs().max()) < 0.03


@pytest.mark.parametrize(
    ("x", "error"), [(0.02, 0.068), (0.1, 0.0439), (0.5, 0.0070), (1.0, 0.0120), (2.0, 0.0156), (4.0, 0.0224)]
)
def test_four_gaussians_are_a_pole(x, error):
    """In the metric of d'Eon et al. 2007, against e^-κ|z| / 2; `error` as measured, 37 % at 1 if v0 = z²."""
    s, ds = graded(400, 60.0)
    depth, sigma_tr = torch.tensor([1.0, x], dtype=torch.float64)
    wide, weights = (torch.stack(part)[:, None] for part in pole_gaussians(depth, sigma_tr))
    pole = torch.exp(-torch.hypot(sigma_tr, s))[:, None] / 2
    assert float(radial_error(GaussianSum(wide[:, 0], weights), pole, s, ds)) < 1.02 * error


def test_splitting_keeps_weight_and_mean_variance():
    grid = 0.05 * torch.arange(1, 51, dtype=torch.float64)
    variances = torch.tensor([0.01, 0.05, 0.123, 1.0, 9.0], dtype=torch.float64)
    weights = torch.rand(5, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    out = split(variances, weights, grid)
    torch.testing.assert_close(out.sum(0), weights.sum(0))
    inside = split(variances[1:4], weights[1:4], grid)
    expected = (variances[1:4, None] * weights[1:4]).sum(0)
    torch.testing.assert_close((grid[:, None] * inside).sum(0), expected)


def test_grid_products_are_convolutions():
    """Term i has variance (i + 1) v: weights multiply, variances add, and nothing is lost at the cap."""
    a, b = torch.zeros(CAP, 1), torch.zeros(CAP, 1)
    a[2], b[4], b[CAP - 1] = 0.5, 0.25, 0.1
    out = multiply(a, b)
    assert abs(float(out[7, 0]) - 0.125) < 1e-7 and abs(float(out[CAP - 1, 0]) - 0.05) < 1e-7
    generator = torch.Generator().manual_seed(0)
    a, b = torch.rand(CAP, 2, generator=generator), torch.rand(CAP, 2, generator=generator)
    torch.testing.assert_close(multiply(a, b).sum(0), a.sum(0) * b.sum(0), rtol=1e-4, atol=0)


def test_grid_reproduces_the_combination_it_stands_for():
    """Total of Mayorga's algebra against the Hankel route of the same multipoles."""
    layers = [Layer(Medium(0.01, 2.0, 0.0, 1.4), 2.0), Layer(Medium(0.3, 1.5, 0.0, 1.4))]
    table = Stack(layers).table()
    R, T = grid_gaussians(table)
    assert abs(float(R.total) / float(stacked(table, S[:1]).R_plus) - 1) < 1e-6
    assert float(T.total) == 0
    nine = fit_gaussians(Stack(layers), fit="grid")
    assert nine.variances.tolist() == [0.05, 0.1, 0.15, 0.2, 1.0, 2.0, 5.0, 10.0, 50.0]
    # of a profile of some mm what is wider than a few hundred µm: measured 2.2, 6.3, 5.9 and 21 %
    slab = Stack([Layer(Medium(0.1, 1.0, 0.0, 1.4), 2.0), Layer(Medium(0.3, 1.5, 0.0, 1.4), 3.0)]).table()
    R, _ = grid_gaussians(table, sparse=False)
    _, T = grid_gaussians(slab, sparse=False)
    for made, known, slack in (
        (R, stacked(table, WIDE).R_plus, (0.025, 0.07)),
        (T, stacked(slab, WIDE).T_plus, (0.055, 0.22)),
    ):
        off = (made.hankel(WIDE)[:, 0] / known[:, 0] - 1).abs()
        assert bool((off < torch.tensor(slack)).all()), off
    # ignoring the thin top leaves the layer beneath
    dropped, _ = grid_gaussians(table, drop_below_mfp=10.0)
    alone, _ = grid_gaussians(Stack(layers[1:]).table())
    torch.testing.assert_close(dropped.weights, alone.weights)


def test_the_grid_drops_thin_layers_texel_by_texel():
    """As the paper does: each texel is what it would be alone."""
    top, base = Medium(0.01, 2.0, 0.0, 1.4), Medium(0.3, 1.5, 0.0, 1.4)
    thickness = torch.tensor([[0.1, 2.0], [0.74, 0.75]], dtype=torch.float64)
    options = {"fit": "grid", "drop_below_mfp": 1.5}  # .746 mm
    painted = fit_gaussians(Stack([Layer(top, thickness), Layer(base)]), **options)
    for (i, j), layers in {(0, 0): [], (0, 1): [2.0], (1, 0): [], (1, 1): [0.75]}.items():
        alone = fit_gaussians(Stack([*(Layer(top, d) for d in layers), Layer(base)]), fit="grid")
        torch.testing.assert_close(painted.weights[i, j], alone.weights)
    with pytest.raises(DomainError, match="lower drop_below_mfp"):
        fit_gaussians(Stack(Layer(top, thickness)), **options)


@pytest.mark.parametrize("thickness", [0.0, 0.001, 0.3, 1.0])
def test_grid_ends_and_keeps_light_where_nothing_is_absorbed(thickness):
    """Layers of mean free paths of 4 µm; the bounces between them hardly fade."""
    white = Medium(0.0, 250.0, 0.0, 1.3)
    R, T = grid_gaussians(Stack([Layer(white, thickness), Layer(white)]).table())
    assert abs(float(R.total) - 1) < 1e-4 and float(T.total) == 0
    R, T = grid_gaussians(Stack([Layer(white, thickness), Layer(Medium(0.0, 1.0), 2.0)]).table())
    closed = stacked(Stack([Layer(white, thickness), Layer(Medium(0.0, 1.0), 2.0)]).table(), S[:1])
    assert abs(float(R.total + T.total) - 1) < 1e-4
    assert abs(float(R.total) - float(closed.R_plus)) < 1e-4


def test_thin_slabs_neither_make_light_nor_keep_it():
    """R + T = 1 without absorption whatever the thickness, and an absent slab lets all light through."""
    zero = torch.zeros(1, dtype=torch.float64)
    for eta in (1.0, 1.4):
        for thickness in (0.0, 0.05, 0.5, 1.0, 4.0):
            slab = Stack([Layer(Medium(0.0, 1.0, 0.0, eta), thickness)])
            R, T = hankel_profiles(slab, zero, model="multipole")
            assert abs(float(R + T) - 1) < 1e-9 and float(R) <= thickness
