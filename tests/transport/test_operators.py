import math

import pytest
import torch
from squares import ball, gaussian, lit, square

from texsss.errors import Cancelled, DomainError
from texsss.surface.mesh import Mesh
from texsss.surface.points import TexelMaps
from texsss.surface.raster import rasterise
from texsss.transport.bank import build_bank, diffusion
from texsss.transport.budget import affordable
from texsss.transport.gutter import gutter_means
from texsss.transport.lattice import blur, kernel, lattice
from texsss.transport.neighbours import pairs_within
from texsss.transport.operators import surface_operators
from texsss.transport.stencil import VARIANCE
from texsss.transport.uv import diffuse_uv

LADDER = torch.tensor([0.0, 40.0, 160.0, 1000.0])  # mm²


@pytest.mark.parametrize("other", [False, True])
def test_neighbours_are_those_of_all_pairs(other: bool):
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(400, 3, generator=generator)
    targets = torch.rand(300, 3, generator=generator) * 1.4 - 0.2 if other else points
    found = torch.zeros(len(targets), len(points), dtype=torch.int64)
    for pairs in pairs_within(targets, points, 0.17):
        found[pairs.row + pairs.block.start, pairs.column] += 1
        assert torch.equal(pairs.count, torch.bincount(pairs.row, minlength=len(pairs.count)))
    assert torch.equal(found, (torch.cdist(targets, points) < 0.17).long())


@pytest.mark.parametrize(
    ("corners", "spots"),
    [
        ([[0, 0], [0.7, 0], [1.0, 0.8], [0.3, 0.8]], [(97.0, 103.0), (90.0, 96.5)]),
        ([[0, 0.3], [0.65, 0], [1.0, 0.7], [0.35, 1.0]], [(97.0, 103.0), (104.0, 91.0)]),
    ],
)
def test_a_lit_texel_spreads_to_the_gaussians_in_mm_whatever_the_shear(corners, spots):
    """Each, and Σ_k w_k G(v_k, r): what `uv` does on a square without shear, to the same 1 %."""
    texels = square(256, 200.0, uv=torch.tensor(corners))
    position = texels.points.position(texels.mesh)
    lit_ones = [int((position - position.new_tensor([*spot, 0])).norm(dim=1).argmin()) for spot in spots]
    light = torch.zeros(len(texels), len(spots))
    for column, spot in enumerate(lit_ones):
        light[spot, column] = 1 / texels.area[spot]
    variances = torch.tensor([8.0, 30.0, 110.0, 400.0])  # 2.7 texels of 1.04 mm and up
    weights = torch.tensor([0.1, 0.4, 0.3, 0.2])
    blurred = surface_operators(texels, variances).applied(light)
    for column, spot in enumerate(lit_ones):
        squared = (position - position[spot]).square().sum(-1)
        exact = torch.stack([gaussian(float(variance), squared) for variance in variances])
        # measured up to .76 %
        assert bool(((blurred[..., column] - exact).norm(dim=1) < 0.01 * exact.norm(dim=1)).all())
        found, expected = weights @ blurred[..., column], weights @ exact
        # measured up to .45 %, and .9 % of the peak
        assert (found - expected).norm() < 0.01 * expected.norm()
        assert (found - expected).abs().max() < 0.01 * expected.max()


def test_constants_stay_and_energy_nearly_does():
    texels = ball(128)
    operators = surface_operators(texels, LADDER)
    values, area = lit(texels), texels.area[:, None]
    constant = operators.applied(torch.full_like(values, 0.7))
    torch.testing.assert_close(constant, torch.full_like(constant, 0.7), rtol=1e-5, atol=0)
    after, before = (operators.applied(values) * area).sum(1), (values * area).sum(0)
    torch.testing.assert_close(after, before.expand_as(after), rtol=2e-3, atol=0)  # measured 5e-4


