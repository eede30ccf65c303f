"""Fixtures for all rooms."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from command import Done
from obj_files import CUBE_OBJ, torus_obj

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(autouse=True, scope="session")
def own_shelf(tmp_path_factory):
    """Nothing is kept on disk for later, nor found there."""
    os.environ["TEXSSS_CACHE_DIR"] = str(tmp_path_factory.mktemp("cache"))
    os.environ["TEXSSS_DISK_MB"] = "0"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of foreign meshes and maps; tests that need it are skipped, by name, where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("../shared/data is absent: foreign meshes and maps not tested")
    return SHARED_DATA


@pytest.fixture(scope="session")
def bad_files(shared_data, tmp_path_factory) -> Path:
    """A folder of 158 deliberately bad meshes, and textures in tex/; not to be written to."""
    folder = tmp_path_factory.mktemp("bad")
    subprocess.run([sys.executable, str(shared_data / "make_nasty.py"), str(folder)], check=True)
    return folder


@pytest.fixture(scope="session")
def small(tmp_path_factory) -> dict:
    """A painted torus on a small atlas: closed, curved, with seams, quick."""
    from texsss.io.images import write_png  # not before types are watched

    folder = tmp_path_factory.mktemp("torus")
    (folder / "torus.obj").write_bytes(torus_obj(48, 24, digits=15))
    stripes = torch.rand(32, 32, 3, generator=torch.Generator().manual_seed(1)) * 0.6 + 0.3
    write_png(folder / "albedo.png", stripes)
    return {
        "mesh": {"source": str(folder / "torus.obj"), "unit_mm": 1.0},
        "maps": {"albedo": {"source": str(folder / "albedo.png"), "space": "srgb"}},
        "material": {"layers": [{"medium": "skin1"}], "surface": {"albedo": "albedo"}},
        "atlas": {"size": 128},
        "camera": {"resolution": [64, 48], "samples": 1},
    }


@pytest.fixture
def texsss(tmp_path, monkeypatch, capfd):
    """Runs the command line in `tmp_path`, in this process."""
    from texsss.cli import main  # not before types are watched

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")

    def run(*args: object) -> Done:
        with pytest.raises(SystemExit) as stopped:
            main([str(argument) for argument in args])
        code = stopped.value.code
        return Done(0 if code is None else int(code), *capfd.readouterr())

    return run


@pytest.fixture
def cube(tmp_path) -> Path:
    path = tmp_path / "cube.obj"
    path.write_text(CUBE_OBJ)
    return path
