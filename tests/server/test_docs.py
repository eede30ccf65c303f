"""docs/service.md: its client and its curl lines work, its tables are complete."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from texsss_server.problems import KINDS
from texsss_server.settings import Settings

ADDRESS = "http://127.0.0.1:8000"
TEXT = (Path(__file__).parents[2] / "docs" / "service.md").read_text()


def block(language: str) -> str:
    (found,) = re.findall(rf"```{language}\n(.*?)```", TEXT, re.S)
    return found


def test_python_client_bakes(server, torus, tmp_path):
    (tmp_path / "torus.obj").write_bytes(torus)
    code = block("python")
    assert len([line for line in code.splitlines() if line]) <= 12
    script = [sys.executable, "-c", code.replace(ADDRESS, server.url)]
    told = subprocess.run(script, cwd=tmp_path, check=True, timeout=120, capture_output=True, text=True)
    assert (tmp_path / "model.glb").read_bytes()[:4] == b"glTF"
    assert "event: done" in told.stdout


def test_curl_lines_work(server, torus, tmp_path):
    if shutil.which("curl") is None:
        pytest.skip("curl is absent: the lines of docs/service.md were not tried")
    (tmp_path / "torus.obj").write_bytes(torus)
    script = f"set -e\n{block('sh').replace(ADDRESS, server.url)}"
    subprocess.run(["sh", "-c", script], cwd=tmp_path, check=True, timeout=120)
    begins = {"picture.jpg": b"\xff\xd8\xff", "exitance.exr": b"v/1\x01", "model.glb": b"glTF"}
    for name, magic in begins.items():
        assert (tmp_path / name).read_bytes().startswith(magic)


def test_every_problem_and_setting_is_told():
    assert all(f"| {kind.status} | `{slug}` |" in TEXT for slug, kind in KINDS.items())
    assert all(f"TEXSSS_{name.upper()}" in TEXT for name in Settings.model_fields)
