"""Results last on disk: the same when read, bounded, and never more than what they are made of."""

import json
import os
from pathlib import Path

import pytest
import torch
from typer.testing import CliRunner

from texsss.baker import Baker
from texsss.cli import app
from texsss.diffusing import KINDS
from texsss.errors import DomainError
from texsss.scene import Scene
from texsss.shelf import Shelf, users_shelf

SCENE = {
    "atlas": {"size": 96},
    "methods": {"diffusion": "surface", "profile": "dipole"},
    "lights": [{"type": "directional", "direction": [0, 0, 1]}],
}


def test_operators_last_from_one_baker_to_the_next(tmp_path: Path):
    scene, shelf = Scene.parse(SCENE), Shelf(tmp_path, 1 << 30, KINDS)
    first = Baker(shelf=shelf).bake(scene)
    (item,) = shelf.items()
    heard: list[tuple[str, float]] = []
    again = Baker(shelf=shelf).bake(scene, progress=lambda stage, done: heard.append((stage, done)))
    assert torch.equal(again.exitance, first.exitance)
    assert [done for stage, done in heard if stage == "operators"] == [0.0, 1.0], "read, not made"
    assert [i.path for i in shelf.items()] == [item.path]


def test_what_cannot_be_read_is_made_anew(tmp_path: Path):
    shelf = Shelf(tmp_path, 1 << 20)
    shelf.put("whole", {"x": torch.ones(3)}, 12)
    assert torch.equal(shelf.get("whole")["x"], torch.ones(3))
    shelf.put("strange", Path("of no kind that is known"), 12)
    (tmp_path / "cut.pt").write_bytes((tmp_path / "whole.pt").read_bytes()[:100])
    for name in ("strange", "cut", "absent"):
        assert shelf.get(name) is None
    assert [item.path.stem for item in shelf.items()] == ["whole"]


def test_what_is_of_other_fields_is_made_anew(tmp_path: Path):
    def shelf(**fields: type) -> Shelf:
        return Shelf(tmp_path, 1 << 20, (type("Kept", (), {"__annotations__": fields}),))

    shelf(values=int).put("key", 1, 12)
    assert shelf(values=int).get("key") == 1
    assert shelf(values=int, order=int).get("key") is None


def test_the_longest_without_use_make_room(tmp_path: Path):
    shelf = Shelf(tmp_path, 3 * 45_000)
    for number, name in enumerate("abc"):
        shelf.put(name, torch.zeros(10_000), 40_000)
        os.utime(tmp_path / f"{name}.pt", (number, number))
    assert shelf.get("a") is not None  # of use just now
    shelf.put("d", torch.zeros(10_000), 40_000)
    assert {item.path.stem for item in shelf.items()} == {"a", "c", "d"}
    shelf.put("too large", torch.zeros(1), 1 << 30)
    Shelf(tmp_path / "a.pt" / "below", 1 << 20).put("nowhere", 1, 1)
    assert len(shelf.items()) == 3


def test_the_command_lists_and_clears(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TEXSSS_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("TEXSSS_DISK_MB", "2")
    users_shelf().put("one", torch.zeros(1000), 4000)
    told = CliRunner().invoke(app, ["cache"]).stdout
    assert "one" in told and "of 2 MB" in told
    found = json.loads(CliRunner().invoke(app, ["cache", "--json", "--clear"]).stdout)
    assert found["removed"] == 1 and found["items"] == [] and found["bytes"] == 0
    monkeypatch.setenv("TEXSSS_DISK_MB", "much")
    with pytest.raises(DomainError, match="TEXSSS_DISK_MB: expected a number of MB"):
        users_shelf()
