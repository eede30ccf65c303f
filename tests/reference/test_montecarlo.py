"""The Monte Carlo against published numbers, exact cases and its own error bars (bounds: 4 of them)."""

import numpy as np
import pytest

from reference import adding, montecarlo
from reference.boundary import diffuse_entry, fresnel
from reference.layers import Layer
from reference.montecarlo import BOTTOM, TOP, Estimate, trace
from reference.transport import read_transport


def total(photons, name: str) -> Estimate:
    """Scattered and ballistic light together."""
    scattered, ballistic = photons.totals[name], photons.totals[name + "_ballistic"]
    return Estimate(scattered.mean + ballistic.mean, np.hypot(scattered.error, ballistic.error))


def test_slab_of_van_de_hulst():
    """Optical thickness 2, albedo .9, g .75, matched: R .09739, T .66096 (van de Hulst 1980, table 35)."""
    photons = trace([Layer(sigma_a=1.0, sigma_s=9.0, g=0.75, thickness=0.2)], 400_000, seed=1)
    # error bars 3.7e-4 and 5.0e-4
    assert total(photons, "R").agrees_with(0.09739)
    assert total(photons, "T").agrees_with(0.66096)


def test_half_space_of_giovanelli():
    """Eta 1.5, albedo .9, isotropic: .2600 with the mirror reflection of .04 (Giovanelli 1955)."""
    photons = trace([Layer(sigma_a=1.0, sigma_s=9.0, eta=1.5)], 200_000, seed=2)
    assert photons.totals["R"].agrees_with((0.2600 - 0.04) / 0.96, slack=0.00005 / 0.96)  # its last digit


def test_half_space_of_chandrasekhar():
    """Matched half-space, albedo .9: total .41495, of which single .13808 = a/2 (1 - ln 2) (H functions)."""
    photons = trace([Layer(sigma_a=0.1, sigma_s=0.9)], 200_000, seed=3)
    assert photons.totals["R"].agrees_with(0.41495)
    assert photons.totals["R1"].agrees_with(0.45 * (1 - np.log(2)))


@pytest.mark.parametrize(
    ("sigma_a", "sigma_s", "eta", "R"),
    [
        (0.0021, 2.19, 1.5, 0.8380),
        (0.032, 0.74, 1.3, 0.4389),
        (0.17, 0.88, 1.3, 0.2134),
        (0.48, 1.01, 1.3, 0.1155),
    ],
)
def test_half_spaces_of_another_monte_carlo(sigma_a, sigma_s, eta, R):
    photons = trace([Layer(sigma_a, sigma_s, eta=eta)], 20_000, seed=4)
    assert photons.totals["R"].agrees_with(R, slack=0.002)  # the other one's error bar, 4·10⁵ photons at best


def test_ballistic_light_bounces_between_the_faces():
    """Tb = (1 - F) e^-τ / (1 - F² e^-2τ), Rb = F e^-τ Tb, per unit of entered light."""
    layer = Layer(sigma_a=0.5, sigma_s=0.7, thickness=0.4, eta=1.5)
    photons = trace([layer], 200_000, seed=5)
    F, e = float(fresnel(1.0, 1.5)), np.exp(-layer.sigma_t * layer.thickness)
    T = (1 - F) * e / (1 - (F * e) ** 2)
    assert photons.totals["T_ballistic"].agrees_with(T)
    assert photons.totals["R_ballistic"].agrees_with(F * e * T)


def test_nothing_is_lost_where_nothing_is_absorbed():
    layers = [
        Layer(0, 3, 0.2, g=0.8, eta=1.4),
        Layer(0, 1, 0.3, eta=1.2),
        Layer(0, 2, 0.1, g=0.6, phase="schlick"),
    ]
    totals = trace(layers, 5_000, seed=6, incidence=1.0).totals
    assert sum(
        float(totals[name].mean) for name in ("R", "T", "R_ballistic", "T_ballistic")
    ) == pytest.approx(1)


def test_transmission_is_reciprocal_across_unequal_indices():
    """Diffuse light passes as well from below as from above, per unit of incident light."""
    layers = [Layer(0.1, 2, 0.3, eta=1.5), Layer(0.02, 1, 0.2, g=0.5, eta=1.1), Layer(0.3, 1, 0.4, eta=1.3)]
    down = total(trace(layers, 200_000, seed=7, incidence="diffuse"), "T")
    up = total(trace(layers[::-1], 200_000, seed=8, incidence="diffuse"), "T")
    entry, exit = diffuse_entry(1.5), diffuse_entry(1.3)
    error = np.hypot(entry * down.error, exit * up.error)
    assert Estimate(entry * down.mean, error).agrees_with(exit * up.mean)


