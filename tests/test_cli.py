"""The command line as a stranger meets it: files out, and what it says."""

import errno
import json
import os
import subprocess
import sys
import warnings
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from command import told
from obj_files import SQUARE_OBJ
from PIL import Image

from texsss import terminal
from texsss.baker import Baker
from texsss.errors import Cancelled
from texsss.io.sandbox import Sandbox
from texsss.numerics import native
from texsss.scene import Scene

FILES = {"irradiance.exr", "radiance.exr", "radiance.png", "preview.png", "model.glb", "report.json"}


def test_the_package_runs_and_says_its_version():
    done = subprocess.run(
        [sys.executable, "-m", "texsss", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"texsss {version('texsss')}\n"


def test_installed_command_says_what_it_does():
    command = Path(sys.executable).with_name("texsss")
    done = subprocess.run([command, "--help"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert all(word in done.stdout for word in ("bake", "render", "scene"))


def test_slower_ways_are_told_as_notes(capfd, monkeypatch):
    """Not as warnings of Python, with a file and a line; those of others stay what they are."""
    seen = []
    monkeypatch.setattr(warnings, "showwarning", lambda message, *_, **__: seen.append(str(message)))
    native.notice.cache_clear()
    with terminal.noted_warnings():
        warnings.filterwarnings("always", message="of others")
        native.notice("no C++ compiler was found")
        warnings.warn("of others", stacklevel=1)
    assert seen == ["of others"]
    said = "note March and diffusion run uncompiled, several times slower, because no C++ compiler was found."
    assert capfd.readouterr().err.strip() == said


def test_bake_writes_the_six_files(texsss, cube, tmp_path):
    out = tmp_path / "out"
    done = texsss("bake", cube, "--material", "marble", "--unit-mm", 10, "--size", 64, "--out", out)
    assert done.returncode == 0, done.stderr
    assert {p.name for p in out.iterdir()} == FILES
    report = json.loads((out / "report.json").read_text())
    assert report["mesh"]["extent_mm"] == [20.0, 20.0, 20.0]
    assert report["scene"]["material"]["layers"][0]["medium"] == "marble"
    assert {"mesh", "atlas", "texels", "light", "bank", "weights", "exitance", "picture"} <= report[
        "seconds"
    ].keys()
    with Image.open(out / "preview.png") as preview:
        assert np.asarray(preview).std() > 10, "a flat picture shows nothing"


def test_scene_init_renders(texsss, cube, tmp_path):
    made = texsss("scene", "init")
    data = json.loads(made.stdout)
    assert data["mesh"]["source"]["builtin"] == "axolotl/axolotl.obj"
    data["mesh"]["source"] = {"path": "cube.obj"}
    data["material"]["surface"]["albedo"] = None
    data["camera"]["resolution"] = [64, 48]
    data["atlas"]["size"] = 64
    data["camera"]["samples"] = 1
    (tmp_path / "scene.json").write_text(json.dumps(data))
    done = texsss("render", "scene.json", "--out", "image.png")
    assert done.returncode == 0, done.stderr
    with Image.open(tmp_path / "image.png") as image:
        assert image.size == (64, 48)


def test_unit_left_out_is_said(texsss, cube, tmp_path):
    done = texsss("bake", cube, "--size", 32, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "unit" in done.stderr and "mm tall" in done.stderr


def test_dry_run_bakes_nothing(texsss, cube, tmp_path):
    done = texsss("bake", cube, "--size", 128, "--out", tmp_path / "out", "--dry-run")
    assert done.returncode == 0, done.stderr
    assert "texels" in done.stdout and "memory" in done.stdout and "seconds" in done.stdout
    assert not (tmp_path / "out").exists()


def test_full_disk_leaves_nothing(texsss, cube, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("texsss.result.write_glb", full)
    done = texsss("bake", cube, "--size", 32, "--unit-mm", 1, "--out", tmp_path / "deep" / "out")
    assert done.returncode == 2
    assert "No space left" in done.stderr.splitlines()[-1], "notes on the mesh came before"
    assert "Traceback" not in done.stderr
    assert set(tmp_path.iterdir()) == {cube}


def test_doubtful_files_are_read_in_a_limited_child(texsss, tmp_path, monkeypatch):
    Image.new("RGB", (8, 8), (200, 150, 120)).save(tmp_path / "colour.png")
    square = tmp_path / "square.obj"
    square.write_text(SQUARE_OBJ)
    given = ("render", square, "--unit-mm", 10, "--size", 32, "--albedo", tmp_path / "colour.png")
    plain = texsss(*given)
    assert plain.returncode == 0, plain.stderr
    (tmp_path / "image.png").rename(tmp_path / "plain.png")
    held = texsss(*given, "--untrusted")
    assert held.returncode == 0, held.stderr
    assert (tmp_path / "image.png").read_bytes() == (tmp_path / "plain.png").read_bytes()
    many = "".join(f"v {i} {i * i % 97} 0\n" for i in range(400_000)) + "f 1 2 3\n"
    (tmp_path / "many.obj").write_text(many)
    monkeypatch.setattr("texsss.io.sandbox.Sandbox", lambda: Sandbox(memory_mb=30))
    told(
        texsss("inspect", tmp_path / "many.obj", "--untrusted"), "many.obj: reading it needs more than 30 MB"
    )


def test_long_bakes_are_foretold(texsss, tmp_path):
    rows = "".join(f"v {i % 300} {i // 300} {i % 7}\n" for i in range(300 * 300))
    rows += "".join(
        f"f {k + 1} {k + 2} {k + 302}\nf {k + 1} {k + 302} {k + 301}\n"
        for k in (300 * j + i for j in range(299) for i in range(299))
    )
    (tmp_path / "large.obj").write_text(rows)
    done = texsss("bake", tmp_path / "large.obj", "--dry-run")
    assert done.returncode == 0 and "made by xatlas" in done.stdout
    said: list[str] = []
    scene = Scene.parse({"mesh": {"source": str(tmp_path / "large.obj"), "unit_mm": 1}})
    with pytest.raises(Cancelled):
        Baker().bake(scene, notice=said.append, cancel=lambda: bool(said))
    assert "178,802 faces" in said[0] and "Ctrl-C" in said[0]
    (tmp_path / "square.obj").write_text(SQUARE_OBJ)
    small = {"mesh": {"source": str(tmp_path / "square.obj"), "unit_mm": 10}, "atlas": {"size": 32}}
    Baker().bake(Scene.parse(small), notice=said.append)
    assert len(said) == 1