def test_light_crosses_seams_as_on_the_whole_surface():
    """Against the all-pairs sum Σ G E A / Σ G A in double precision, at every seam of six charts."""
    texels = ball(96)
    values = lit(texels)[:, :1]
    ladder = torch.tensor([40.0, 80.0, 250.0, 600.0])  # 1.1, 1.5 and 2.7 texels and up, over lattices
    blurred = surface_operators(texels, ladder).applied(values)[..., 0].double()
    position = texels.points.position(texels.mesh).double()
    area = texels.area.double()
    sample = torch.arange(0, len(texels), 7)
    squared = torch.cdist(position[sample], position).square()
    for k in range(len(ladder)):
        weight = torch.exp(squared / (-2 * float(ladder[k]))) * area
        # measured .13 %, .13 %, .23 % and .43 %
        expected = (weight @ values.double())[:, 0] / weight.sum(1)
        error = (blurred[k][sample] - expected).norm() / expected.norm()

        assert error < 0.005, f"variance {float(ladder[k])}: {float(error):.2%}"


@pytest.mark.parametrize("variance", [20.0, 300.0])
def test_lattices_make_the_gaussian_of_all_pairs(variance: float):
    """Σ G between points in space, unnormalised, against the dense sum in double precision."""
    generator = torch.Generator().manual_seed(0)
    place = torch.nn.functional.normalize(torch.randn(900, 3, generator=generator), dim=1) * 40
    held = torch.rand(900, 1, generator=generator)
    nodes = lattice(place, math.sqrt(variance) / 2)
    around = blur(nodes, variance - 2 * VARIANCE * nodes.edge**2)
    found = nodes.ways.up(around.times(nodes.ways.down([held])))
    kernel = torch.exp(torch.cdist(place.double(), place.double()).square() / (-2 * variance))
    expected = kernel @ held.double() * nodes.edge**3 / (2 * math.pi * variance) ** 1.5
    # measured 1.3 % and .6 %; means, where light is divided by area, are closer by far
    assert (found - expected).norm() < 0.02 * expected.norm()


def test_kernels_have_their_variance_and_blurs_are_their_own_transpose():
    for variance in (0.3, 1.0, 7.0):
        taps = kernel(variance)
        steps = torch.arange(len(taps)) - len(taps) // 2
        torch.testing.assert_close((taps * steps**2).sum(), torch.tensor(variance).double())
        torch.testing.assert_close(taps.sum(), torch.ones((), dtype=torch.float64))
    nodes = lattice(torch.rand(200, 3, generator=torch.Generator().manual_seed(0)) * 50, 3.0)
    dense = blur(nodes, 20.0).times(torch.eye(len(nodes)))
    torch.testing.assert_close(dense, dense.T, rtol=0, atol=1e-7)


def test_gradients_are_the_adjoint():
    """⟨B v, w⟩ = ⟨v, Bᵀ w⟩."""
    texels = ball(48)
    operators = surface_operators(texels, LADDER)
    generator = torch.Generator().manual_seed(0)
    v = torch.rand(len(texels), 1, generator=generator).requires_grad_()
    w = torch.rand(len(LADDER), len(texels), 1, generator=generator)
    (operators.applied(v) * w).sum().backward()
    assert operators.steps and operators.levels
    u = torch.rand(len(texels), 1, generator=generator)
    assert v.grad is not None
    torch.testing.assert_close((operators.applied(u) * w).sum(), (u * v.grad).sum(), rtol=1e-4, atol=0)


def test_the_gutter_has_what_the_surface_has_there():
    """Linear functions of the place, on a ball in many charts: where light ends at no edge."""
    texels = ball(48)
    place = texels.points.position(texels.mesh)
    covered = texels.covered_count
    means = gutter_means(place, texels.points.normal(texels.mesh), covered)
    found, there = means.times(place[:covered]), place[covered:]
    assert len(there) > 300
    away = torch.linalg.vector_norm(found - there, dim=1) / texels.texel_mm
    assert float(away.median()) < 0.2 and float(away.quantile(0.95)) < 0.4  # it runs straight, off the ball
    torch.testing.assert_close(means.times(torch.ones(covered, 1)), torch.ones(len(there), 1))
    assert float(means.value.min()) > -0.25  # steep light does not swing over


