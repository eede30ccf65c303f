"""The same scene by several methods: numbers with known answers, files all or none, answers to bad input."""

import json

import pytest
import torch
from PIL import Image
from test_methods import plain

from texsss.baker import Baker
from texsss.compare import FILES, asked, compare
from texsss.errors import AssetError, Cancelled, DomainError
from texsss.io.sheet import COOL, WARM, difference_map, sheet


def test_a_method_equals_itself_and_others_differ(small):
    found = compare(plain(small), ("none", "uv", "surface"), reference="surface")
    rows = {row.method: row for row in found.rows}
    assert rows["surface"].rmse == 0.0 and rows["surface"].psnr is None and rows["surface"].mean == 1.0
    assert 0 < rows["uv"].rmse < rows["none"].rmse
    assert rows["uv"].psnr > rows["none"].psnr > 10
    seen = found.pictures[2].sum(-1) > 0
    difference = (found.pictures[1] - found.pictures[2])[seen].double()
    expected = difference.square().mean().sqrt() / found.pictures[2][seen].double().square().mean().sqrt()
    assert rows["uv"].rmse == pytest.approx(float(expected), rel=0.02)


def test_methods_are_what_they_say(small):
    scene = plain(small, rule="entry")
    assert asked(scene, "octree+through").methods.transmission
    assert asked(scene, "march-exact").methods.single_scattering == "exact"
    assert asked(scene, "march-uniform").methods.diffusion == "surface"
    assert asked(scene, "uv").methods.rule == "entry"
    with pytest.raises(DomainError, match="names none"):
        asked(scene, "parallax")


@pytest.mark.parametrize("march", ["march-exact", "march-uniform+through"])
def test_a_march_beside_a_total_is_refused_before_anything_is_baked(small, march, monkeypatch):
    """As in a scene: the profile holds what is marched."""
    monkeypatch.setattr(Baker, "bake", lambda *_, **__: pytest.fail("baked"))
    with pytest.raises(DomainError, match=f"{march[:11]}.*'multipole'.*leave"):
        compare(plain(small, profile="multipole"), ("surface", march))


def test_all_are_lit_alike(small):
    """One method that knows no light from other parts has all do without; operators are nobody's seconds."""
    scene = plain(small, interreflection=1, octree={"spacing_mm": 3.0})
    found = compare(scene, ("octree", "surface"))
    without = compare(plain(small, octree={"spacing_mm": 3.0}), ("surface",))
    torch.testing.assert_close(found.pictures[1], without.pictures[0])
    assert found.alone and "send each other" in found.markdown() and not without.alone
    assert found.operators_s > 0 and "Operators of the surface" in found.markdown()
    assert not compare(scene, ("uv", "none")).alone


def test_files_are_a_table_numbers_and_a_sheet(small, tmp_path):
    found = compare(plain(small, octree={"spacing_mm": 3.0}), ("octree", "surface+through", "poisson"))
    assert found.reference == "octree"
    written = found.save(tmp_path / "out")
    assert (
        {path.name for path in written.values()}
        == set(FILES)
        == {p.name for p in (tmp_path / "out").iterdir()}
    )
    numbers = json.loads(written["compare.json"].read_text())
    assert [row["method"] for row in numbers["methods"]] == ["octree", "surface+through", "poisson"]
    assert written["compare.md"].read_text().count("\n| ") == 4
    with Image.open(written["compare.png"]) as picture:
        assert picture.size[0] > 3 * 64 and picture.size[1] > 2 * 48
        below = picture.convert("RGB").crop((0, picture.height - 40, picture.width, picture.height))
        shown = {colour for _, colour in below.getcolors(1 << 16) or []}
    for colour in (WARM, COOL):
        assert tuple(round(255 * part) for part in colour) in shown, (
            "a legend says what is brighter and darker"
        )
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "compare.md").mkdir()
    with pytest.raises(AssetError, match="folder at"):
        found.save(tmp_path / "taken")
    assert [p.name for p in (tmp_path / "taken").iterdir()] == ["compare.md"]


def test_it_can_be_stopped_and_says_where_it_is(small):
    heard = []
    with pytest.raises(Cancelled):
        compare(
            plain(small),
            ("uv", "none"),
            progress=lambda s, _: heard.append(s),
            cancel=lambda: "bank" in heard,
        )
    assert "light" in heard


def test_bad_names_are_answered(small):
    scene = plain(small)
    with pytest.raises(DomainError, match="octree"):
        compare(scene, ("dipole",))
    with pytest.raises(DomainError, match="twice"):
        compare(scene, ("uv", "uv"))
    with pytest.raises(DomainError, match="none"):
        compare(scene, ())
    with pytest.raises(DomainError, match="reference"):
        compare(scene, ("uv",), reference="octree")


def test_the_shared_part_is_made_once(small):
    heard, baker = [], Baker()
    compare(plain(small), ("uv", "none"), baker=baker, progress=lambda s, share: heard.append((s, share)))
    assert [share for name, share in heard if name == "atlas"].count(0.0) >= 1
    assert baker.bake(asked(plain(small), "uv")).report["seconds"] == {}


def test_differences_show_their_sign():
    up, down = torch.full((2, 2, 3), 0.1), torch.full((2, 2, 3), -0.1)
    warm, cool = difference_map(up, 0.1)[0, 0], difference_map(down, 0.1)[0, 0]
    assert warm[0] > 0.9 > warm[2] and cool[2] > 0.9 > cool[0]
    assert float(difference_map(torch.zeros(1, 1, 3), 0.1).std()) < 1e-6


def test_a_sheet_has_panels_of_one_size():
    picture = torch.rand(30, 40, 3, generator=torch.Generator().manual_seed(0))
    made = sheet([[("a", "", picture), ("b", "", picture), ("c", "", picture)]], columns=2)
    assert made.shape[1] == 2 * 46 + 6
    torch.testing.assert_close(made[-36:-6, 6:46], (picture * 255 + 0.5).byte().float() / 255)
    with pytest.raises(ValueError, match="one size"):
        sheet([[("a", "", picture), ("b", "", picture[:-1])]], columns=2)


def test_the_command_compares(texsss, cube, tmp_path):
    out = tmp_path / "found"
    done = texsss(
        "compare", cube, "--material", "skin1", "--unit-mm", 10, "--size", 64, "--out", out,
        "--method", "none", "--method", "poisson",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "| poisson |" in done.stdout and {p.name for p in out.iterdir()} == set(FILES)
    done = texsss("compare", cube, "--method", "magic", "--out", tmp_path / "not")
    assert done.returncode == 2 and "march-exact" in done.stderr and not (tmp_path / "not").exists()


@pytest.mark.parametrize(
    ("name", "file", "said"),
    [
        ("through-mm", "t.exr", "range through-mm: values from 20 to 20 mm"),
        ("metric", "m.png", "range metric: black is 0, white 1; values from "),
    ],
)
def test_the_command_maps(texsss, cube, tmp_path, name, file, said):
    done = texsss("map", cube, "--name", name, "--unit-mm", 10, "--size", 64, "--out", tmp_path / file)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / file).is_file() and said in done.stderr
    done = texsss("map", cube, "--name", "seams", "--unit-mm", 10, "--size", 64, "--out", tmp_path / "x.png")
    assert done.returncode == 2 and "seam-jump" in done.stderr and not (tmp_path / "x.png").exists()
    done = texsss("map", cube, "--name", "metric", "--out", tmp_path / "x.gif")
    assert done.returncode == 2 and ".exr" in done.stderr
