"""texsss's closed forms against dense solutions of the same equations, and against the truth."""

import numpy as np
import pytest
import torch

from reference import diffusion, sp3
from reference.beam import ballistic
from reference.boundary import diffuse_entry
from reference.layers import Layer as PlainLayer
from reference.stacks import STACKS, read_stacks
from reference.transport import read_transport
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.profiles.hankel import hankel_profiles

S = np.array([0.0, 0.05, 0.3, 1.0, 3.0, 10.0, 40.0])
ETAS = (1.0, 1.1, 1.2, 1.3, 1.33, 1.4, 1.5, 1.6)  # where the two-mode table has entries


def random_stack(seed: int, same_eta: bool, same_sigma_t: bool = False) -> list[PlainLayer]:
    """1 to 4 layers of mean free paths .15 to 5 mm, albedo .4 to .999, thickness .03 to 4 mm or infinite."""
    rng = np.random.default_rng(seed)
    count, eta = 1 + seed % 4, rng.choice(ETAS)
    layers, sigma_t = [], 10 ** rng.uniform(-0.7, 0.8)
    for k in range(count):
        if not same_sigma_t:
            sigma_t = 10 ** rng.uniform(-0.7, 0.8)
        albedo = 1 - 10 ** rng.uniform(-3, -0.2)
        endless = k == count - 1 and rng.random() < 0.5
        layers.append(
            PlainLayer(
                sigma_a=sigma_t * (1 - albedo),
                sigma_s=sigma_t * albedo,
                thickness=np.inf if endless else 10 ** rng.uniform(-1.5, 0.6),
                eta=float(eta if same_eta else rng.choice(ETAS)),
            )
        )
    return layers


def stack_of(layers: list[PlainLayer]) -> Stack:
    return Stack([Layer(Medium(l.sigma_a, l.sigma_s, l.g, l.eta), l.thickness) for l in layers])


def profiles(layers: list[PlainLayer], dtype=torch.float64, s=S, **options) -> tuple[np.ndarray, np.ndarray]:
    R, T = hankel_profiles(stack_of(layers), torch.tensor(s, dtype=dtype), incidence="normal", **options)
    return R[:, 0].double().numpy(), T[:, 0].double().numpy()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("same_eta", [True, False])
def test_layered_diffusion_solves_its_equations(seed, same_eta):
    """R̂ and T̂ of random stacks in both precisions."""
    layers = random_stack(seed, same_eta)
    exact = diffusion.hankel(layers, S)
    for dtype in (torch.float64, torch.float32):
        for ours, truth in zip(profiles(layers, dtype, model="layered-diffusion"), exact, strict=True):
            # measured 4e-5 over 40 stacks (unequal indices, float32)
            np.testing.assert_allclose(ours, truth, rtol=1e-4, atol=1e-4 * exact[0][0])


@pytest.mark.parametrize("seed", range(8))
def test_layered_sp3_solves_its_equations(seed):
    """Multiple scattering is that of the dense two-mode solution, given R1, for isotropic media of one eta.

    Of one extinction, too, so that it does not matter which layers a face sees; and up to one
    factor for R and T at all frequencies, by which a model may mend its energy.
    """
    layers = random_stack(seed, same_eta=True, same_sigma_t=True)
    once = profiles(layers, model="layered-sp3", scattering="single")
    ours = np.concatenate(profiles(layers, model="layered-sp3", scattering="multiple"))
    truth = np.concatenate(sp3.scattered_more(layers, S, once))
    factor = ours[0] / truth[0]
    assert 0.95 < factor < 1.4
    # measured 1.3e-9 over 24 stacks
    np.testing.assert_allclose(ours, factor * truth, rtol=0, atol=1e-7 * truth[0])


def test_the_default_model_meets_the_monte_carlo():
    """R̂(0), and T̂(0) with ballistic light, of all isotropic stacks at normal incidence."""
    wrong = {}
    for name, known in read_stacks("normal").items():
        if any(layer.g for layer in known.layers):
            continue
        R, T = profiles(known.layers)
        wrong[name, "R"] = R[0] / known.totals["R"].mean - 1
        if np.isfinite(known.layers[-1].thickness):
            whole = known.totals["T"].mean + known.totals["T_ballistic"].mean
            wrong[name, "T"] = (T[0] + ballistic(known.layers, "normal")[1]) / whole - 1
    assert len(wrong) > len(STACKS)
    # measured .006; the Monte Carlo's own error is .002
    assert np.mean(np.abs(list(wrong.values()))) < 0.008
    # measured .033 (three layers, half-space, eta 1.5)
    assert max(map(abs, wrong.values())) < 0.04, max(wrong, key=lambda key: abs(wrong[key]))


def test_transmission_of_the_default_model_is_reciprocal():
    """Diffuse light passes about as well from below as from above, whatever the indices."""
    off = []
    for seed in range(60):
        layers = [layer for layer in random_stack(seed, same_eta=False) if np.isfinite(layer.thickness)]
        T = [
            diffuse_entry(way[0].eta) * float(hankel_profiles(stack_of(way), torch.zeros(1))[1][0, 0])
            for way in (layers, layers[::-1])
            if way
        ]
        off += [T[0] / T[1] - 1] if T and T[0] > 0.01 else []
    # measured .046 and .24; .21 and 1.4 where faces kept the losses of their own modes
    assert len(off) > 30
    assert np.mean(np.abs(off)) < 0.06 and max(map(abs, off)) < 0.3


def test_the_default_model_meets_integral_transport(shared_data):
    """Totals, and the profile in the metric ∫ r (f - g)² dr, over the 19 stacks of the table."""
    total, radial = {}, {}
    for known in read_transport(shared_data):
        R, _ = profiles(known.layers, s=known.s)
        distance = np.trapezoid(known.s * (R - known.R) ** 2, known.s)
        total[known.name] = abs(R[0] / known.R[0] - 1)
        radial[known.name] = np.sqrt(distance / np.trapezoid(known.s * known.R**2, known.s))
    # measured .009 and .063; worst .039 and .086
    assert np.mean(list(total.values())) < 0.012
    assert np.mean(list(radial.values())) < 0.075
    assert max(total.values()) < 0.045 and max(radial.values()) < 0.11
