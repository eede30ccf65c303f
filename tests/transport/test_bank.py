import pytest
import torch
from squares import square

from texsss.errors import DomainError, ShapeError
from texsss.profiles.weights import Weights
from texsss.transport.bank import Bank, build_bank, diffusion, exitance
from texsss.types import Float, Tensor

LADDER = torch.tensor([0.0, 2.0, 30.0])  # mm²


def material(points: int, rows: int) -> Weights:
    generator = torch.Generator().manual_seed(rows)
    table = torch.rand(rows, len(LADDER), 3, generator=generator)
    return Weights(LADDER, table, torch.randint(rows, (points,), generator=generator, dtype=torch.int32))


def halves() -> tuple[Bank, Float[Tensor, "P 3"], Weights]:
    """A square with light on one half and another material below the middle."""
    texels = square(64, 60.0)
    position = texels.points.position(texels.mesh)
    light = (position[:, :1] > 31).float().expand(-1, 3).contiguous()
    weights = Weights(
        LADDER,
        torch.tensor([[0.5, 0.2, 0.0], [0.1, 0.2, 0.6]])[..., None].expand(-1, -1, 3).contiguous(),
        (position[:, 1] > 30).int(),
    )
    return build_bank(light, texels, LADDER), light, weights


@pytest.mark.parametrize("rows", [1, 7])
def test_exitance_is_the_weighted_sum_of_the_copies(rows: int):
    values = torch.rand(len(LADDER), 40_000, 3, generator=torch.Generator().manual_seed(0))
    weights = material(40_000, rows)
    expected = torch.einsum("kpc,pkc->pc", values, weights.table[weights.row.long()])
    torch.testing.assert_close(exitance(Bank(LADDER, values[0], values), weights), expected)


def test_without_diffusion_the_surface_is_lambertian():
    texels = square(16, 10.0)
    light = torch.rand(len(texels), 3, generator=torch.Generator().manual_seed(0))
    weights = material(len(texels), 1)
    bank = build_bank(light, texels, LADDER, method="none")
    torch.testing.assert_close(exitance(bank, weights), light * weights.table[0].sum(0))


def test_rules_agree_where_the_material_is_uniform():
    texels = square(32, 60.0)
    position = texels.points.position(texels.mesh)
    light = (position / 9).sin().abs()
    bank, blur = build_bank(light, texels, LADDER), diffusion(texels)
    one = material(len(texels), 1)
    same = Weights(LADDER, one.table.repeat(2, 1, 1), torch.arange(len(texels), dtype=torch.int32) % 2)
    expected = exitance(bank, one)
    for rule in ("entry", "geometric-mean"):
        # measured 8e-4; the bank passes through narrower Gaussians, the rules do not
        torch.testing.assert_close(exitance(bank, same, rule, blur=blur), expected, rtol=0, atol=3e-3)


def test_the_entry_rule_is_the_transpose_of_the_exit_rule():
    """∫ M dA of one material's light, entering by `entry`, is what `exit` collects for a uniform light."""
    bank, light, weights = halves()
    texels = square(64, 60.0)
    by_entry = exitance(bank, weights, "entry", blur=diffusion(texels))
    collected = (light * weights.table.sum(1)[weights.row.long()]).sum(0)
    # every entered unit leaves with its own total; measured 1e-5
    torch.testing.assert_close(by_entry.sum(0), collected, rtol=1e-3, atol=0)


def test_the_geometric_mean_is_reciprocal():
    """⟨a, T b⟩ = ⟨b, T a⟩ over the surface."""
    _, light, weights = halves()
    texels = square(64, 60.0)
    other = light.flip(0).cumsum(0) / 1e3
    blur = diffusion(texels)

    def transported(x: Tensor) -> Tensor:
        return exitance(Bank(LADDER, x, x.expand(3, -1, -1)), weights, "geometric-mean", blur=blur)

    left, right = (other * transported(light)).sum(), (light * transported(other)).sum()
    torch.testing.assert_close(left, right, rtol=1e-3, atol=0)  # measured 2e-5


@pytest.mark.parametrize("method", ["uv", "surface"])
def test_weights_carry_gradients_under_every_rule(method: str):
    bank, _, weights = halves()
    for rule in ("exit", "entry", "geometric-mean"):
        table = weights.table.clone().requires_grad_()
        blur = diffusion(square(64, 60.0), method)
        exitance(bank, Weights(LADDER, table, weights.row), rule, blur=blur).sum().backward()
        assert table.grad is not None
        assert torch.isfinite(table.grad).all()
        assert (table.grad != 0).any()


def test_mistakes_are_said_in_one_sentence():
    bank, _, weights = halves()
    with pytest.raises(ShapeError, match="one ladder and one atlas"):
        exitance(bank, material(5, 1))
    with pytest.raises(DomainError, match="exit, entry, geometric-mean"):
        exitance(bank, weights, "middle")
    with pytest.raises(DomainError, match="pass diffusion"):
        exitance(bank, weights, "entry")
    with pytest.raises(DomainError, match="choose one"):
        diffusion(square(4, 1.0), "blur")
