import math

import pytest
import torch
from kornia.filters import gaussian_blur2d
from squares import ball, gaussian, lit, square

from texsss.errors import Cancelled, DomainError
from texsss.transport.spread import sharpness, spread
from texsss.transport.uv import diffuse_uv

LADDER = torch.tensor([0.0, 0.05, 0.5, 2.0, 8.0, 30.0, 110.0])  # mm²


@pytest.mark.parametrize("stretch", [1.0, 1 / 3])
def test_a_lit_texel_spreads_to_the_gaussians_in_mm(stretch: float):
    """Σ_k w_k G(v_k, r), whatever the square's shape in texture space."""
    corners = torch.tensor([[0, 0], [1, 0], [1, stretch], [0, stretch]])
    texels = square(256, 200.0, uv=corners)
    position = texels.points.position(texels.mesh)
    spot = int((position - position.new_tensor([97.0, 103.0, 0])).norm(dim=1).argmin())
    light = torch.zeros(len(texels), 1)
    light[spot] = 1 / texels.area[spot]
    variances = torch.tensor([8.0, 30.0, 110.0, 400.0])  # 1.2 texels of 2.3 mm and up
    weights = torch.tensor([0.1, 0.4, 0.3, 0.2])

    spread_out = (weights[:, None] * diffuse_uv(light, texels, variances)[..., 0]).sum(0)
    squared = (position - position[spot]).square().sum(-1)
    expected = (weights * gaussian(1.0, squared[:, None] / variances) / variances).sum(-1)
    # measured .25 % and .27 % of the peak
    assert (spread_out - expected).abs().max() < 0.01 * expected.max()
    # measured .17 % and .23 %
    assert (spread_out - expected).norm() < 0.01 * expected.norm()


@pytest.mark.parametrize("std", [1.0, 3.7, 13.9, 26.8])
def test_a_uniform_metric_gives_what_a_separable_blur_gives(std: float):
    """As `kornia.filters.gaussian_blur2d` of the same noise and stripes, to 1e-3 of full scale."""
    size = 384
    texels = square(size, float(size))  # texels of 1 mm
    image = torch.rand(size, size, 3, generator=torch.Generator().manual_seed(0))
    image[..., 1] = (torch.arange(size) // 37 % 2).float()
    ours = texels.to_image(diffuse_uv(texels.from_image(image), texels, torch.tensor([std**2]))[0])
    reach = 2 * round(4 * std) + 1
    theirs = gaussian_blur2d(image.permute(2, 0, 1)[None], (reach, reach), (std, std))[0].permute(1, 2, 0)
    inside = slice(round(4 * std), size - round(4 * std))  # nearer the edge the two mean other things
    assert float((ours - theirs)[inside, inside].abs().max()) < 1e-3


def test_a_zero_variance_is_the_identity_bit_for_bit():
    texels = ball(64)
    values = lit(texels)
    assert torch.equal(diffuse_uv(values, texels, LADDER)[0], values)


def test_constant_light_stays_constant_up_to_the_chart_edges_and_in_the_gutter():
    texels = ball(128)
    values = torch.full((len(texels), 3), 0.7)
    # measured 1.2e-7
    torch.testing.assert_close(
        diffuse_uv(values, texels, LADDER), values.expand(len(LADDER), -1, -1), rtol=1e-5, atol=0
    )


@pytest.mark.parametrize("size", [64, 256])
def test_diffusion_keeps_the_energy_of_a_closed_surface(size: int):
    texels = ball(size)
    values, area = lit(texels), texels.area[:, None]
    after, before = (diffuse_uv(values, texels, LADDER) * area).sum(1), (values * area).sum(0)
    # measured .06 %
    torch.testing.assert_close(after, before.expand_as(after), rtol=0.005, atol=0)


def test_every_pass_is_its_own_adjoint():
    """⟨S v, w⟩ = ⟨v, S w⟩ for the symmetric kernel between texels."""
    generator = torch.Generator().manual_seed(0)
    v, w = torch.rand(2, 2, 20, 30, generator=generator, dtype=torch.float64)
    beta = torch.rand(20, 30, generator=generator, dtype=torch.float64) + 0.05
    for axis in (0, 1):
        left = (spread(v, beta, 9, axis) * w).sum()
        torch.testing.assert_close(left, (v * spread(w, beta, 9, axis)).sum())


def test_gradients_are_those_of_finite_differences():
    texels = square(5, 4.0, uv=torch.tensor([[0, 0], [0.9, 0], [0.9, 0.6], [0, 0.6]]), dtype=torch.float64)
    values = torch.rand(len(texels), 1, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    ladder = torch.tensor([0.5], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: diffuse_uv(x, texels, ladder), values.requires_grad_())


def test_diffusion_is_linear_and_keeps_the_order_of_the_ladder():
    texels = ball(48)
    a, b = lit(texels), lit(texels).flip(1)
    together = diffuse_uv(2 * a - 3 * b, texels, LADDER.flip(0))
    apart = 2 * diffuse_uv(a, texels, LADDER) - 3 * diffuse_uv(b, texels, LADDER)
    torch.testing.assert_close(together, apart.flip(0), rtol=0, atol=1e-5)


@pytest.mark.parametrize("variance", [0.01, 0.2, 0.6, 3.0, 20.0])
def test_a_truncated_sampled_kernel_has_the_variance_asked_for(variance: float):
    reach = math.ceil(3.7 * math.sqrt(variance))
    beta = float(sharpness(torch.full((1, 1), variance, dtype=torch.float64), reach))
    steps = torch.arange(-reach, reach + 1, dtype=torch.float64)
    weight = torch.exp(-beta * steps**2)
    # linear interpolation in a table; measured 2e-6 but 6e-5 at .01
    assert float((weight * steps**2).sum() / weight.sum()) == pytest.approx(variance, rel=2e-4)


def test_odd_sizes_and_tiny_atlases_stay_finite():
    for size in (1, 2, 7, 33):
        texels = square(size, 50.0)
        values = torch.rand(len(texels), 3, generator=torch.Generator().manual_seed(size))
        blurred = diffuse_uv(values, texels, torch.tensor([1e-9, 1.0, 1e3, 1e8]))
        assert torch.isfinite(blurred).all()
        assert (blurred.amin(1) >= values.amin(0) - 1e-5).all()
        assert (blurred.amax(1) <= values.amax(0) + 1e-5).all()


def test_bad_variances_and_cancelling_are_said():
    texels = square(4, 1.0)
    values = torch.ones(len(texels), 3)
    with pytest.raises(DomainError, match="variances of 0 or more"):
        diffuse_uv(values, texels, torch.tensor([-1.0]))
    with pytest.raises(Cancelled):
        diffuse_uv(values, texels, torch.tensor([1.0]), cancel=lambda: True)
