"""What passes through an object: slabs of the same matter, laws of energy, straight distances."""

import math

import pytest
import torch

from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.gaussians import GaussianSum
from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.project import variance_ladder
from texsss.profiles.through import mirrored, straight, weights_through

LADDER = variance_ladder(0.35, 300.0)
ZERO = torch.zeros(1)


@pytest.mark.parametrize("thickness", [0.5, 2.0, 8.0])
def test_an_endless_medium_becomes_a_slab(thickness: float):
    back, passed = weights_through(Stack(preset("skin1")), LADDER, torch.full((5,), thickness))
    R, T = hankel_profiles(Stack([Layer(preset("skin1"), thickness)]), ZERO)
    # thickness is rounded to .5 %
    torch.testing.assert_close(back.total[0], R[0], rtol=0, atol=1e-3)
    torch.testing.assert_close(passed.total[0], T[0], rtol=0, atol=1e-3)


def test_what_comes_back_and_passes_is_no_more_than_entered():
    thickness = torch.logspace(-2, 3, 60)
    for name in ("skin1", "marble", "spectralon"):
        back, passed = weights_through(Stack(preset(name)), LADDER, thickness)
        both = back.total + passed.total
        assert float(both.max()) <= 1.005, name
        assert bool((passed.total.diff(dim=0)[30:] <= 1e-4).all()), "thicker lets less through"
    R, _ = hankel_profiles(Stack(preset("skin1")), ZERO)
    torch.testing.assert_close(
        weights_through(Stack(preset("skin1")), LADDER, torch.tensor([500.0]))[0].total, R, rtol=1e-3, atol=0
    )


def test_without_a_far_side_nothing_passes():
    back, passed = weights_through(Stack(preset("marble")), LADDER, torch.tensor([torch.inf, 3.0]))
    assert float(passed.total[0].abs().max()) < 1e-6 < float(passed.total[1].min())
    R, _ = hankel_profiles(Stack(preset("marble")), ZERO)
    torch.testing.assert_close(back.total[:1], R, rtol=1e-3, atol=0)


@pytest.mark.parametrize(
    "layers", [[Layer(preset("skin1"))], [Layer(preset("skin1"), 0.5), Layer(preset("skin2"))]]
)
def test_parts_without_a_far_side_leave_the_rest_as_it_is(layers):
    """Thicknesses that differ by half a percent stay apart, however thick another part is."""
    stack, thickness = Stack(layers), torch.logspace(0, 1, 20_000)
    _, alone = weights_through(stack, LADDER, thickness)
    _, beside = weights_through(stack, LADDER, torch.cat([thickness, torch.full((9,), torch.inf)]))
    torch.testing.assert_close(beside.total[: len(thickness)], alone.total, rtol=0, atol=1e-5)
    assert float(beside.total[:-9].diff(dim=0).abs().max()) < 0.004  # 2.1e-3 measured


def test_layers_come_again_on_the_far_side():
    stack = Stack([Layer(preset("skin1"), 0.5), Layer(preset("skin2"))])
    table = mirrored(stack.table().to(torch.float32), torch.tensor([5.0, 0.6]))
    torch.testing.assert_close(
        table.thickness[..., 0], torch.tensor([[0.5, 4.0, 0.5], [0.3, 0.0, 0.3]]), rtol=1e-5, atol=1e-6
    )
    assert torch.equal(table.sigma_a[:, 0], table.sigma_a[:, 2]) and not table.bottomless


def test_a_finite_stack_keeps_its_thickness_and_loses_sight_of_what_is_far():
    stack = Stack([Layer(preset("skin1"), 0.4)])
    _, T = hankel_profiles(stack, ZERO)
    _, passed = weights_through(stack, LADDER, torch.tensor([0.01, 0.4, 0.8, 1.2, 1.6, 90.0, torch.inf]))
    share = torch.tensor([1.0, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0])
    torch.testing.assert_close(passed.total, share[:, None] * T, rtol=0.01, atol=1e-6)


