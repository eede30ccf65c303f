"""texsss's closed forms against dense solutions of the same equations, and against the truth."""

import numpy as np
import pytest
import torch

from reference import diffusion, sp3
from reference.layers import Layer as PlainLayer
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.profiles.hankel import hankel_profiles

S = np.array([0.0, 0.05, 0.3, 1.0, 3.0, 10.0, 40.0])
ETAS = (1.0, 1.1, 1.2, 1.3, 1.33, 1.4, 1.5, 1.6)  # where the two-mode table has entries


def random_stack(seed: int, same_eta: bool) -> list[PlainLayer]:
    """1 to 4 layers of mean free paths .15 to 5 mm, albedo .4 to .999, thickness .03 to 4 mm or infinite."""
    rng = np.random.default_rng(seed)
    count, eta = 1 + seed % 4, rng.choice(ETAS)
    layers = []
    for k in range(count):
        sigma_t, albedo = 10 ** rng.uniform(-0.7, 0.8), 1 - 10 ** rng.uniform(-3, -0.2)
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


def profiles(layers: list[PlainLayer], dtype=torch.float64, **options) -> tuple[np.ndarray, np.ndarray]:
    stack = Stack([Layer(Medium(l.sigma_a, l.sigma_s, l.g, l.eta), l.thickness) for l in layers])
    R, T = hankel_profiles(stack, torch.tensor(S, dtype=dtype), incidence="normal", **options)
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
    """Multiple scattering is R_c - R_u of the dense two-mode solution, isotropic media of one eta."""
    layers = random_stack(seed, same_eta=True)
    collided, uncollided = (sp3.collided(layers, S, scattering) for scattering in (True, False))
    ours = profiles(layers, model="layered-sp3", scattering="multiple")
    for value, c, u in zip(ours, collided, uncollided, strict=True):
        # measured 1.3e-9 over 24 stacks
        np.testing.assert_allclose(value, c - u, rtol=0, atol=1e-7 * collided[0][0])
