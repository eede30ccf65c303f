"""`texsss inspect`: kernels in texels, faults and their remedies."""

import json

import pytest
from obj_files import CUBE_OBJ
from PIL import Image

from texsss.inspection import kernel


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