def test_cut_slab_is_the_slab():
    whole = trace([Layer(0.1, 4, 0.6, g=0.5, eta=1.4)], 100_000, seed=9).totals
    cut = trace([Layer(0.1, 4, d, g=0.5, eta=1.4) for d in (0.1, 0.2, 0.3)], 100_000, seed=10).totals
    for name, estimate in whole.items():
        error = np.hypot(estimate.error, cut[name].error)
        assert Estimate(estimate.mean, error).agrees_with(cut[name].mean), name


@pytest.mark.parametrize("g", [-0.6, 0.0, 0.3, 0.9])
@pytest.mark.parametrize("phase", ["henyey-greenstein", "schlick"])
def test_deflections_have_their_mean_cosine(phase, g):
    rng = np.random.default_rng(11)
    cosines = np.array([montecarlo._deflection(rng, g, phase == "schlick") for _ in range(40_000)])
    assert np.all(np.abs(cosines) <= 1)
    assert abs(cosines.mean() - Layer(0, 1, g=g, phase=phase).mean_cosine) < 4 * cosines.std() / 200


@pytest.mark.parametrize("incidence", ["normal", "diffuse"])
@pytest.mark.parametrize(
    "layers",
    [
        [Layer(0.01, 1.0, 0.5), Layer(0.3, 1.5)],
        [Layer(0.01, 3.0, 0.2, g=0.8, eta=1.4), Layer(0.3, 1.5, 0.5, eta=1.4), Layer(0.05, 2, 0.5, eta=1.4)],
        [Layer(0.01, 1.0, 0.1, eta=1.5)],
    ],
    ids=["bright on dark", "three layers", "thin slab"],
)
def test_adding_doubling_agrees(layers, incidence):
    photons = trace(layers, 100_000, seed=12, incidence=incidence)
    truth = adding.totals(layers)
    diffuse = incidence == "diffuse"
    assert total(photons, "R").agrees_with(truth.R_diffuse if diffuse else truth.R, slack=5e-5)
    assert total(photons, "T").agrees_with(truth.T_diffuse if diffuse else truth.T, slack=5e-5)


@pytest.mark.parametrize("name", ["a.4 e1.33", "1mm e1.33", "3lay e1.4"])
def test_integral_transport_agrees_at_all_frequencies(shared_data, name):
    """R̂1, T̂1 and totals of the table, which itself is good to 1 %."""
    stack = next(stack for stack in read_transport(shared_data) if stack.name == name)
    photons = trace(stack.layers, 60_000, seed=13)
    for side, single, scattered in ((TOP, stack.R1, stack.R), (BOTTOM, stack.T1, stack.T)):
        for orders, truth in (("single", single), ("scattered", scattered)):
            estimate = photons.hankel(side, orders, stack.s)
            assert estimate.agrees_with(truth, slack=0.01 * truth.max()), (name, side, orders)


def test_histogram_and_hankel_are_of_one_distribution():
    photons = trace([Layer(0.2, 0.8)], 30_000, seed=14)
    edges = np.append(0, np.geomspace(1e-4, 1e3, 50))
    area = np.pi * np.diff(edges**2)
    ring = photons.histogram(TOP, "scattered", edges)
    R = photons.totals["R"].mean
    np.testing.assert_allclose(ring.mean @ area, R, rtol=1e-12)
    np.testing.assert_allclose(photons.hankel(TOP, "scattered", np.zeros(1)).mean, R, rtol=1e-12)


def test_error_bars_are_honest():
    """The spread of 60 runs is what each claims, within four times the 1/sqrt(2·59) of such a spread."""
    runs = [trace([Layer(0.5, 0.5, eta=1.3)], 2_000, seed=seed).totals["R"] for seed in range(60)]
    spread = np.std([run.mean for run in runs], ddof=1)
    assert spread == pytest.approx(np.mean([run.error for run in runs]), rel=4 / np.sqrt(2 * 59))


def test_a_seed_says_everything():
    layers = [Layer(0.1, 1, 0.5, eta=1.4), Layer(0.3, 1, g=0.4)]
    first, again, other = (trace(layers, 1_000, seed=seed, incidence="diffuse") for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.weight, again.weight)
    assert not np.array_equal(first.weight, other.weight)
