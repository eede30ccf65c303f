"""docs/python.md: its code runs, from the first line to the last."""

import re
from pathlib import Path

from obj_files import torus_obj

import texsss as tx

TEXT = (Path(__file__).parents[1] / "docs" / "python.md").read_text()


def test_code_runs(tmp_path, monkeypatch, capsys):
    for name, tube in (("body", 20.0), ("muscle", 15.0), ("organs", 10.0)):
        (tmp_path / f"{name}.obj").write_bytes(torus_obj(tube=tube))
    monkeypatch.chdir(tmp_path)
    known: dict = {}
    for code in re.findall(r"```python\n(.*?)```", TEXT, re.S):
        exec(code, known)
    assert known["rgba"].shape == (128, 128, 4) and known["burley"].d.shape == (3,)


def test_public_names_are_explained():
    """Or they are errors, classes that others return, or on the first page."""
    told = TEXT + (Path(__file__).parents[1] / "README.md").read_text()
    left = {"Baked", "Burley", "GaussianSum", "Cancelled"} | {x for x in tx.__all__ if x.endswith("Error")}
    assert {name for name in tx.__all__ if not re.search(rf"\b{name}\b", told)} <= left
