"""Without a C++ compiler, weights of many rows are numba's; the usual loops are known before."""

import pytest
import torch

from texsss import ahead
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.numerics import jitted, loop_files, native
from texsss.profiles import usual, weights
from texsss.profiles.blocks import Loops
from texsss.profiles.project import variance_ladder
from texsss.profiles.weights import weights_for

LADDER = variance_ladder(0.4, 400.0, 8)


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setattr(native, "_compiler", lambda: None)
    native._library.cache_clear()
    native.notice.cache_clear()
    yield
    native._library.cache_clear()
    native.notice.cache_clear()


class Patient(Loops):
    def __init__(self):
        super().__init__(wait=True)


def painted(layers: int, rows: int) -> Stack:
    upper = [Layer(preset("skin1"), torch.linspace(0.0, 2.0, rows)[None])] * (layers - 1)
    return Stack([*upper, Layer(preset("skin2"))])


def test_many_rows_are_solved_by_numba_as_soon_as_its_loop_is_built(no_compiler, monkeypatch):
    """Within rounding of those by torch, which answers before: measured 2e-6. One notice is given."""
    stack, options = painted(2, 12_000), {"model": "layered-diffusion", "levels": None}
    monkeypatch.setattr(loop_files, "_begin", lambda folder: None)
    with pytest.warns(RuntimeWarning, match="march and diffusion run .* no C\\+\\+ compiler") as said:
        before = weights_for(stack, LADDER, compiled=True, **options)
    assert len(said) == 1
    exact = weights_for(stack, LADDER, **options)
    torch.testing.assert_close(before.table, exact.table, rtol=0, atol=0)

    monkeypatch.setattr(weights, "Loops", Patient)
    weights_for(stack, LADDER, compiled=True, **options)
    monkeypatch.setattr(weights, "Loops", Loops)
    ran, run = [], jitted.Loop.__call__
    monkeypatch.setattr(jitted.Loop, "__call__", lambda *given: (ran.append(given[2].shape), run(*given)))
    by_numba = weights_for(stack, LADDER, compiled=True, **options)
    assert sum(shape[1] for shape in ran) == 3 * 12_000
    torch.testing.assert_close(by_numba.table, exact.table, rtol=0, atol=2e-5)


@pytest.mark.parametrize(("layers", "scattering"), usual.KINDS)
def test_the_usual_loops_are_those_of_painted_skin(layers, scattering, no_compiler, monkeypatch):
    asked = []
    monkeypatch.setattr(loop_files, "loop", lambda text, wait: asked.append(text))
    monkeypatch.setattr(jitted.Loop, "__call__", lambda loop, inputs, result: result.zero_())
    monkeypatch.setattr(weights, "WORTH_COMPILING", 1)
    stack = painted(layers, 10) if layers > 1 else preset("skin1")
    with pytest.warns(RuntimeWarning, match="no C\\+\\+ compiler"):
        weights_for(stack, LADDER, scattering=scattering, compiled=True)
    assert asked == [usual.text(layers, scattering)]


def test_they_are_built_ahead(no_compiler, tmp_path, monkeypatch):
    """Recorded in a process of its own, once."""
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path))
    texts, built = [usual.text(*kind) for kind in usual.KINDS], []
    monkeypatch.setattr(loop_files, "build", lambda folder, cancel: built.append(folder) is None)
    for _ in range(2):
        building = ahead.Ahead().start()
        building._thread.join()
        monkeypatch.setattr(ahead, "run", lambda *_: pytest.fail("recorded again"))
    assert [x.name for x in built[: len(texts)]] == [loop_files.kept(text).name for text in texts]
    assert built[len(texts) :] == built[: len(texts)]
