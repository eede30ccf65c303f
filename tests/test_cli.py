"""The command line as a stranger meets it: files out, one sentence and exit code 2 for mistakes."""

import errno
import itertools
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from texsss.baker import Baker
from texsss.cli import main
from texsss.errors import Cancelled
from texsss.inspection import kernel
from texsss.io.sandbox import Sandbox
from texsss.options import described
from texsss.scene import Scene

FILES = {"irradiance.exr", "radiance.exr", "radiance.png", "preview.png", "model.glb", "report.json"}

CUBE_OBJ = """
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 1 5 8 4
"""

SQUARE_OBJ = """
v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4
"""


@dataclass
class Done:
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def texsss(tmp_path, monkeypatch, capfd):
    """Runs the command line in `tmp_path`, in this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")

    def run(*args: object) -> Done:
        with pytest.raises(SystemExit) as stopped:
            main([str(argument) for argument in args])
        code = stopped.value.code
        return Done(0 if code is None else int(code), *capfd.readouterr())

    return run


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


@pytest.fixture
def cube(tmp_path) -> Path:
    path = tmp_path / "cube.obj"
    path.write_text(CUBE_OBJ)
    return path


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


def test_full_disk_leaves_nothing(texsss, cube, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("texsss.result.write_glb", full)
    done = texsss("bake", cube, "--size", 32, "--unit-mm", 1, "--out", tmp_path / "deep" / "out")
    assert done.returncode == 2
    assert "No space left" in done.stderr.splitlines()[-1], "notes on the mesh came before"
    assert "Traceback" not in done.stderr
    assert set(tmp_path.iterdir()) == {cube}


def told(done: Done, says: str) -> None:
    """Asserts that a command stopped with one sentence that holds `says`."""
    assert done.returncode == 2, done.stderr
    assert says in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr


def test_lights_and_maps_in_short(texsss, cube, tmp_path):
    lights = ["--light", "sun:0,1,1:2", "--light", "ball:0,40,40:5:1,2,3", "--light", "sky:0.1"]
    lights += ["--light", "panel:0,90,0:0,-2,0:20,10:4", "--light", "panel:30,40,0:-3,-4,0:20,10"]
    done = texsss(
        "bake", cube, "--unit-mm", 10, "--size", 32, "--roughness", 0.2, *lights, "--out", tmp_path / "out"
    )
    assert done.returncode == 0, done.stderr
    scene = json.loads((tmp_path / "out/report.json").read_text())["scene"]
    assert [light["type"] for light in scene["lights"]] == ["directional", "sphere", "environment"] + 2 * [
        "rectangle"
    ]
    assert scene["lights"][1]["radiance"] == [1, 2, 3]
    assert scene["material"]["surface"]["roughness"] == 0.2
    for panel, towards in zip(scene["lights"][3:], ([0, -1, 0], [-0.6, -0.8, 0]), strict=True):
        width, height = np.array(panel["width_mm"]), np.array(panel["height_mm"])
        assert np.allclose([np.linalg.norm(width), np.linalg.norm(height)], [20, 10])
        assert np.allclose(np.cross(width, height) / 200, towards)


def test_one_channel_of_a_map_is_named_behind_its_file():
    """As glTF packs them: roughness in green."""
    scene = described(Path("head.obj"), roughness="orm.png:g", specular="gloss.png")
    rough, gloss = scene.maps["roughness"], scene.maps["specular"]
    assert (rough.source.path, rough.channel, rough.space) == ("orm.png", "g", "linear")
    assert (gloss.source.path, gloss.channel) == ("gloss.png", "rgb")


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


@pytest.mark.parametrize(
    "light", ["", "foo", "point", "point:1,2", "point:1,2,x", "ball:1,2,3", "panel:1,2,3:0,0,1:0,9"]
)
def test_bad_light_is_told_its_form(texsss, cube, light):
    done = texsss("bake", cube, "--light", light)
    assert done.returncode == 2
    assert "--light" in done.stderr and len(done.stderr.strip().splitlines()) == 1


def test_profile_draws_and_lists(texsss, tmp_path):
    done = texsss("profile", "marble", "--plot", "curve.png", "--against", "multipole", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert all(0 < total < 1 for total in found["total"])
    with Image.open(tmp_path / "curve.png") as plot:
        assert np.asarray(plot).std() > 10


def test_profiles_are_drawn_with_their_lengths(texsss, tmp_path):
    """As comments of an SVG, which has texts as outlines."""
    found = json.loads(texsss("profile", "spectralon", "--plot", "curve.svg", "--json").stdout)
    drawn = (tmp_path / "curve.svg").read_text()
    assert "<!-- distance along the surface r [mm] -->" in drawn and "R(r) [1/mm²]" in drawn
    for total, within, free in zip(found["total"], found["radius_mm"]["0.99"], found["mean_free_path_mm"]):
        assert f"total {total:.3f}, 99 % within {within:.3g} mm," in drawn
        assert f"<!-- mean free path {free:.3g} mm, diffusion length without end -->" in drawn


def test_inspect_tells_what_to_do(texsss, cube):
    done = texsss("inspect", cube, "--unit-mm", 1000, "--size", 64)
    assert done.returncode == 0, done.stderr
    assert "radius_texels" in done.stdout and "raise the size" in done.stdout
    assert "too narrow to be seen; raise --size" in done.stdout


@pytest.mark.parametrize(
    "radius, texel, words",
    [
        (0.3, 1.0, ["kernel = 0.3 texels", "raise --size to 8192", "0.3 % of head", "state --unit-mm"]),
        (40.0, 1.0, ["kernel = 40 texels", "nothing to do", "40 % of head", "denser --material"]),
        (20.0, 0.1, ["kernel = 2e+02 texels", "--size 512 would do", "20 % of head"]),
        (300.0, 1.0, ["3 times head", "100 mm tall", "check --unit-mm"]),
    ],
)
def test_kernel_in_texels_and_of_the_object(radius, texel, words):
    said = kernel(radius, texel, 100.0, "head", 1024)
    assert len(said) == 2 and all(word in " ".join(said) for word in words)


@pytest.mark.parametrize("radius", [0.0, float("nan")])
def test_media_that_return_nothing_have_no_kernel(radius):
    (said,) = kernel(radius, 1.0, 100.0, "head", 1024)
    assert "no light comes back" in said and "sigma_s" in said


def test_inspect_tells_media_that_return_nothing(texsss, tmp_path, cube):
    medium = {"sigma_a_per_mm": 1.0, "sigma_s_per_mm": 0.0}
    scene = {"mesh": {"source": str(cube), "unit_mm": 10}, "media": {"ink": medium}, "material": "ink"}
    (tmp_path / "scene.json").write_text(json.dumps(scene | {"atlas": {"size": 32}}))
    done = texsss("inspect", "scene.json")
    assert done.returncode == 0, done.stderr
    assert "no light comes back" in done.stdout and "99 %" not in done.stdout


def test_every_fault_comes_with_its_remedy(texsss, tmp_path):
    """A cube turned inside out; then with flat, outside, missing, crowded and turned faces."""
    rows = CUBE_OBJ.split("f ", 1)[0] + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 3\n"
    faces = [[1, 4, 3, 2], [5, 6, 7, 8], [1, 2, 6, 5], [3, 4, 8, 7], [2, 3, 7, 6], [1, 5, 8, 4]]
    inward = [face[::-1] for face in faces]
    mesh = tmp_path / "cube.obj"
    lines = ["f " + " ".join(f"{v}/{k + 1}" for k, v in enumerate(face)) for face in inward]
    mesh.write_text(rows + "\n".join(lines))
    found = json.loads(texsss("inspect", mesh, "--unit-mm", 10, "--size", 64, "--json").stdout)
    assert any("lie partly under others" in said and "--uv" in said for said in found["faults"])
    assert any("1 of 1 closed parts" in said and "Recalculate Outside" in said for said in found["advice"])
    lines[0] = "f 1/1 4/1 3/1 2/1"  # flat in uv, and turned against the others
    lines[1] = lines[1].replace("/1", "/5")  # out of the square
    lines = [*lines[:5], "f 1/1 2/2 7/3"]  # a hole, and three faces on an edge
    mesh.write_text(rows + "\n".join(lines))
    said = " ".join(
        json.loads(texsss("inspect", mesh, "--unit-mm", 10, "--size", 64, "--json").stdout)["faults"]
    )
    for words in ("leave the unit square", "no area in uv", "Open edges", "more than two", "turn against"):
        assert words in said, words


def test_inspect_unwraps_anew_on_request(texsss, cube, tmp_path):
    options = ("--unit-mm", 10, "--size", 64, "--picture", tmp_path / "uv.png")
    done = texsss("inspect", cube, "--uv", "fallback", "--json", *options)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["atlas"]["origin"] == "fallback" and len(found["kernel"]) == 2 and found["uv"] is None
    assert "uv.png shows those that light gets (fallback), as cube has no" in found["picture"]
    with Image.open(tmp_path / "uv.png") as picture:  # enlarged, with its legend below
        assert picture.width == 512 and picture.height > 512


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
