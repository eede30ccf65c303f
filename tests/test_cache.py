"""Stage results are kept by content, bounded by bytes, and never when they carry gradients."""

from dataclasses import dataclass

import pytest
import torch

from texsss.cache import Kept, StageCache, content_key
from texsss.light.visibility import Occluder
from texsss.specs import AtlasSpec
from texsss.surface.mesh import Mesh


@dataclass(frozen=True)
class Pair:
    a: torch.Tensor
    b: torch.Tensor


def test_equal_content_has_equal_keys():
    def key(table: dict, value: int):
        plain = ("light", 1, 2.5, None, b"x", AtlasSpec(), (1, [2]))
        return content_key(*plain, table, torch.ones(3), Kept(value, "k"))

    assert key({"b": 1, "a": 2}, 3) == key({"a": 2, "b": 1}, 4)


@pytest.mark.parametrize(
    "a, b",
    [
        ((1,), (1.0,)),
        (("1",), (1,)),
        (("ab", "c"), ("a", "bc")),
        (((1, 2), 3), ((1,), 2, 3)),
        ((torch.ones(2, 3),), (torch.ones(3, 2),)),
        ((torch.zeros(2),), (torch.zeros(2, dtype=torch.int32),)),
        ((AtlasSpec(),), (AtlasSpec(size=512),)),
        ((None,), ("None",)),
    ],
)
def test_different_content_has_different_keys(a, b):
    assert content_key(*a) != content_key(*b)


def test_unknown_types_are_refused():
    with pytest.raises(TypeError, match="object"):
        content_key(object())


def test_result_is_made_once():
    cache, made = StageCache(1 << 20), []
    for _ in range(3):
        value, fresh = cache.get_or_make("k", lambda: made.append(1) or torch.ones(4))
    assert len(made) == 1 and not fresh and torch.equal(value, torch.ones(4))


def test_oldest_goes_first_when_full():
    cache = StageCache(max_bytes=100 * 4)
    for name in "abc":
        cache.get_or_make(name, lambda: Pair(torch.zeros(20), torch.zeros(20)))
    assert cache.bytes_used == 320
    assert cache.get_or_make("b", lambda: None)[1] is False
    assert cache.get_or_make("a", lambda: torch.zeros(1))[1] is True


def test_result_larger_than_the_cache_displaces_nothing():
    cache = StageCache(100)
    cache.get_or_make("small", lambda: torch.zeros(10))
    cache.get_or_make("large", lambda: torch.zeros(1000))
    assert cache.get_or_make("small", lambda: None)[1] is False


def test_shared_storage_counts_once():
    cache = StageCache(1 << 20)
    base = torch.zeros(100)
    cache.get_or_make("views", lambda: [base[:50], base[50:]])
    assert cache.bytes_used == 400


def test_gradients_are_never_kept():
    cache = StageCache(1 << 20)
    cache.get_or_make("k", lambda: torch.ones(3, requires_grad=True))
    assert cache.bytes_used == 0


def test_memory_beside_tensors_counts():
    mesh = Mesh(torch.eye(3), torch.tensor([[0, 1, 2]], dtype=torch.int32))
    cache = StageCache(1000)
    occluder, _ = cache.get_or_make("occluder", lambda: Occluder(mesh))
    assert cache.bytes_used == occluder.held_bytes > 0
