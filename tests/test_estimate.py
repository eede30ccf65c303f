"""What a bake is expected to cost: no where it would be refused, more where more is asked."""

import json
from pathlib import Path

import pytest
import torch
from charted_shapes import sheet, soup

from texsss.baker import Baker
from texsss.errors import DomainError
from texsss.estimate import estimate
from texsss.pipeline import Run
from texsss.scene import Scene
from texsss.surface.mesh import Mesh


def obj(path: Path, mesh: Mesh, move: float = 0.0) -> str:
    """Writes the mesh with a uv per corner, v up, moved along u."""
    rows = ["v " + " ".join(f"{x:.6g}" for x in vertex) for vertex in mesh.vertices.tolist()]
    rows += [f"vt {u + move:.6g} {1 - v:.6g}" for u, v in mesh.source_uv.reshape(-1, 2).tolist()]
    for k, face in enumerate(mesh.faces.tolist()):
        rows.append("f " + " ".join(f"{vertex + 1}/{3 * k + c + 1}" for c, vertex in enumerate(face)))
    path.write_text("\n".join(rows))
    return str(path)


def expected(**scene) -> float:
    return estimate(Run(Baker().cache, Scene.parse(scene))).seconds


def test_no_where_the_bake_would_refuse(tmp_path):
    """Too small a square for its parts; coordinates that are insisted on and lie outside."""
    many = {"source": obj(tmp_path / "soup.obj", soup(0, 300)), "unit_mm": 1}
    outside = {"source": obj(tmp_path / "sheet.obj", sheet(4), move=3.0), "unit_mm": 1}
    for mesh, atlas, words in (
        (many, {"size": 16, "uv": "xatlas"}, r"raise atlas.size"),
        (outside, {"size": 64, "uv": "source"}, "leave the unit square"),
    ):
        scene = Scene.parse({"mesh": mesh, "atlas": atlas})
        with pytest.raises(DomainError, match=words) as told:
            Baker().estimate(scene)
        with pytest.raises(DomainError) as baked:
            Baker().bake(scene)
        assert str(told.value) == str(baked.value)


def test_more_costs_more(tmp_path):
    mesh = {"source": obj(tmp_path / "sheet.obj", sheet(4)), "unit_mm": 10}
    sky = {"type": "environment", "radiance": [1, 1, 1]}
    plain = {"mesh": mesh, "lights": [sky]}
    base = expected(**plain)
    assert expected(**plain | {"lights": [sky | {"samples": 65536}]}) > 10 * base
    through = {method: {"transmission": True, "diffusion": method} for method in ("uv", "surface")}
    without = {method: {"diffusion": method} for method in through}
    more = {
        m: expected(**plain | {"methods": through[m]}) - expected(**plain | {"methods": without[m]})
        for m in through
    }
    # over the surface, light is blurred by its side, too
    assert more["surface"] > more["uv"] > 0
    assert expected(**plain | {"methods": {"interreflection": 2}}) > base
    marched = expected(**plain | {"methods": {"single_scattering": "exact"}})
    assert (
        expected(**plain | {"methods": {"single_scattering": "exact", "march_samples": 64}}) > marched > base
    )
    lamp = {"lights": [{"type": "point", "position_mm": [0, 0, 900]}]}  # which is marched unasked
    lit, unmarched = (
        expected(**plain | lamp | {"methods": {"single_scattering": x}}) for x in ("auto", "none")
    )
    assert lit > unmarched


def test_a_spot_is_no_wider_within_than_without():
    spot = {"type": "spot", "position_mm": [0, 0, 9], "direction": [0, 0, -1], "inner_deg": 40.0}
    with pytest.raises(DomainError, match=r"inner_deg up to outer_deg, got 40 and 25"):
        Scene.parse({"mesh": "x.obj", "lights": [spot]})


def test_panoramas_by_option_are_decoded_as_pictures(tmp_path):
    """An 8-bit picture is not light as it is; floats are, whatever is said of them."""
    from texsss.io.exr import write_exr
    from texsss.io.images import write_png
    from texsss.options import described

    grey = torch.full((4, 8, 3), 0.5)
    write_png(tmp_path / "sky.png", grey)
    write_exr(tmp_path / "sky.exr", grey)
    for name, value in (("sky.png", 0.2159), ("sky.exr", 0.5)):
        scene = described(None, env=tmp_path / name)
        assert float(Baker().map(scene, "environment").mean()) == pytest.approx(value, rel=1e-3)
        assert json.loads(scene.to_json())["lights"][0]["map"] == "environment"
