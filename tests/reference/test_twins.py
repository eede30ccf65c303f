"""The references that solve equations: against closed forms, laws, and their order of convergence."""

import numpy as np
import pytest

from reference import adding, collocation, diffusion, sp3
from reference.boundary import diffuse_entry, fresnel, impedance, internal_moment
from reference.layers import Layer
from reference.transport import read_transport

S = np.array([0.0, 0.05, 0.7, 4.0, 20.0])
THREE = [Layer(0.01, 1.0, 0.5), Layer(0.3, 1.5, 0.3, eta=1.4), Layer(0.02, 3.0, 1.0, eta=1.2)]


def test_moments_obey_the_law_of_radiance():
    """1 - 2 C1(1/eta) = eta² (1 - 2 C1(eta)); 2 C1(1.4) = .5290 (Egan et al. 1973)."""
    for eta in (1.0, 1.1, 1.4, 2.5):
        assert abs(diffuse_entry(eta) - eta**2 * (1 - 2 * internal_moment(eta, 1))) < 1e-9
    assert abs(2 * internal_moment(1.4, 1) - 0.5290) < 5e-5


@pytest.mark.parametrize(("sigma_a", "sigma_s", "eta"), [(0.1, 0.9, 1.4), (0.01, 1.0, 1.0), (0.5, 0.4, 1.5)])
def test_diffusion_of_a_half_space(sigma_a, sigma_s, eta):
    """The elementary solution φ = P (e^{-σt' z} - (1 + 2AD σt')/(1 + 2AD κ) e^{-κ z})."""
    layer = Layer(sigma_a, sigma_s, eta=eta)
    D, sigma, A = diffusion.diffusion_coefficient(layer), layer.sigma_t_prime, impedance(eta)
    kappa = np.sqrt(sigma_a / D + S**2)
    P = sigma_s / (D * (kappa**2 - sigma**2))
    exact = P * (1 - (1 + 2 * A * D * sigma) / (1 + 2 * A * D * kappa)) / (2 * A)
    R, T = diffusion.hankel([layer], S)
    np.testing.assert_allclose(R, exact, rtol=1e-11)  # measured 7e-13
    assert not T.any()


def test_diffusion_loses_no_light():
    """White layers: all that is scattered comes out, R + T = 1 - ballistic light, whatever the indices."""
    layers = [Layer(0, 1.0, 0.05, eta=1.4), Layer(0, 1.5, 0.2, eta=1.3), Layer(0, 7.0, 0.05, eta=1.5)]
    through = np.exp(-sum(layer.sigma_t_prime * layer.thickness for layer in layers))
    top, bottom = float(fresnel(1.0, 1.4)), float(fresnel(1.0, 1.5))
    ballistic = through * (1 - bottom + bottom * (1 - top) * through) / (1 - top * bottom * through**2)
    R, T = diffusion.hankel(layers, S[:1])
    assert abs(R[0] + T[0] + ballistic - 1) < 1e-11  # measured 1.3e-12


def test_collocation_converges_geometrically(monkeypatch):
    def error(points: int) -> float:
        monkeypatch.setattr(collocation, "POINTS", points)
        return float(np.abs(diffusion.hankel(THREE, S)[0] - exact).max())

    monkeypatch.setattr(collocation, "POINTS", 30)
    exact = diffusion.hankel(THREE, S)[0]
    coarse, middle, used = error(6), error(10), error(22)
    assert middle < coarse / 1e3  # measured 5e-5, 6e-9
    assert used < 1e-11


def test_cutting_a_layer_changes_nothing():
    cut = [THREE[0], *(Layer(0.3, 1.5, d, eta=1.4) for d in (0.1, 0.2)), THREE[2]]
    np.testing.assert_allclose(diffusion.hankel(cut, S), diffusion.hankel(THREE, S), rtol=1e-9)
    slab, halves = [Layer(0.05, 1, 1.0, eta=1.4)], [Layer(0.05, 1, 0.5, eta=1.4)] * 2
    np.testing.assert_allclose(sp3.collided(halves, S), sp3.collided(slab, S), rtol=1e-9)


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_two_modes_solve_transport_approximately(shared_data, eta):
    """R_c - R_u is the multiply scattered light within 6 % of the total, the error of the model itself."""
    for stack in read_transport(shared_data):
        if stack.layers[0].eta != eta:
            continue
        few = [0, 10, 18]
        (R, T), (R_u, T_u) = (
            sp3.collided(stack.layers, stack.s[few], scattering) for scattering in (True, False)
        )
        for model, truth, whole in ((R - R_u, stack.Rm, stack.R), (T - T_u, stack.Tm, stack.T)):
            assert np.abs(model - truth[few]).max() <= 0.06 * whole[0], (
                stack.name
            )  # measured .052 (a slab of .3 mm)


def test_two_matched_modes_lose_no_light():
    """At eta = 1 a white slab returns all that it scatters: the modes are a quadrature."""
    layers = [Layer(0, 1.0, 0.3), Layer(0, 3.0, 0.5)]
    R, T = sp3.collided(layers, np.array([1e-5]))  # at 0 a white layer's matrix has no certain root
    # the Gauss nodes' table has seven digits
    assert abs(R[0] + T[0] - 1 + np.exp(-1.8)) < 1e-6


def test_adding_doubling_meets_published_numbers():
    """van de Hulst 1980 (slab, g .75), Giovanelli 1955 (half-space, eta 1.5), the H function (matched)."""
    slab = adding.totals([Layer(1.0, 9.0, 0.2, g=0.75)])
    assert abs(slab.R - 0.09739) < 1e-5
    assert abs(slab.T - 0.66096) < 1e-5
    half = adding.totals([Layer(1.0, 9.0, eta=1.5)])
    assert abs(0.04 + 0.96 * half.R - 0.26) < 1e-4  # measured .25994
    assert abs(adding.totals([Layer(0.1, 0.9)]).R - 0.414947) < 1e-6


def test_adding_doubling_converges_and_loses_no_light():
    layers = [Layer(0.0, 3.0, 0.2, g=0.8, eta=1.4), Layer(0.0, 1.5, 0.5, eta=1.4)]
    coarse, used, fine = (adding.totals(layers, quadrature) for quadrature in (16, 32, 64))
    assert abs(used.R + used.T - 1) < 1e-6
    assert abs(used.R_diffuse + used.T_diffuse - 1) < 1e-6
    assert abs(used.R - fine.R) < 5e-5 < abs(coarse.R - fine.R) * 2
