"""The compiled loops are what torch does."""

import pytest
import torch
from squares import ball, lit

from texsss.errors import DomainError
from texsss.numerics import native
from texsss.numerics.sparse import starts
from texsss.transport import loops, smoothing
from texsss.transport.bricks import blur_of
from texsss.transport.kernels import STRIP
from texsss.transport.lattice import lattice
from texsss.transport.operators import Operators, surface_operators
from texsss.types import Float, Tensor

pytestmark = pytest.mark.skipif(native._compiler() is None, reason="no C++ compiler: nothing is compiled")

LADDER = torch.tensor([0.0, 20.0, 60.0, 160.0, 600.0])  # mm²


@pytest.fixture(scope="module")
def made() -> Operators:
    return surface_operators(ball(64), LADDER)


def both(operators: Operators, values: Float[Tensor, "P C"], monkeypatch) -> list[tuple[Tensor, Tensor]]:
    """Copies and gradients, by the loops and by torch."""
    results = []
    for source in (loops.PRODUCTS, None):
        if source is None:
            monkeypatch.setattr(loops, "library", lambda source, macros: None)
        assert (loops.products(values) is None) == (source is None)
        asking = values.clone().requires_grad_()
        copies = operators.applied(asking)
        (copies * torch.linspace(0, 1, copies.numel()).reshape(copies.shape)).sum().backward()
        assert asking.grad is not None
        results.append((copies.detach(), asking.grad))
    return results


@pytest.mark.parametrize("channels", [1, 2, 3, 5])
def test_products_are_those_of_torch(made, channels, monkeypatch):
    values = torch.rand(len(lit(ball(64))), channels, generator=torch.Generator().manual_seed(0))
    loop, plain = both(made, values, monkeypatch)
    torch.testing.assert_close(loop[0], plain[0], rtol=2e-6, atol=0)
    torch.testing.assert_close(loop[1], plain[1], rtol=1e-5, atol=1e-6)


def test_any_number_of_threads_gives_the_same_bytes(made):
    values, threads = lit(ball(64)).requires_grad_(), torch.get_num_threads()
    results = []
    try:
        for count in (1, 3, 20):
            torch.set_num_threads(count)
            copies = made.applied(values)
            results.append((copies, *torch.autograd.grad(copies.square().sum(), values)))
    finally:
        torch.set_num_threads(threads)
    for copies, gradient in results[1:]:
        assert torch.equal(copies, results[0][0]) and torch.equal(gradient, results[0][1])


@pytest.mark.parametrize("channels", [1, 3])
def test_gradients_need_not_lie_in_memory_as_the_copies_do(made, channels):
    values = lit(ball(64))[:, :channels].clone().requires_grad_()
    copies = made.applied(values)
    one = torch.rand(len(copies), 1, channels, generator=torch.Generator().manual_seed(0))
    wide = one.expand(copies.shape)  # one number for all texels
    across = wide.transpose(1, 2).contiguous().transpose(1, 2)
    expected = torch.autograd.grad(copies, values, wide.contiguous(), retain_graph=True)[0]
    for grad in (wide, across):
        made_of = torch.autograd.grad(copies, values, grad, retain_graph=True)[0]
        torch.testing.assert_close(made_of, expected, rtol=2e-6, atol=1e-6)


def test_kernels_are_made_some_rows_at_a_time(made, monkeypatch):
    """Where all pairs would take too much memory: the same bytes."""
    monkeypatch.setattr(smoothing, "PAIRS", 20_000)
    parts = surface_operators(ball(64), LADDER)
    for step, other in zip(made.steps, parts.steps, strict=True):
        assert step.weight.numel() > 20_000
        assert torch.equal(step.start, other.start) and torch.equal(step.distance, other.distance)
        assert torch.equal(step.weight, other.weight) and torch.equal(step.share, other.share)


def test_making_them_is_what_torch_makes(made, monkeypatch):
    monkeypatch.setattr(loops, "library", lambda source, macros: None)
    plain = surface_operators(ball(64), LADDER)
    assert len(made.steps) == len(plain.steps) == 3
    for ours, theirs in zip(made.steps, plain.steps, strict=True):
        assert len(ours.distance) == len(theirs.distance)
        torch.testing.assert_close(ours.share, theirs.share, rtol=1e-4, atol=0)  # of whole weights
        # measured 3.1 on this small ball, where seams are many
        assert len(ours.weight) * STRIP < 3.5 * int((ours.weight != 0).sum())
    for ours, theirs in zip(made.levels, plain.levels, strict=True):
        for one, other in zip(ours.blurs, theirs.blurs, strict=True):
            for a, b in zip(one.turns, other.turns, strict=True):
                assert torch.equal(a, b)


@pytest.mark.parametrize("reach", [2, 7, 14])
def test_bricks_are_the_dense_sum(reach: int):
    """Nodes around a ball, in bricks with gaps, against the sum in double precision."""
    generator = torch.Generator().manual_seed(0)
    points = torch.nn.functional.normalize(torch.randn(300, 3, generator=generator), dim=1) * 30
    nodes = lattice(points, 4.0)
    taps = torch.rand(2 * reach + 1, generator=generator)
    away = ((nodes.place - nodes.place[:, None]) / nodes.edge).round().long() + reach
    there = (away >= 0) & (away <= 2 * reach)
    dense = torch.where(there, taps.double()[away.clamp(0, 2 * reach)], 0).prod(2)
    columns = torch.rand(len(nodes), 9, generator=generator)
    x, out = columns[:, :5], torch.ones(len(nodes), 7)
    expected = (dense @ x.double()).float()
    blur_of(nodes.bricks, taps).times(x, out[:, 1:6], added=True)
    torch.testing.assert_close(out[:, 1:6], 1 + expected, rtol=2e-6, atol=0)
    assert bool((out[:, [0, 6]] == 1).all())


def test_a_loop_that_gets_no_memory_says_what_to_do():
    found, key = loops.making(torch.zeros(1)), torch.zeros(3, dtype=torch.int64)
    assert found is not None
    columns = 1 << 59  # ends of as many ranges
    with pytest.raises(DomainError, match="smaller atlas"):
        loops.call(found.pairs, 3, key, key, *[None] * 3, columns, None, 0, 1.0, 0, 3, *[None] * 5)


def test_more_entries_than_indices_count_are_refused():
    with pytest.raises(DomainError, match="smaller atlas"):
        starts(torch.tensor([2**31 - 1, 1]))
    assert starts(torch.tensor([2**31 - 1])).tolist() == [0, 2**31 - 1]
