"""Mistakes on the command line and in scenes: one sentence, exit code 2, no files."""

import itertools

import pytest
from command import told

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"

BAD = {
    "missing file": (None, [], "found none"),
    "not a mesh": ("hello", [], "mesh.obj"),
    "empty": ("", [], "mesh.obj"),
    "no triangles": ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", [], "triangle"),
    "nan": ("v nan nan nan\nv nan nan nan\nv nan nan nan\nf 1 2 3\n", [], "mesh.obj"),
    "zero extent": ("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", [], "mesh.obj"),
    "size 0": (TRIANGLE, ["--size", "0"], "atlas.size"),
    "size 1000000": (TRIANGLE, ["--size", "1000000"], "atlas.size"),
    "size not a number": (TRIANGLE, ["--size", "abc"], "--size"),
    "unknown option": (TRIANGLE, ["--sise", "64"], "--sise"),
    "unit nan": (TRIANGLE, ["--unit-mm", "nan"], "mesh.unit_mm"),
    "unit 0": (TRIANGLE, ["--unit-mm", "0"], "mesh.unit_mm"),
    "unknown preset": (TRIANGLE, ["--material", "skim"], "marble"),
    "unknown tonemap": (TRIANGLE, ["--tonemap", "x"], "agx"),
    "nothing beneath": (TRIANGLE, ["--diffusion", "parallax"], "methods.parallax.layers"),
    "unknown diffusion": (TRIANGLE, ["--diffusion", "magic"], "methods.diffusion"),
    "missing albedo": (TRIANGLE, ["--albedo", "none.png"], "none.png"),
    "looks like markup": (TRIANGLE, ["--albedo", "[/].png"], "[/].png"),
    "name too long": (TRIANGLE, ["--albedo", "a" * 300 + ".png"], "cannot be read"),
    "unwritable out": (TRIANGLE, ["--out", "mesh.obj/out"], "--out"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_sentence(texsss, name, tmp_path):
    text, options, says = BAD[name]
    if text is not None:
        (tmp_path / "mesh.obj").write_text(text)
    before = set(tmp_path.iterdir())
    done = texsss("bake", "mesh.obj", *options)
    told(done, says)
    assert set(tmp_path.iterdir()) == before, "partial files were left"


SCENES = {
    "not json": ("{", "line 1"),
    "not an object": ("[]", "scene.json"),
    "unknown field": ('{"atlas": {"sice": 64}}', "atlas.sice"),
    "wrong type": ('{"camera": {"resolution": "big"}}', "camera.resolution"),
    "infinite number": ('{"output": {"exposure_ev": 1e999}}', "output.exposure_ev"),
    "another version": ('{"version": 99}', "version"),
    "missing mesh": ('{"mesh": {"source": {"path": "none.obj"}}}', "none.obj"),
    "missing map": (
        '{"maps": {"a": {"source": {"path": "none.png"}}}, "material": {"surface": {"albedo": "a"}}}',
        "none.png",
    ),
}


@pytest.mark.parametrize(
    ("command", "name"),
    [*itertools.product(("bake", "render"), SCENES)]
    + [(command, "unknown field") for command in ("inspect", "compare", "map")],
)
def test_bad_scene_is_one_sentence(texsss, command, name, tmp_path):
    text, says = SCENES[name]
    (tmp_path / "scene.json").write_text(text)
    told(texsss(command, "scene.json"), says)
    assert set(tmp_path.iterdir()) == {tmp_path / "scene.json"}, "partial files were left"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["profile", "skim"], "marble"),
        (["profile", "none.json"], "none.json"),
        (["profile", "skin1", "--plot", "plot.txt"], "--plot"),
        (["render", "--out", "image.jpg"], "--out"),
        (["map", "--name", "sheen"], "irradiance"),
        (["inspect", "--picture", "charts.txt"], "--picture"),
        (["compare", "--method", "magic"], "surface"),
        (["bake", "--light", "lamp:1"], "--light"),
        (["profil"], "profile"),
    ],
)
def test_bad_options_are_one_sentence(texsss, arguments, says, tmp_path):
    told(texsss(*arguments), says)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "light", ["", "foo", "point", "point:1,2", "point:1,2,x", "ball:1,2,3", "panel:1,2,3:0,0,1:0,9"]
)
def test_bad_light_is_told_its_form(texsss, cube, light):
    done = texsss("bake", cube, "--light", light)
    assert done.returncode == 2
    assert "--light" in done.stderr and len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "options, says", [(["--material", "nope"], "marble"), (["--albedo", "no.png"], "no.png")]
)
def test_dry_run_tells_bad_input_too(texsss, cube, options, says):
    done = texsss("bake", cube, "--dry-run", *options)
    assert done.returncode == 2 and says in done.stderr and not done.stdout


def test_malformed_scene_names_the_field(texsss, tmp_path):
    (tmp_path / "scene.json").write_text(
        '{"material": {"layers": [{"medium": "skin1", "thickness_mm": -1}]}}'
    )
    done = texsss("render", "scene.json")
    assert done.returncode == 2
    assert "material.layers.0.thickness_mm" in done.stderr