def test_maps_and_thickness_vary_together():
    depth = torch.linspace(0.1, 1.0, 64).reshape(8, 8)
    stack = Stack([Layer(preset("skin1"), depth), Layer(preset("skin2"))])
    uv = torch.rand(200, 2, generator=torch.Generator().manual_seed(0))
    thickness = 2 + 6 * torch.rand(200, generator=torch.Generator().manual_seed(1))
    back, passed = weights_through(stack, LADDER, thickness, points_uv=uv)
    table = mirrored(stack.at(uv[:5]), thickness[:5])
    R, T = hankel_profiles(table, ZERO)
    # thickness is rounded to 3 %
    torch.testing.assert_close(back.total[:5], R[:, 0], rtol=0.01, atol=1e-3)
    torch.testing.assert_close(passed.total[:5], T[:, 0], rtol=0.06, atol=1e-3)


@pytest.mark.parametrize("thickness", [1.0, 3.0, 8.0])
def test_straight_distances_give_the_same_light(thickness: float):
    """∫ T'(√(ρ² + d²)) dA = T̂(0), in a shape not far off; nothing is negative."""
    away = torch.full((1,), thickness)
    _, passed = weights_through(Stack(preset("skin1")), LADDER, away)
    fitted = straight(passed, away)
    r = torch.linspace(0, 80, 8001, dtype=torch.float64)
    along = GaussianSum(LADDER, passed.table[0].double()).evaluate(r)
    through = GaussianSum(LADDER, fitted.table[0].double()).evaluate(torch.hypot(r, away.double()))
    total = torch.trapezoid(2 * math.pi * r[:, None] * through, r, dim=0)
    # a Gaussian of variance 0 is left out of `evaluate`
    torch.testing.assert_close(total.float(), passed.total[0], rtol=0.01, atol=1e-4)
    wrong = (r[:, None] * (along - through) ** 2).sum(0).sqrt() / (r[:, None] * along**2).sum(0).sqrt()
    # as wide as the ladder has them; measured .36 to .70
    assert float(wrong[0]) < 0.9
    assert bool((fitted.table >= 0).all())


@pytest.mark.parametrize("thickness", [0.1, 0.3, 1.0, 3.0])
def test_what_is_finer_than_samples_is_left_to_what_is_not(thickness: float):
    away = torch.full((1,), thickness)
    _, passed = weights_through(Stack(preset("skin1")), LADDER, away)
    fitted = straight(passed, away, 1.5)
    wide = LADDER.sqrt() >= 1.5
    assert float(fitted.table[:, ~wide].abs().max()) == 0.0
    falls = torch.exp(-(thickness**2) / (2 * LADDER[wide]))[:, None]
    total = (fitted.table[0, wide] * falls).sum(0)
    torch.testing.assert_close(total, passed.total[0].to(total), rtol=1e-4, atol=1e-6)


def test_beyond_all_gaussians_nothing_passes():
    away = torch.full((1,), 500.0)
    _, passed = weights_through(Stack(preset("skin1")), LADDER, away)
    assert float(straight(passed, away).table.abs().max()) < 1e-6


def test_what_the_far_sides_layers_scatter_once_is_not_lost():
    """The march sees the layers of its own side to the end of the object; diffusion holds all the rest."""
    skin, flesh = Medium([0.03, 0.2, 0.5], [2.0, 3.0, 4.0], 0.0, 1.0), Medium(0.02, 0.5, 0.0, 1.0)
    stack, thickness = Stack([Layer(skin, 0.3), Layer(flesh)]), torch.tensor([0.2, 0.5, 1.0, 3.0])
    total, rest = (
        weights_through(stack, LADDER, thickness, scattering=scattering)[0].total
        for scattering in ("total", "unmarched")
    )
    zero = torch.zeros(1, dtype=torch.float64)
    for row, d in enumerate(thickness.tolist()):
        own = [Layer(skin, min(d, 0.3)), *([Layer(flesh, d - 0.3)] if d > 0.3 else [])]
        once = hankel_profiles(Stack(own), zero, scattering="single")[0].reshape(-1).float()
        # thicknesses are rounded by half a step of .5 %: measured 1.5e-3
        torch.testing.assert_close(total[row] - rest[row], once, rtol=4e-3, atol=0)
        mirrored_once = hankel_profiles(
            Stack(
                [Layer(skin, min(d / 2, 0.3)), Layer(flesh, max(d - 0.6, 0)), Layer(skin, min(d / 2, 0.3))]
            ),
            zero,
            scattering="single",
        )[0].reshape(-1)
        assert d > 1 or d < 0.3 or float((mirrored_once / once - 1).max()) > 0.01  # what would be lost
