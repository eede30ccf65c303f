"""The compiled loop has the weights that torch has."""

from dataclasses import replace

import pytest
import torch
from profile_stacks import random_table

from texsss.errors import DomainError
from texsss.media.presets import preset
from texsss.media.stack import Layer, LayerTable, Stack
from texsss.numerics import native
from texsss.numerics.recorded import Value
from texsss.profiles import weights
from texsss.profiles.blocks import Loops, recorded
from texsss.profiles.fused import Fused
from texsss.profiles.hankel import SIDES, flat_profile
from texsss.profiles.project import variance_ladder
from texsss.profiles.weights import weights_for

pytestmark = pytest.mark.skipif(native._compiler() is None, reason="no C++ compiler: nothing is compiled")

S = torch.cat([torch.logspace(-2, 2, 5), torch.zeros(1)])
ROWS = 40


def looped(table, **options) -> torch.Tensor:
    """Profiles (S, N) by the loop: weights of one term per frequency."""
    loop = Fused(table, S, torch.eye(len(S)), **options)
    assert loop.ready
    rows = table.batch[0]
    made = torch.full((rows, len(S), table.channels), torch.nan)
    with pytest.raises(AssertionError):
        loop(slice(7, rows + 1), made)
    loop(slice(0, 7), made)  # the last vector of either part is not full
    loop(slice(7, rows), made)
    return made.permute(1, 2, 0).flatten(1)


@pytest.mark.parametrize(
    ("etas", "bottomless"),
    [
        ((1.4,), True),
        ((1.05,), False),
        ((1.6, 1.3), True),
        ((1.0, 1.0), False),
        ((1.0, 1.5), False),
        ((1.4, 1.0, 1.5), True),
        ((1.3, 1.3, 1.3), False),
        ((1.5, 1.2, 1.05, 1.05), False),
    ],
)
def test_float32_is_float64_within_rounding(etas, bottomless):
    """Random stacks, .005 to 20 mm, g of -.8 to .9: 6e-5 of R(0), or of .001; 58,000 by loop and torch."""
    table = random_table(ROWS, len(etas), bottomless, 1.0, seed=3)
    g = torch.rand(table.g.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1)) * 1.7 - 0.8
    forward = replace(table, g=g, eta=etas).to(torch.float32)
    isotropic = replace(forward, g=torch.zeros_like(forward.g))
    own = "reflectance" if bottomless else "transmittance"
    for rows, side, model, scattering, incidence in (
        (forward, own, "layered-diffusion", "total", "diffuse"),
        (isotropic, "reflectance", "layered-sp3", "total", "diffuse"),
        (forward, own, "layered-sp3", "total", 1.0),
        (forward, "reflectance", "layered-sp3", "multiple", "normal"),
        (forward, "reflectance", "layered-sp3", "unmarched", "diffuse"),
        (forward, own, "layered-sp3", "single", "normal"),
    ):
        asked = {"side": side, "model": model, "scattering": scattering, "incidence": incidence}
        exact = rows.to(torch.float64)
        zero = flat_profile(exact, S[-1:].double(), model=model, side="reflectance")
        true = flat_profile(exact, S.double(), **asked)
        for made in (looped(rows, **asked), flat_profile(rows, S, **asked)):
            worst = float(((made - true).abs() / zero.clamp_min(1e-3)).max())  # NaN is not below anything
            assert worst < 1e-4, (asked, worst)


@pytest.mark.parametrize("bottomless", [True, False])
def test_what_no_matter_is_stays_finite(bottomless):
    """σ from 0 to 1e6/mm, absent layers and such of 100 m, also above others: 7.2e-5 by the loop."""
    coefficients = torch.tensor([0.0, 1e-6, 1.0, 1e3, 1e6], dtype=torch.float64)
    thickness = torch.tensor([0.0, 1e-6, 1.0, 1e5], dtype=torch.float64)
    top = torch.cartesian_prod(coefficients, coefficients, thickness)
    under = torch.cat(
        [top[torch.randperm(len(top), generator=torch.Generator().manual_seed(k))] for k in (0, 1)]
    )
    sigma_a, sigma_s, d = torch.stack([top.repeat(2, 1), under], 1).unbind(-1)
    if bottomless:
        d[:, 1] = torch.inf
    fields = [x[..., None].float() for x in (sigma_a, sigma_s, torch.full_like(d, 0.5), d)]
    table = LayerTable(*fields, (1.3, 1.4), bottomless)
    for model, scattering, side in (
        ("layered-diffusion", "total", SIDES[not bottomless]),
        ("layered-sp3", "total", "reflectance"),
        ("layered-sp3", "unmarched", SIDES[not bottomless]),
    ):
        asked = {"side": side, "model": model, "scattering": scattering, "incidence": "diffuse"}
        exact = flat_profile(table.to(torch.float64), S.double(), **asked)
        assert float(exact.abs().max()) < 1.01
        loop, eager = looped(table, **asked), flat_profile(table, S, **asked)
        torch.testing.assert_close(loop.double(), exact, rtol=0, atol=2e-4)
        assert bool(
            torch.isfinite(eager).all()
        )  # of 1e-6 mm over 100 m that are 1e12 times clearer all digits go


