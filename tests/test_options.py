"""Lights and maps in short, as options of every command."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from texsss.errors import DomainError
from texsss.options import described


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


def test_light_through_thin_parts_can_be_asked_for_and_refused(tmp_path):
    scene = described(Path("head.obj"), transmission=True)
    assert scene.methods.transmission
    (tmp_path / "scene.json").write_text(scene.model_dump_json())
    assert described(tmp_path / "scene.json").methods.transmission
    assert not described(tmp_path / "scene.json", transmission=False).methods.transmission


def test_the_angle_at_which_light_arrives_is_said_in_degrees():
    assert described(Path("head.obj"), incidence="normal").methods.arriving == "normal"
    assert described(Path("head.obj"), incidence="60").methods.arriving == pytest.approx(math.pi / 3)
    with pytest.raises(
        DomainError, match=r"incidence.*'diffuse' or 'normal' or \{ \} with angle_deg, got 'up'"
    ):
        described(Path("head.obj"), incidence="up")
