"""What is compiled while everything else is loaded: exactly what bakes ask for, once."""

import subprocess
import sys
import threading

import pytest
import torch

from texsss import ahead
from texsss.numerics import native
from texsss.profiles import fused as weighing
from texsss.profiles.incidence import NODES, NODES_WIDE
from texsss.transport import loops
from texsss.transport.march import fused as marching
from texsss.transport.march.interior import Interior


def test_what_is_built_ahead_is_what_is_asked_for(monkeypatch):
    asked = []
    for room in (weighing, loops, marching):
        monkeypatch.setattr(room, "library", lambda *what: asked.append(what))
    loops.making()
    loops.products()
    for directions in (NODES, NODES_WIDE):
        weighing._loop(directions)
    for boundaries in range(3):
        depth = torch.ones(1, 1, boundaries).cumsum(-1)
        media = torch.ones(boundaries + 1, 3)
        marching.Fused(Interior(depth, media, 2 * media, 0 * media, eta=1.0), "henyey-greenstein")
    assert sorted(asked, key=str) == sorted(ahead.USUAL, key=str)


def test_building_waits_for_no_torch():
    code = "import sys, texsss.ahead; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.skipif(native._compiler() is None, reason="no C++ compiler: nothing can be built")
def test_a_stop_ends_the_compiler_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path))
    begun, build = threading.Event(), native.subprocess.Popen
    monkeypatch.setattr(native.subprocess, "Popen", lambda *a, **k: (begun.set(), build(*a, **k))[1])
    building = ahead.Ahead().start()
    assert begun.wait(20)
    building.stop()
    assert not building._thread.is_alive()
    assert not list((tmp_path / "native").iterdir())


def test_usual_loops_are_recorded_anew_where_one_has_gone(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(ahead, "version", lambda _: "0")
    source, times = tmp_path / "native" / "loop_a" / "loop_a.py", []

    def run(*_):
        native.written(source, "")
        times.append(1)
        return b"loop_a\n"

    monkeypatch.setattr(ahead, "run", run)
    for _ in range(2):
        assert ahead.Ahead()._recorded() == "loop_a\n"
    assert len(times) == 1
    source.unlink()
    assert ahead.Ahead()._recorded() == "loop_a\n"
    assert len(times) == 2 and source.is_file()


def test_a_stop_before_a_start():
    ahead.Ahead().stop()
