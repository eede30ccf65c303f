"""Bad files through the whole bake: a finite result or one sentence, never a traceback."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.hostile import answers

MOST_BYTES = 2 << 30
WORST = (  # the most memory, the longest, the deepest; and some that bake
    *("png_bomb_20000x20000_1bit.png", "instances_1e7.glb"),
    *("claims_4e9_list_items.ply", "uv_overlap.obj"),
)


def test_every_bad_file_is_baked_or_answered_in_one_sentence(bad_files):
    rows = list(answers(bad_files))
    assert len(rows) == 158
    for name, seconds, said in rows:
        assert seconds < 20, name
        assert "\n" not in said and len(said) > 10, name
        done = said.startswith(("baked", "read"))
        assert done or (Path(name).stem in said and said.endswith(".")), said
    assert sum(said.startswith(("baked", "read")) for _, _, said in rows) > 50


@pytest.mark.parametrize("name", WORST)
def test_the_worst_by_the_command_line(bad_files, tmp_path, name):
    """In a process of its own: at most 2 GB, six files or one sentence and none."""
    command = [sys.executable, "-m", "texsss", "bake", "--size", "64", "--out", str(tmp_path / "out")]
    path = bad_files / name
    if not path.is_file():
        path = bad_files / "tex" / name
        command += ["--env", str(path), "--dry-run"]
    else:
        command += [str(path)]
    command += ["--diffusion", "uv"]
    script = (
        "import resource, subprocess, sys;"
        "done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL);"
        "print(done.returncode, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, *command], capture_output=True, text=True, timeout=60, env=os.environ
    )
    code, kilobytes = (int(word) for word in done.stdout.split())
    assert kilobytes * 1024 < MOST_BYTES
    assert "Traceback" not in done.stderr
    if code == 0:
        assert len(list((tmp_path / "out").iterdir())) == 6
    else:
        assert code == 2 and len(done.stderr.strip().splitlines()) == 1 and name in done.stderr
        assert not list(tmp_path.iterdir()), "partial files were left"
