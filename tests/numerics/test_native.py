"""Loops in C++: built once, kept on disk, done without where nothing can be built."""

import ctypes

import pytest

from texsss.numerics import native


@pytest.fixture
def source(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path / "cache"))
    native._library.cache_clear()
    path = tmp_path / "twice.cpp"
    path.write_text('extern "C" int times(int x) { return FACTOR * x; }')
    yield path
    native._library.cache_clear()


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
