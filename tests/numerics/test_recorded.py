"""What is recorded, repeated by torch or as a loop of numba, is what the function gives."""

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
import torch

from texsss.numerics import loop_files, native
from texsss.numerics.jitted import Loop, Source
from texsss.numerics.recorded import Recording

S = torch.linspace(0, 3, 5)[:, None]
LOCKS = pytest.mark.skipif(importlib.util.find_spec("fcntl") is None, reason="no locks: each builds")


def every_form(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Each operation once at least, in place and not, by numbers and tensors from either side."""
    none = torch.zeros_like(a)
    x = torch.addcmul(a, S, b, value=-0.5) + torch.addcdiv(none, S, b.clamp(0.2, 3.0)).sqrt_()
    x = torch.add(x, b.expand_as(x), alpha=2).abs().clamp_min(0.1).clamp_(max=9.0)
    x = torch.where(x > 1, x, 0.5 * b)
    x = x + torch.where(a >= b, a, 1.0) - torch.where(a < b, a, b) + torch.where(a <= 0.5, 1.0, b)
    y = (1 - torch.exp(-x)) * torch.expm1(x.clamp_max(2)) + 3 / x - torch.sin(9 * x) * torch.cos(-x)
    y = y.neg_() + torch.rsqrt(x) + torch.reciprocal(x) + x**2 + x**1.5 + (a + 1) ** -1.5
    return torch.lerp(y, x, torch.minimum(a, b)) / torch.maximum(a, b.detach()).mul_(2).add_(1)


@pytest.mark.parametrize("count", [1, 200])
def test_a_loop_knows_every_form(count):
    """float32 against float64, of values up to 40: measured 8e-6."""
    generator = torch.Generator().manual_seed(5)
    inputs = [torch.rand(1, count, generator=generator) * 2 + 0.1 for _ in range(2)]
    made = torch.full((len(S), count), torch.nan)
    Loop(Recording(every_form, inputs), wait=True)(inputs, made)
    torch.testing.assert_close(made.double(), every_form(*(x.double() for x in inputs)), rtol=2e-5, atol=2e-5)


def test_equal_operations_are_done_once_and_idle_ones_never():
    def function(a):
        (a + 1).exp()
        return S * (a * 2).add_(3) + S * (a * torch.full_like(a, 2) + 3) + (a * 2 + 3)

    names = [x.name for x in Recording(function, [torch.rand(1, 4)]).operations]
    assert sorted(names) == ["add"] * 3 + ["mul"] * 2


@pytest.mark.parametrize(
    "function",
    [lambda a: S * a.sum(), lambda a: S * a.flip(1), lambda a: S * float(a[0, 0]), lambda a: S * a.mT.mT],
)
def test_what_looks_at_other_columns_is_refused(function):
    with pytest.raises(LookupError, match="no operation on every column"):
        Recording(function, [torch.rand(1, 4)])


def test_a_loop_is_built_beside_what_asks_for_it(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path))
    recording, x = Recording(lambda a: S * a, [torch.rand(1, 4)]), torch.rand(1, 4)
    with pytest.raises(LookupError, match="not built"):
        Loop(recording, wait=False)
    made = torch.empty(len(S), 4)
    Loop(recording, wait=True)([x], made)
    torch.testing.assert_close(made, S * x)
    monkeypatch.setattr(loop_files, "run", lambda *_, **__: pytest.fail("built again"))
    Loop(recording, wait=False)


def test_a_loop_whose_folder_has_gone_is_made_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path))
    recording, x = Recording(lambda a: S * a + 0.75, [torch.rand(1, 4)]), torch.rand(1, 4)
    folder = loop_files.kept(Source(recording).text)
    monkeypatch.setattr(loop_files, "_CHILD", "raise ImportError('numba')")
    assert not loop_files.build(folder)
    shutil.rmtree(folder)
    monkeypatch.undo()
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path))
    made = torch.empty(len(S), 4)
    Loop(recording, wait=True)([x], made)
    torch.testing.assert_close(made, S * x + 0.75)
    gone = folder.with_name("loop_gone")
    assert not loop_files.build(gone)
    assert gone not in loop_files._FAILED


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no alarms: the process ends by itself only")
def test_a_process_that_nobody_waits_for_ends(tmp_path):
    (tmp_path / "hangs.py").write_text("import time; time.sleep(60)")
    command = _child(tmp_path, "hangs", patience_s=1)
    assert subprocess.run(command, check=False, timeout=30).returncode == -signal.SIGALRM


@LOCKS
def test_processes_that_want_the_same_loop_build_it_once(tmp_path):
    (tmp_path / "slow.py").write_text("import time; open('begun', 'a').write('x'); time.sleep(.5)")
    both = [subprocess.Popen(_child(tmp_path, "slow"), cwd=tmp_path) for _ in range(2)]
    assert [one.wait(30) for one in both] == [0, 0]
    assert (tmp_path / "begun").read_text() == "x" and (tmp_path / "built").is_file()


@LOCKS
def test_who_waits_for_another_goes_with_who_asked(tmp_path):
    """Or short runs would leave a row of them; here nobody of that number is its parent."""
    fcntl = importlib.import_module("fcntl")
    with (tmp_path / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert subprocess.run(_child(tmp_path, "any", asker=0), check=False, timeout=30).returncode == 0
    assert not (tmp_path / "built").exists()


@LOCKS
def test_who_builds_and_is_killed_leaves_no_lock(tmp_path):
    (tmp_path / "dies.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    (tmp_path / "works.py").write_text("")
    for name, ends in (("dies", -signal.SIGKILL), ("works", 0)):
        assert subprocess.run(_child(tmp_path, name), check=False, timeout=30).returncode == ends
    assert (tmp_path / "built").is_file()


@pytest.mark.filterwarnings("ignore:subprocess .* is still running")
def test_a_loop_is_finished_though_who_began_it_has_ended(tmp_path):
    """Runs shorter than what they begin would begin it again and again."""
    folder = tmp_path / "loop_slow"
    folder.mkdir()
    (folder / "loop_slow.py").write_text("import time; open('begun', 'w'); time.sleep(.5)")
    assert not loop_files.build(folder, (folder / "begun").is_file)
    built, patience = loop_files._built(folder), time.monotonic() + 30
    while not built.is_file() and time.monotonic() < patience:
        time.sleep(0.05)
    assert loop_files.build(folder, lambda: pytest.fail("begun again"))


def test_a_loop_that_cannot_be_kept_is_none(tmp_path, monkeypatch):
    (tmp_path / "native").write_text("no folder")
    _nothing_comes(tmp_path, monkeypatch, "NotADirectoryError")


def test_a_loop_that_numba_cannot_make_is_none(tmp_path, monkeypatch):
    monkeypatch.setattr(loop_files, "_CHILD", "raise ImportError('numba')")
    _nothing_comes(tmp_path, monkeypatch, "CalledProcessError")


def _child(folder, module: str, patience_s: int = 60, asker: int | None = None) -> list[str]:
    """The command that imports a module of `folder`, and says so in the file `built`."""
    given = [folder, module, folder / "built", patience_s, os.getpid() if asker is None else asker]
    return [sys.executable, "-c", loop_files._CHILD, *map(str, given)]


def _nothing_comes(folder, monkeypatch, why: str) -> None:
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(folder))
    native.notice.cache_clear()
    recording = Recording(lambda a: S * a + 0.25, [torch.rand(1, 4)])
    with (
        pytest.warns(RuntimeWarning, match=f"profiles run .* numba could not .*{why}"),
        pytest.raises(LookupError, match="not built"),
    ):
        Loop(recording, wait=True)
    with pytest.raises(LookupError):  # warnings are errors
        Loop(recording, wait=False)