@pytest.mark.parametrize("side", ["reflectance", "transmittance"])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_clear_layers_lose_nothing_in_float32(place, side):
    """Clear films, absent or .3 mm, over, in and under paint of σs 2 to 500; measured 1.1e-6."""
    if side == "reflectance" and place < 2:
        etas, bottomless = (1.4, 1.5, 1.5), True
    else:
        etas, bottomless = (1.5, 1.5, 1.4), False
    cases = torch.cartesian_prod(
        torch.tensor([0.0, 1e-4, 1e-3]), torch.tensor([0.0, 0.3]), torch.tensor([2.0, 500.0])
    )
    film, thickness, paint = cases.double().t()
    sigma_a = torch.full((len(cases), 3), 0.001, dtype=torch.float64)
    sigma_s, d = paint[:, None].repeat(1, 3), torch.ones_like(sigma_a)
    sigma_a[:, place], sigma_s[:, place], d[:, place] = film, 0, thickness
    if bottomless:
        d[:, 2] = torch.inf
    fields = [x[..., None] for x in (sigma_a, sigma_s, torch.zeros_like(d), d)]
    exact = LayerTable(*fields, etas, bottomless, known_isotropic=True)
    options = {"side": side, "model": "layered-sp3", "scattering": "total", "incidence": "diffuse"}
    single = exact.of([x.float() for x in fields])
    true = flat_profile(exact, S.double(), **options)
    torch.testing.assert_close(looped(single, **options).double(), true, rtol=0, atol=5e-6)
    torch.testing.assert_close(flat_profile(single, S, **options).double(), true, rtol=0, atol=5e-6)


def test_weights_are_the_same_by_the_loop(monkeypatch):
    """Also of grey layers shown in colour, and of tables that lie otherwise in memory; measured 3e-6."""
    monkeypatch.setattr(weights, "WORTH_COMPILING", 1)
    thickness = torch.linspace(0.0, 2.0, 50)[None]
    stack = Stack([Layer(preset("skin1"), thickness), Layer(preset("skin2"))])
    grey = Stack([Layer(replace(preset("skin1"), **_first("skin1")), thickness), Layer(preset("skin2"))])
    ladder = variance_ladder(0.4, 400.0, 8)
    for model in ("layered-diffusion", "layered-sp3"):
        for material in (stack, grey):
            eager, loop = (
                weights_for(material, ladder, model=model, compiled=x, levels=None) for x in (False, True)
            )
            torch.testing.assert_close(loop.at(), eager.at(), rtol=0, atol=2e-5)


def _first(name: str) -> dict[str, torch.Tensor]:
    medium = preset(name)
    return {"sigma_a": medium.sigma_a[:1], "sigma_s": medium.sigma_s[:1]}


def test_what_the_loop_does_not_know_is_done_by_torch(monkeypatch):
    """float64, other models, and what wants a gradient."""
    monkeypatch.setattr(weights, "WORTH_COMPILING", 1)
    ladder, table = variance_ladder(0.4, 400.0, 4), Stack(preset("skin1")).table()
    options = {"scattering": "total", "incidence": "diffuse", "side": "reflectance"}
    rows = table.of([x[None] for x in table.fields])
    assert not Fused(rows.to(torch.float64), S, torch.eye(len(S)), model="layered-sp3", **options).ready
    assert not Fused(rows.to(torch.float32), S, torch.eye(len(S)), model="multipole", **options).ready
    assert weights_for(table, ladder, compiled=True, dtype=torch.float64).table.dtype == torch.float64
    sigma_a = preset("skin1").sigma_a.clone().requires_grad_()
    medium = replace(preset("skin1"), sigma_a=sigma_a)
    weights_for(medium, ladder, compiled=True).total.sum().backward()
    assert bool((sigma_a.grad < 0).all())


@pytest.mark.parametrize("bottomless", [True, False])
def test_a_recorded_model_does_what_the_model_does(bottomless):
    """Loops of numba are made of such; g of -.8 to .9, equal to rounding."""
    table = random_table(ROWS, 2, bottomless, 1.4, seed=4).to(torch.float32)
    forward = replace(
        table, g=torch.rand(table.g.shape, generator=torch.Generator().manual_seed(1)) * 1.7 - 0.8
    )
    for rows, model, scattering in (
        (table, "layered-diffusion", "total"),
        (table if bottomless else forward, "layered-sp3", "total"),
        (forward, "layered-sp3", "unmarched" if bottomless else "single"),
    ):
        asked = {"side": SIDES[not bottomless], "model": model, "scattering": scattering, "incidence": 0.5}
        repeated = flat_profile(rows, S, **asked, loops=Replays())
        torch.testing.assert_close(repeated, flat_profile(rows, S, **asked), rtol=1e-5, atol=1e-6)


class Replays(Loops):
    """Repeats what is recorded by torch, where nothing need be built."""

    def solved(self, given, s, solver):
        recording, inputs = recorded(given, s, solver)
        known = dict(zip(recording.inputs, inputs, strict=True))
        for name, reads, options, _, value in recording.operations:
            read = [known[x] if isinstance(x, Value) else x for x in reads]
            known[value] = getattr(torch, name)(*read, **dict(options))
        return known[recording.result]


def test_a_loop_that_gets_no_memory_says_what_to_do():
    """More frequencies than there can be; denormal numbers are what they were."""
    table = random_table(ROWS, 1, True, 1.0, seed=3).to(torch.float32)
    loop = Fused(
        table,
        S,
        torch.eye(len(S)),
        model="layered-sp3",
        scattering="total",
        incidence="diffuse",
        side=SIDES[0],
    )
    loop._header[len(loop._header) - 1] = -1
    tiny = torch.full((1,), 1e-39)
    with pytest.raises(DomainError, match=r"Profiles: expected memory.*smaller atlas"):
        loop(slice(0, ROWS), torch.empty(ROWS, len(S), table.channels))
    assert float(tiny * 1) > 0
