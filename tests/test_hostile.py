"""Bad files through the whole bake: a finite result or one sentence, never a traceback."""

import runpy
import sys

from benchmarks.hostile import answers


def test_every_bad_file_is_baked_or_answered_in_one_sentence(shared_data, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["make_nasty.py", str(tmp_path)])
    runpy.run_path(str(shared_data / "make_nasty.py"))
    rows = list(answers(tmp_path))
    assert len(rows) == 158
    for name, seconds, said in rows:
        assert seconds < 20, name
        assert "\n" not in said and len(said) > 10, name
        done = said.startswith(("baked", "read"))
        assert done or (name.removeprefix("tex/") in said and said.endswith(".")), said
    assert sum(said.startswith(("baked", "read")) for _, _, said in rows) > 50