@pytest.mark.parametrize("thickness", [1.0, 2.0])
def test_the_gutter_of_a_thin_plate_stays_on_its_side(thickness: float):
    """Light on the front alone, as narrow as nothing: the front's gutter has it, the back's hasn't."""
    size = 32
    texel = 100 / (0.4 * size)  # of two squares side by side in uv
    depth = thickness * texel
    corners = torch.tensor([[0.0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0]])
    vertices = torch.cat([corners, corners - torch.tensor([0, 0, depth])])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]])
    square = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]]) * 0.4 + 0.05
    uv = torch.cat([square, square + torch.tensor([0.5, 0.0])])[faces]
    texels = rasterise(Mesh(vertices, faces), uv, (size, size))
    front = (texels.points.face < 2)[:, None].float()
    spread = surface_operators(texels, torch.tensor([(0.2 * texel) ** 2])).applied(front)[0]
    gutter = ~texels.covered
    assert int(gutter.sum()) > 50
    torch.testing.assert_close(spread[gutter], front[gutter], rtol=0, atol=0.05)


@pytest.mark.parametrize("chosen", [*([k] for k in range(len(LADDER))), [2, 1], []])
def test_some_of_them_need_no_others(chosen: list[int]):
    """One at a time is what the rules of entry ask for; they are not to pay for all of them."""
    texels = ball(48)
    every = surface_operators(texels, LADDER)
    some = every.only(chosen)
    values = lit(texels).requires_grad_()
    made = some.applied(values)
    torch.testing.assert_close(made, every.applied(values.detach())[chosen])
    back = torch.autograd.grad(made.square().sum(), values)[0] if chosen else torch.zeros(())
    also = torch.autograd.grad(every.applied(values)[chosen].square().sum(), values)[0]
    torch.testing.assert_close(back.expand_as(also), also, rtol=1e-4, atol=1e-6)
    assert some.count < every.count or chosen == [len(LADDER) - 1]
    assert every.levels and len(some.levels) <= len(every.levels)


def test_steps_know_their_transpose():
    texels = ball(32)
    operators = surface_operators(texels, torch.tensor([20.0, 100.0, 500.0]))
    x, y = torch.rand(2, texels.covered_count, 2, generator=torch.Generator().manual_seed(0)).unbind(0)
    assert len(operators.steps) == 3
    for step in operators.steps:
        back = torch.zeros_like(y)
        step.back(y, back)
        torch.testing.assert_close((step.times(x) * y).sum(), (x * back).sum(), rtol=1e-4, atol=0)


def test_the_bank_takes_them_in_any_order():
    texels = ball(32)
    values, ladder = lit(texels), LADDER.flip(0)
    operators = surface_operators(texels, ladder)
    bank = build_bank(values, texels, ladder, method="surface", operators=operators)
    assert torch.equal(bank.values[-1], values)
    torch.testing.assert_close(bank.values.flip(0), diffusion(texels, "surface")(values, LADDER))


def test_white_light_is_spread_once():
    texels = ball(32)
    values, operators = lit(texels)[:, 1:2].expand(-1, 3), surface_operators(texels, LADDER)
    white = diffusion(texels, "surface", operators=operators)(values, LADDER)
    assert white.stride(2) == 0
    torch.testing.assert_close(white, operators.applied(values.contiguous()))


def test_what_does_not_fit_goes_along_uv_with_a_notice():
    texels, notices = ball(48), []
    values = lit(texels)
    kept = diffusion(texels, "surface", budget_bytes=300 * len(texels), notice=notices.append)(values, LADDER)
    assert len(notices) == 1 and "stop at seams" in notices[0]
    # 1000 mm² fits
    torch.testing.assert_close(kept[3], surface_operators(texels, LADDER[3:]).applied(values)[0])
    assert torch.equal(kept[1:3], diffuse_uv(values, texels, LADDER[1:3]))
    all_of_them = surface_operators(texels, LADDER).bytes
    assert not affordable(texels, LADDER, all_of_them).all(), "making takes room, too"
    assert affordable(texels, LADDER, 5 * all_of_them).all()
    nothing = diffusion(texels, "surface", budget_bytes=0)(values, LADDER[1:])
    assert torch.equal(nothing, diffuse_uv(values, texels, LADDER[1:]))


