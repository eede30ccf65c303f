"""One schema: defaults everywhere, strict values, errors that name the field, migration."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texsss import scene as module
from texsss.errors import AssetError, DomainError, TexsssError
from texsss.material import MOST_PER_MM
from texsss.media.medium import MOST
from texsss.profiles.two_modes import ETA_MAX
from texsss.scene import GREATEST_ETA, Scene, migrate
from texsss.specs import Source


def test_empty_data_is_the_default_scene():
    assert Scene.parse({}) == Scene()


def test_json_round_trip(tmp_path):
    first = Scene(mesh="head.obj", material="marble")
    first.save(tmp_path / "scene.json")
    again = Scene.load(tmp_path / "scene.json")
    assert again.mesh.source.path == str(tmp_path / "head.obj"), "paths are relative to the file"
    assert again.material == first.material


def test_own_mesh_does_not_wear_the_default_albedo():
    assert Scene(mesh="head.obj").material.surface.albedo is None


def test_default_object_keeps_what_is_not_stated():
    scene = Scene.parse({"camera": {"resolution": [64, 48]}, "material": {"layers": [{"medium": "marble"}]}})
    assert scene.camera.resolution == (64, 48) and scene.camera.direction == Scene().camera.direction
    assert scene.material.layers[0].medium == "marble" and scene.material.surface.albedo == "albedo"


def test_a_source_that_is_stated_takes_the_place_of_the_default_objects():
    scene = Scene.parse({"maps": {"albedo": {"source": {"asset": "0" * 64}}}})
    assert scene.maps["albedo"].source.builtin is None and scene.maps["albedo"].space == "srgb"


@pytest.mark.parametrize(
    "data, names",
    [
        ({"methods": {"rule": "x"}}, ["methods.rule", "exit", "'x'"]),
        ({"atlas": {"size": 0}}, ["atlas.size", "16"]),
        ({"atlas": {"size": 10**6}}, ["atlas.size", "8192"]),
        ({"atlas": {"size": True}}, ["atlas.size", "integer"]),
        ({"mesh": {"source": "a.obj", "unit_mm": float("nan")}}, ["mesh.unit_mm", "finite"]),
        ({"mesh": {"source": "a.obj", "unit_mm": "2"}}, ["mesh.unit_mm"]),
        ({"lights": [{"type": "spotty"}]}, ["lights.0:", "point, spot", "'spotty'"]),
        ({"lights": [{"position_mm": [0, 0, 1]}]}, ["lights.0:", '"type"', "point, spot"]),
        ({"lights": ["point"]}, ["lights.0: expected { } with type"]),
        (
            {"lights": [{"type": "point", "position_mm": [0, 1]}]},
            ["lights.0.position_mm:", "3 values", "got 2"],
        ),
        ({"lights": [{"type": "studio"}] * 65}, ["at most 64", "got 65"]),
        ({"nonsense": 1}, ["nonsense: there is no field of this name."]),
        ({"matrial": "skin1"}, ["did you mean material."]),
        ({"material": {"surface": {"roughness": 1.5}}}, ["roughness: expected at most 1, got 1.5."]),
        (
            {"mesh": "a.obj", "material": {"surface": {"albedo": 0.5}}},
            ["albedo: expected the name of a map, got"],
        ),
        ({"maps": {"a": "x.png"}}, ["maps.a: expected { } with source, space, channel, got 'x.png'."]),
        (
            {"methods": {"incidence": 45}},
            ["incidence: expected 'diffuse' or 'normal' or { } with angle_deg, got 45."],
        ),
        ({"methods": {"incidence": {"angle_deg": 91}}}, ["angle_deg: expected at most 90, got 91."]),
        ({"material": {"layers": [{"thickness_mm": -1}]}}, ["thickness_mm: expected at least 0, got -1."]),
        (
            {"material": {"layers": [{"medium": {"mix": ["a"]}}]}},
            ["medium.mix: expected 2 values"],
        ),
        ({"version": 99}, ["version", "update"]),
        ({"mesh": {"source": {"path": "a", "builtin": "b"}}}, ["mesh.source", "exactly one"]),
        ({"mesh": "a.obj", "material": {"surface": {"albedo": "q"}}}, ["albedo", "'q'"]),
        ({"camera": {"fit": False}}, ["camera", "position_mm"]),
        ({"media": {"x": {"preset": "skin1", "sigma_a_per_mm": 1.0}}}, ["media.x"]),
        ({"material": {"layers": [{"thickness_mm": {"map": "v"}}]}}, ["layers.0", "range", "'v'", "[mm]"]),
        ({"media": {"x": {"sigma_a_per_mm": {"map": "v"}, "sigma_s_per_mm": 1.0}}}, ["range", "[1/mm]"]),
        (
            {"media": {"x": {"sigma_a_per_mm": 0.1, "sigma_s_per_mm": 1.0, "g": [0.1, 0.2, -1.0]}}},
            ["media.x.g.2: expected more than -1, got -1"],
        ),
        (
            {"material": {"layers": [{"thickness_mm": {"map": "v", "range": [2, 0]}}]}},
            ["layers.0", "thickness_mm to rise, got 2 to 0", "set invert"],
        ),
        (
            {"media": {"x": {"sigma_a_per_mm": {"map": "v", "range": [1, 0]}, "sigma_s_per_mm": 1.0}}},
            ["media.x", "sigma_a_per_mm to rise", "set invert"],
        ),
        (
            {"media": {"x": {"sigma_a_per_mm": {"map": "v", "range": [0, 1e7]}, "sigma_s_per_mm": 1.0}}},
            ["media.x", "1e+06 at most, got 1e+07", "unit"],
        ),
        (
            {"media": {"x": {"sigma_a_per_mm": 0.1, "sigma_s_per_mm": 1e7}}},
            ["media.x.sigma_s_per_mm", "expected at most 1"],
        ),
        (
            {"media": {"x": {"sigma_a_per_mm": [0.1, 2e6, 0.1], "sigma_s_per_mm": 1.0}}},
            ["media.x.sigma_a_per_mm.1", "expected at most 1"],
        ),
        (
            {"material": {"layers": [{"medium": "skin1"}, {"medium": "marble", "thickness_mm": 1.0}]}},
            ["material", "thickness_mm of layers.0", "only the last of 2 layers"],
        ),
        (
            {"methods": {"profile": "multipole", "single_scattering": "exact"}},
            ["methods: single_scattering: expected none", "'multipole'", "choose layered-sp3"],
        ),
    ],
)
def test_bad_field_is_named_in_one_sentence(data, names):
    with pytest.raises(DomainError) as caught:
        Scene.parse(data)
    message = str(caught.value)
    assert all(name in message for name in names), message
    assert "\n" not in message


def test_scenes_and_media_have_one_bound():
    assert MOST_PER_MM == MOST


@pytest.mark.parametrize("text", ["", "[]", "{", "{'a': 1}", "\x00", '"x"', "[" * 100000])
def test_malformed_files_get_one_sentence(tmp_path, text):
    path = tmp_path / "scene.json"
    path.write_text(text)
    with pytest.raises(AssetError, match=r"scene\.json"):
        Scene.load(path)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(AssetError, match="found none"):
        Scene.load(tmp_path / "no.json")


def test_older_scenes_are_migrated(monkeypatch):
    monkeypatch.setattr(module, "SCHEMA_VERSION", 2)
    monkeypatch.setattr(module, "MIGRATIONS", {1: lambda data: {"renamed": data["old"]}})
    assert migrate({"version": 1, "old": 3}) == {"version": 2, "renamed": 3}


def test_source_wants_exactly_one():
    with pytest.raises(ValueError, match="exactly one"):
        Source()


@settings(max_examples=50, deadline=None)
@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(),
        lambda c: (
            st.dictionaries(
                st.sampled_from(
                    [
                        "mesh",
                        "atlas",
                        "size",
                        "lights",
                        "type",
                        "material",
                        "layers",
                        "camera",
                        "version",
                        "path",
                    ]
                ),
                c,
            )
            | st.lists(c)
        ),
    )
)
def test_any_data_is_a_scene_or_a_sentence(data):
    try:
        Scene.parse(data if isinstance(data, dict) else {"mesh": data})
    except TexsssError as error:
        assert "\n" not in json.dumps(str(error))


def test_an_index_that_the_model_is_not_fitted_to_is_refused_before_anything_is_computed():
    """Of media that a layer has; `layered-diffusion` takes any."""
    glass = {"sigma_a_per_mm": 0.1, "sigma_s_per_mm": 1.0, "eta": 1.8}
    data = {"media": {"glass": glass}, "material": {"layers": [{"medium": "glass"}]}}
    with pytest.raises(DomainError, match=r"media\.glass\.eta: expected at most 1\.6.*got 1\.8; choose"):
        Scene.parse(data)
    mixed = {"layers": [{"medium": {"mix": ["skin1", "glass"], "mask": "m"}}]}
    with pytest.raises(DomainError, match=r"media\.glass\.eta"):
        Scene.parse(data | {"material": mixed, "maps": {"m": {"source": "m.png"}}})
    Scene.parse(data | {"methods": {"profile": "layered-diffusion"}})
    Scene.parse(data | {"material": "skin1"})
    assert GREATEST_ETA == {"layered-sp3": ETA_MAX}
