"""Derivatives of profiles where something is exactly 0 are those beside it, as taken from outside."""

import math

import pytest
import torch

from texsss.media.stack import LayerTable
from texsss.profiles.hankel import MODELS, flat_profile

S = torch.tensor([0.0, 0.3, 1.0, 4.0], dtype=torch.float64)
FIELDS = ("sigma_a", "sigma_s", "g", "thickness")
INF = math.inf
BASE = (0.1, 2.0, 0.0, INF)
WHITE = (0.0, 2.0, 0.0, INF)
ZEROS = {
    "white film": ([(0.0, 1.0, 0.0, 0.5), BASE], "sigma_a", 0),
    "white slab": ([(0.0, 1.0, 0.0, 1.2)], "sigma_a", 0),
    "white slab, forwards": ([(0.0, 5.0, 0.8, 1.2)], "sigma_a", 0),
    "white within white": ([(0.0, 1.0, 0.0, 0.5), (0.0, 2.0, 0.0, 1.0)], "sigma_a", 1),
    "absent film": ([(0.3, 1.0, 0.0, 0.0), BASE], "thickness", 0),
    "absent film, forwards": ([(0.0, 5.0, 0.8, 0.0), BASE], "thickness", 0),
    "absent slab": ([(0.1, 1.0, 0.0, 0.0)], "thickness", 0),
    "absent within": ([(0.1, 1.0, 0.0, 0.5), (0.2, 2.0, 0.0, 0.0), (0.1, 3.0, 0.0, 1.0)], "thickness", 1),
    "clear film": ([(0.0, 0.0, 0.0, 0.5), BASE], "sigma_s", 0),
    "clear within": ([(0.1, 1.0, 0.0, 0.5), (0.0, 0.0, 0.0, 0.2), (0.1, 3.0, 0.0, 1.0)], "sigma_s", 1),
    "clear slab": ([(0.0, 0.0, 0.0, 1.0)], "sigma_s", 0),
}


def profile(values, field, layer, x, model, side):
    """R̂ or T̂ (S, N) of layers (sigma_a, sigma_s, g, thickness), of which one number is each of `x` (N,)."""
    fields = []
    for name, column in zip(FIELDS, zip(*values, strict=True), strict=True):
        column = torch.tensor(column, dtype=x.dtype).expand(len(x), -1)
        if name == field:
            column = torch.where(torch.arange(len(values)) == layer, x[:, None], column)
        fields.append(column[..., None])
    table = LayerTable(*fields, eta=(1.3,) * len(values), bottomless=values[-1][3] == INF)
    return flat_profile(table, S.to(x), side=side, model=model, incidence="normal")


def derivatives(places, values, field, layer, model, side="reflectance", dtype=torch.float64):
    """d/dx at every one of `places` and frequency."""
    x = torch.tensor(places, dtype=dtype).repeat_interleave(len(S)).requires_grad_()
    made = profile(values, field, layer, x, model, side)
    made[torch.arange(len(x)) % len(S), torch.arange(len(x))].sum().backward()
    assert x.grad is not None
    return x.grad.double().view(-1, len(S))


def slope(values, field, layer, model, side="reflectance", h=1e-4):
    """The same at 0 from the values at h, 2h and 3h, to second order; nothing is computed at 0."""
    x = h * torch.arange(1, 4, dtype=torch.float64)
    return profile(values, field, layer, x, model, side) @ x.new_tensor([-2.5, 4, -1.5]) / h


@pytest.mark.parametrize("model", ["layered-diffusion", "layered-sp3", "multipole"])
@pytest.mark.parametrize("name", ZEROS)
def test_derivatives_at_zero_are_those_beside_it(name, model):
    """Measured within .12 % of differences, .15 % of those at 1e-6, and .09 % in float32."""
    values, *_ = asked = ZEROS[name]
    for side in ("reflectance", "transmittance")[: 1 if values[-1][3] == INF else 2]:
        found, near = derivatives([0.0, 1e-6], *asked, model, side)
        torch.testing.assert_close(found, slope(*asked, model, side), rtol=2e-3, atol=1e-4)
        torch.testing.assert_close(near, found, rtol=1e-2, atol=1e-4)
        single = derivatives([0.0], *asked, model, side, torch.float32)[0]
        torch.testing.assert_close(single, found, rtol=2e-3, atol=1e-4)


def test_what_darkens_a_clear_film_is_known_where_there_is_nothing_yet():
    """By sigma_a where sigma_s is 0, too, of the default model: .006 % off differences."""
    asked = ([(0.0, 0.0, 0.0, 0.5), BASE], "sigma_a", 0, "layered-sp3")
    torch.testing.assert_close(derivatives([0.0], *asked)[0], slope(*asked), rtol=2e-3, atol=0)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("model", MODELS)
def test_white_half_spaces_darken_at_once_but_by_finite_numbers(model, dtype):
    """dR̂(0)/dσa is -∞: what comes in its place is finite, and far below that at 1e-6; the rest is exact."""
    asked = ([WHITE], "sigma_a", 0, model)
    found, near = derivatives([0.0, 1e-6], *asked, dtype=dtype)
    assert bool(torch.isfinite(found).all()) and float(found[0]) < 1e3 * float(near[0]) < -1e5
    torch.testing.assert_close(found[1:], slope(*asked)[1:], rtol=2e-3, atol=1e-4)
