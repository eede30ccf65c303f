"""Bad files through the whole bake: a finite result or one sentence, never a traceback."""

from pathlib import Path

from benchmarks.hostile import answers


def test_every_bad_file_is_baked_or_answered_in_one_sentence(bad_files):
    rows = list(answers(bad_files))
    assert len(rows) == 158
    for name, seconds, said in rows:
        assert seconds < 20, name
        assert "\n" not in said and len(said) > 10, name
        done = said.startswith(("baked", "read"))
        assert done or (Path(name).stem in said and said.endswith(".")), said
    assert sum(said.startswith(("baked", "read")) for _, _, said in rows) > 50
