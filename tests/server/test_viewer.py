"""What viewers of their own need: geometry, lights and camera, maps, linear halves, drafts on one atlas."""

import io
import json
import math

import httpx
import numpy as np
import pytest
from serving import problem

from texsss.media.fresnel import F_dt

NPY = {"accept": "application/x-npy"}


def document(glb: bytes) -> dict:
    length = int.from_bytes(glb[12:16], "little")
    return json.loads(glb[20 : 20 + length])


def test_geometry_is_a_glb_without_textures(client, small):
    answer = client.post("/v1/geometry", json=small)
    assert answer.headers["content-type"] == "model/gltf-binary" and answer.content[:4] == b"glTF"
    found = document(answer.content)
    assert {"POSITION", "NORMAL", "TEXCOORD_0"} <= set(found["meshes"][0]["primitives"][0]["attributes"])
    assert not {"images", "materials", "textures"} & set(found)
    again = client.post("/v1/geometry", json=small, headers={"if-none-match": answer.headers["etag"]})
    assert again.status_code == 304


def test_showing_places_lights_and_camera(client, small):
    shown = client.post("/v1/showing", json=small | {"lights": [{"type": "studio", "intensity": 2.0}]}).json()
    low, high = np.array(shown["mesh"]["box_mm"])
    centre, diagonal = (low + high) / 2, np.linalg.norm(high - low)
    assert [light["type"] for light in shown["lights"]] == ["point"] * 3
    key = shown["lights"][0]
    offset = np.array(key["position_mm"]) - centre
    assert np.linalg.norm(offset) == pytest.approx(2 * diagonal, rel=1e-5)
    # the key gives π W/m² per unit of intensity at the centre
    arrives = key["intensity_w_per_sr"][0] / (2 * diagonal / 1000) ** 2
    assert arrives == pytest.approx(2 * math.pi, rel=1e-5)
    assert shown["eta"] == 1.3 and shown["transmittance"] == pytest.approx(F_dt(1.3))
    assert np.isfinite(shown["camera"]["position_mm"]).all()


def test_geometry_is_named_by_mesh_and_atlas_alone(client, small):
    def name(**changes) -> str:
        return client.post("/v1/showing", json=small | changes).json()["geometry"]

    other_light = [{"type": "directional", "direction": [1, 0, 0]}]
    assert name() == name(lights=other_light, material="marble") == name(atlas={"size": 64, "raster": 32})
    assert name() != name(atlas={"size": 80})


def test_drafts_lie_on_the_atlas_of_the_final(client, small):
    """Charts made for the size of the draft would not fit the geometry."""
    scene = small | {"atlas": {"size": 256, "uv": "xatlas"}}
    draft = scene | {"atlas": scene["atlas"] | {"raster": 64}}
    fine, coarse = (_image(client, one, "position") for one in (scene, draft))
    assert fine.shape == (256, 256, 3) and coarse.shape == (64, 64, 3)
    covered = _image(client, draft, "coverage")[..., 0] > 0
    apart = np.linalg.norm(fine[2::4, 2::4] - coarse, axis=-1)[covered]
    texel = client.post("/v1/showing", json=draft).json()["atlas"]["texel_mm"]
    assert np.median(apart) < texel  # measured .5; of other charts tens


def _image(client: httpx.Client, scene: dict, name: str) -> np.ndarray:
    answer = client.post("/v1/render", params={"image": name}, json=scene, headers=NPY)
    assert answer.status_code == 200, answer.text
    return np.load(io.BytesIO(answer.content)).astype(np.float32)


def test_halves_are_the_linear_values(client, small):
    half = client.post("/v1/render?image=diffused", json=small, headers=NPY)
    assert half.headers["content-type"] == "application/x-npy"
    full = client.post("/v1/render?image=diffused", json=small, headers={"accept": "application/x-npz"})
    halves = np.load(io.BytesIO(half.content))
    assert halves.dtype == np.float16
    np.testing.assert_allclose(halves, np.load(io.BytesIO(full.content))["image"], rtol=1e-3, atol=1e-6)


def test_exitance_is_diffused_times_albedo(client):
    scene = {"atlas": {"size": 64}, "camera": {"resolution": [8, 8], "samples": 1}}
    made = {name: _image(client, scene, name) for name in ("diffused", "exitance", "albedo", "coverage")}
    on = made["coverage"][..., 0] > 0
    np.testing.assert_allclose(made["exitance"][on], (made["diffused"] * made["albedo"])[on], atol=6e-3)


def test_thickness_of_layers(client, small):
    layers = [{"medium": "skin1", "thickness_mm": 0.25}, {"medium": "marble"}]
    scene = small | {"material": {"layers": layers}}
    assert np.all(_image(client, scene, "thickness-1") == 0.25)
    assert np.all(_image(client, scene, "thickness-2") == 0)
    problem(client.post("/v1/render?image=thickness-3", json=scene), 422, "invalid-parameters")


def test_single_scattering_alone_needs_the_march(client, small):
    plain = small | {"methods": {"single_scattering": "none"}}
    problem(client.post("/v1/render?image=single", json=plain), 422, "invalid-parameters")
    single = _image(client, small, "single")
    assert single.shape == (48, 64, 3) and single.max() > 0
    whole = _image(client, small, "picture")
    assert (single <= whole + 1e-2).mean() > 0.99


def test_maps_come_by_their_name(client):
    answer = client.post("/v1/map?name=albedo", json={}, headers={"accept": "image/png"})
    assert answer.content.startswith(b"\x89PNG")
    body = problem(client.post("/v1/map?name=nope", json={}), 422, "invalid-parameters")
    assert body["errors"][0]["pointer"] == "/maps"


def test_raster_has_the_limits_of_the_atlas(client):
    body = problem(
        client.post("/v1/render", json={"atlas": {"size": 64, "raster": 4096}}), 422, "invalid-parameters"
    )
    assert body["errors"][0]["pointer"] == "/atlas/raster"
