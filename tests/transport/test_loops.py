"""The compiled loops are what torch does."""

import pytest
import torch
from squares import ball, lit

from texsss.errors import DomainError
from texsss.numerics import native
from texsss.numerics.sparse import starts
from texsss.transport import loops
from texsss.transport.kernels import STRIP
from texsss.transport.operators import Operators, surface_operators
from texsss.transport.runs import runs
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


def test_making_them_is_what_torch_makes(made, monkeypatch):
    monkeypatch.setattr(loops, "library", lambda source, macros: None)
    plain = surface_operators(ball(64), LADDER)
    assert len(made.steps) == len(plain.steps) == 3
    for ours, theirs in zip(made.steps, plain.steps, strict=True):
        assert len(ours.distance) == len(theirs.distance) and len(ours.column) == len(theirs.column)
        torch.testing.assert_close(ours.share, theirs.share, rtol=1e-4, atol=0)  # of whole weights
        assert len(ours.weight) * STRIP < 2.5 * int((ours.weight != 0).sum())
    for ours, theirs in zip(made.levels, plain.levels, strict=True):
        for one, other in zip(ours.blurs, theirs.blurs, strict=True):
            for a, b in zip(one.along, other.along, strict=True):
                assert torch.equal(a.first, b.first) and torch.equal(a.mask, b.mask)


def test_runs_of_many_taps_and_of_none():
    """Nodes on a line, some missing, against the dense sum."""
    generator = torch.Generator().manual_seed(0)
    source = torch.randperm(400, generator=generator)[:150].sort()[0] + 1000
    target = torch.arange(990, 1500)
    taps, x = torch.rand(29, generator=generator), torch.rand(150, 3, generator=generator)
    away = source - target[:, None] + 14
    dense = torch.where((away >= 0) & (away < 29), taps[away.clamp(0, 28)], 0) @ x
    torch.testing.assert_close(runs(source, target, taps).times(x), dense)


def test_more_entries_than_indices_count_are_refused():
    with pytest.raises(DomainError, match="smaller atlas"):
        starts(torch.tensor([2**31 - 1, 1]))
    assert starts(torch.tensor([2**31 - 1])).tolist() == [0, 2**31 - 1]
