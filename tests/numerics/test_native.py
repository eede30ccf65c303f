"""Loops in C++: built once, kept on disk, done without where nothing can be built."""

import ctypes
import os
import signal
import threading
import time

import pytest

from texsss.numerics import native


@pytest.fixture
def source(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path / "cache"))
    native._library.cache_clear()
    native._HANGS.clear()
    path = tmp_path / "twice.cpp"
    path.write_text('extern "C" int times(int x) { return FACTOR * x; }')
    yield path
    native._library.cache_clear()
    native._HANGS.clear()


@pytest.mark.skipif(native._compiler() is None, reason="no C++ compiler: nothing can be built")
def test_what_was_built_is_found_again(source, monkeypatch):
    double, triple = (native.library(source, {"FACTOR": n}) for n in (2, 3))
    assert double is not None and triple is not None
    assert (double.times(21), triple.times(21)) == (42, 63)
    # as another process would: nothing is known but what lies on disk
    native._library.cache_clear()
    monkeypatch.setattr(native, "_build", lambda *_: pytest.fail("built again"))
    again = native.library(source, {"FACTOR": 2})
    assert isinstance(again, ctypes.CDLL) and again.times(4) == 8


def test_without_a_compiler_there_is_one_notice(source, monkeypatch):
    monkeypatch.setattr(native, "_compiler", lambda: None)
    native.notice.cache_clear()
    with pytest.warns(RuntimeWarning, match="no C\\+\\+ compiler"):
        assert native.library(source, {"FACTOR": 2}) is None
    assert native.library(source, {"FACTOR": 3}) is None  # warnings are errors


@pytest.mark.skipif(native._compiler() is None, reason="no C++ compiler: nothing can be built")
def test_what_is_damaged_is_built_again(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXSSS_CACHE_DIR", "beside")  # as good as a whole path
    assert native._built(source, (("FACTOR", 2),)) is not None
    (made,) = (tmp_path / "beside" / "native").glob("*.so")
    made.write_bytes(b"")
    found = native.library(source, {"FACTOR": 2})
    assert found is not None and found.times(21) == 42


def test_a_compiler_may_have_arguments(monkeypatch):
    native._compiler.cache_clear()
    monkeypatch.setenv("CXX", "env g++")
    found = native._compiler()
    native._compiler.cache_clear()
    assert found is not None and found[0].endswith("/env") and found[1:] == ("g++",)


@pytest.mark.skipif(native._compiler() is None, reason="no C++ compiler: nothing can be built")
def test_what_cannot_be_built_is_done_without(source):
    native.notice.cache_clear()
    source.write_text("nonsense")
    with pytest.warns(RuntimeWarning, match="could not be built"):
        assert native.library(source, {}) is None


def test_a_compiler_that_hangs_is_waited_for_once(source, tmp_path, monkeypatch):
    monkeypatch.setattr(native, "PATIENCE_S", 0.3)
    monkeypatch.setattr(native, "_version", lambda _: b"")
    monkeypatch.setattr(native, "_compiler", lambda: (_script(tmp_path, "sleep 60"),))
    native.notice.cache_clear()
    with pytest.warns(RuntimeWarning, match="TimeoutExpired"):
        assert native.library(source, {"FACTOR": 2}) is None
    start = time.monotonic()
    assert native.library(source, {"FACTOR": 3}) is None  # warnings are errors
    assert time.monotonic() - start < 0.25
    assert not list((tmp_path / "cache" / "native").iterdir())


def test_who_is_told_to_go_leaves_no_compiler(source, tmp_path, monkeypatch):
    monkeypatch.setattr(native, "_version", lambda _: b"")
    monkeypatch.setattr(native, "_compiler", lambda: (_script(tmp_path, "sleep 60 & wait"),))
    waits = threading.Thread(target=native.build, args=(source, {}, lambda: False))
    waits.start()
    while not native._RUNNING:
        time.sleep(0.01)
    (running,) = native._RUNNING
    native.abandon()
    waits.join(5)
    assert not waits.is_alive() and running.returncode == -signal.SIGKILL
    assert not list((tmp_path / "cache" / "native").iterdir())


def test_what_nobody_loads_is_swept(tmp_path):
    old, new, left = tmp_path / "old.so", tmp_path / "new.so", tmp_path / "build-x"
    left.mkdir()
    for path in (old, new, left / "part.s"):
        path.touch()
    for path in (old, left):
        os.utime(path, (0, time.time() - native.KEPT_S - 1))
    native.sweep(tmp_path)
    assert list(tmp_path.iterdir()) == [new]


def _script(folder, does: str) -> str:
    path = folder / "compiler"
    path.write_text(f"#!/bin/sh\n{does}\n")
    path.chmod(0o755)
    return str(path)
