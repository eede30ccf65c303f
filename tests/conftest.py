"""Fixtures for all rooms."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

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