def test_sheets_that_lie_together_are_foretold():
    """16 of them, .05 mm apart: each texel has sixteen times the neighbours of one alone."""

    def leaves(apart: float) -> TexelMaps:
        corner = torch.tensor([[0.0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0]])
        half = torch.tensor([[0, 1, 2], [0, 2, 3]])
        places = [corner + torch.tensor([0, 0, apart * k]) for k in range(16)]
        uv = [(corner[half][..., :2] / 125 + 0.1 + torch.tensor([k % 4, k // 4])) / 4 for k in range(16)]
        faces = torch.cat([half + 4 * k for k in range(16)])
        return rasterise(Mesh(torch.cat(places), faces), torch.cat(uv), (64, 64))

    alone, together = leaves(1000.0), leaves(0.05)
    variances = torch.tensor([(1.4 * alone.texel_mm) ** 2])
    enough = 8 * surface_operators(alone, variances).bytes  # what making takes included
    assert affordable(alone, variances, enough).all()
    assert not affordable(together, variances, enough).any()
    assert not affordable(together, variances, surface_operators(together, variances).bytes).any()


def doubtful(name: str) -> TexelMaps:
    """Surfaces that no author would want, each in the atlas of `square`'s two faces, or of random ones."""
    generator = torch.Generator().manual_seed(0)
    corners = torch.rand(24, 3, generator=generator) * 30
    faces = torch.randint(24, (40, 3), generator=generator)  # edges of many faces, some faces flat
    uv = torch.rand(40, 3, 2, generator=generator)  # all over each other
    if name == "isolated charts":
        uv = uv * 0.02 + torch.rand(40, 1, 2, generator=generator) * 0.9
    if name == "uneven texels":
        uv = uv * torch.logspace(-3, 0, 40)[:, None, None]
    if name == "no padding":
        uv = (uv + torch.cartesian_prod(torch.arange(7), torch.arange(7))[:40, None]) / 7
    scale = {"tiny": 1e-4, "huge": 1e4}.get(name, 1.0)
    return rasterise(Mesh(corners * scale, faces), uv, (48, 48))


@pytest.mark.parametrize("name", ["tangle", "isolated charts", "uneven texels", "no padding", "tiny", "huge"])
def test_doubtful_surfaces_stay_finite_and_constant(name: str):
    texels = doubtful(name)
    operators = surface_operators(texels, LADDER)
    values = torch.rand(len(texels), 3, generator=torch.Generator().manual_seed(1)).requires_grad_()
    copies = operators.applied(values)
    copies.sum().backward()
    assert values.grad is not None and torch.isfinite(values.grad).all()
    assert copies.min() > -0.2 and copies.max() < 1.2
    constant = operators.applied(torch.ones(len(texels), 1))
    torch.testing.assert_close(constant, torch.ones_like(constant), rtol=1e-4, atol=0)


def test_kernels_far_below_and_above_the_texels_stay_finite():
    texels = ball(24)
    ladder = torch.tensor([1e-8, 1e-3, 1e5])
    assert torch.isfinite(surface_operators(texels, ladder).applied(lit(texels))).all()


def test_bad_variances_and_cancelling_are_said():
    texels = ball(16)
    with pytest.raises(DomainError, match="variances of 0 or more"):
        surface_operators(texels, torch.tensor([float("nan")]))
    thin = Mesh(torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), torch.tensor([[0, 1, 2]]))
    between = rasterise(thin, torch.tensor([[[0.01, 0.01], [0.02, 0.01], [0.01, 0.02]]]), (8, 8))
    with pytest.raises(DomainError, match="larger atlas"):
        surface_operators(between, torch.tensor([1.0]))
    with pytest.raises(Cancelled):
        surface_operators(texels, LADDER, cancel=lambda: True)
