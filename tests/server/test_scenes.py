"""Scenes in, images, models and numbers out."""

import io
import json
import threading
import time
import zipfile

import httpx
import numpy as np
import OpenEXR
import pytest
from PIL import Image
from serving import problem


def render(client, scene, accept="image/png", **params) -> httpx.Response:
    return client.post("/v1/render", json=scene, params=params, headers={"accept": accept})


@pytest.mark.parametrize(
    "accept, kind", [("image/png", "PNG"), ("image/jpeg", "JPEG"), ("image/webp", "WEBP")]
)
def test_pictures_for_display(client, small, accept, kind):
    response = render(client, small, accept)
    assert response.status_code == 200 and response.headers["content-type"] == accept
    picture = Image.open(io.BytesIO(response.content))
    assert picture.format == kind and picture.size == (64, 48)
    assert np.asarray(picture.convert("L")).std() > 5  # something is to be seen


def test_linear_images(client, small):
    found = OpenEXR.File(io.BytesIO(render(client, small, "image/x-exr").content)).channels()
    exr = found["RGB"].pixels.astype(np.float32)
    npz = np.load(io.BytesIO(render(client, small, "application/x-npz").content))["image"]
    assert npz.shape == (48, 64, 3) and npz.dtype == np.float32
    np.testing.assert_allclose(exr, npz, rtol=1e-3, atol=1e-4)  # half floats: 2⁻¹¹


@pytest.mark.parametrize(
    "name, channels",
    [
        *(("irradiance", 3), ("exitance", 3), ("radiance", 3), ("coverage", 1), ("albedo", 3)),
        *(("position", 3), ("normal", 3), ("texel-mm", 1), ("gaussian-1", 3), ("weight-8", 3)),
        *(("diffused", 3), ("metric", 3), ("through-mm", 1), ("seam-jump", 1), ("thickness-1", 1)),
    ],
)
def test_intermediate_images(client, small, name, channels):
    response = render(client, small, "application/x-npz", image=name)
    image = np.load(io.BytesIO(response.content))["image"]
    assert image.shape == (64, 64, channels) and np.isfinite(image).all()
    shown = render(client, small, "image/jpeg", image=name)
    assert Image.open(io.BytesIO(shown.content)).size == (64, 64)


def test_images_of_data_say_what_black_and_white_are(client, small):
    linear, seen = (
        render(client, small, kind, image="texel-mm") for kind in ("application/x-npz", "image/png")
    )
    values = np.load(io.BytesIO(linear.content))["image"]
    with Image.open(io.BytesIO(seen.content)) as shown:
        black, white = (float(shown.info[name]) for name in ("black", "white"))
        assert shown.info["unit"] == "mm" and "mm; values from" in shown.info["Description"]
        levels = np.asarray(shown)[..., None] / 255
    np.testing.assert_allclose(levels, ((values - black) / (white - black)).clip(0, 1), atol=0.5 / 255 + 1e-6)


def test_more_gaussians_than_there_are(client, small):
    body = problem(render(client, small, image="gaussian-32"), 422, "invalid-parameters")
    assert "methods.terms" in body["detail"]


def test_the_default_scene_renders(client):
    response = client.post("/v1/render?quality=draft", json={}, headers={"accept": "image/jpeg"})
    assert response.status_code == 200
    width, height = Image.open(io.BytesIO(response.content)).size
    assert width * height <= 320 * 240 * 1.01


def test_accept_chooses_by_quality(client, small):
    response = render(client, small, "image/png;q=0.5, image/jpeg;q=0.9, */*;q=0.1")
    assert response.headers["content-type"] == "image/jpeg"
    assert render(client, small, "*/*").headers["content-type"] == "image/png"


def test_same_request_is_the_same_answer(client, small):
    """Strong ETag of scene, options, format and version; 304 when it is named."""
    first, again = render(client, small), render(client, small)
    assert first.content == again.content and first.headers["etag"] == again.headers["etag"]
    assert first.headers["cache-control"].startswith("private, max-age=")
    assert first.headers["vary"] == "Accept"
    tag = first.headers["etag"]
    assert tag.startswith('"') and tag != render(client, small, "image/jpeg").headers["etag"]
    assert tag != render(client, small | {"seed": 7}).headers["etag"]
    unchanged = client.post("/v1/render", json=small, headers={"if-none-match": f'"x", {tag}'})
    assert unchanged.status_code == 304 and not unchanged.content
    assert unchanged.headers["etag"] == tag and unchanged.headers["vary"] == "Accept"


def test_a_slider_costs_what_it_changes(client, small):
    """A material of the same index makes weights, exitance and its march; a light edit makes no texels."""
    small = small | {"seed": 41}  # no answer that is kept: its stages are the last that were used
    render(client, small)
    other = client.post("/v1/render", json=small | {"material": {"layers": [{"medium": "skin2"}]}})
    ran = {part.split(";")[0].strip() for part in other.headers["server-timing"].split(",")}
    assert ran <= {"weights", "exitance", "planes", "picture"}, ran
    lamp = {"type": "directional", "direction": [0, 1, 1]}
    lit = client.post("/v1/render", json=small | {"lights": [lamp]})
    assert not {"mesh", "atlas", "texels", "weights"} & {
        part.split(";")[0].strip() for part in lit.headers["server-timing"].split(",")
    }


def test_bakes(client, small):
    model = client.post("/v1/bake", json=small)
    assert model.headers["content-type"] == "model/gltf-binary" and model.content[:4] == b"glTF"
    bundle = client.post("/v1/bake", json=small, headers={"accept": "application/zip"})
    with zipfile.ZipFile(io.BytesIO(bundle.content)) as files:
        assert {"irradiance.exr", "radiance.exr", "model.glb", "report.json"} <= set(files.namelist())
        assert "seconds" not in json.loads(files.read("report.json"))


def test_scenes_that_are_equal_give_equal_bundles(client, small):
    """Whatever the order of what they name: they share an ETag."""
    media = {
        "a": {"sigma_a_per_mm": 0.1, "sigma_s_per_mm": 1},
        "b": {"sigma_a_per_mm": 0.2, "sigma_s_per_mm": 2},
    }
    first, second = (
        client.post("/v1/bake", json=small | {"media": named}, headers={"accept": "application/zip"})
        for named in (media, dict(reversed(media.items())))
    )
    assert first.headers["etag"] == second.headers["etag"] and first.content == second.content


def test_data_of_one_value_is_seen(client, small):
    """Coverage 1 all over is white, not black."""
    one = {
        "maps": {},
        "material": {"layers": [{"medium": "skin1", "thickness_mm": 0.25}, {"medium": "skin2"}]},
    }
    asked = client.post("/v1/render", json=small | one, params={"image": "thickness-1"})
    pixels = np.asarray(Image.open(io.BytesIO(asked.content)))
    assert asked.status_code == 200 and pixels.max() > 60


def test_profile_in_units(client, small):
    found = client.post("/v1/profile", json=small).json()
    assert len(found["r_mm"]) == len(found["reflectance_per_mm2"])
    r, value = np.array(found["r_mm"]), np.array(found["reflectance_per_mm2"])
    total = 2 * np.pi * np.trapezoid(r[:, None] * value, r, axis=0)
    # the curve ends where 1 % of the widest channel is left; measured 0.990, 1.000, 1.000
    np.testing.assert_allclose(total, found["total"], rtol=0.02)
    assert found["mean_free_path_mm"][0] == pytest.approx(1 / (0.032 + 0.74))
    # the profile's own, beside what eight Gaussians make of it: 13.2, 7.22, 4.02 mm
    assert found["radius_mm"]["0.99"] == pytest.approx([14.63, 7.14, 3.95], rel=0.01)
    assert np.array(found["gaussians"]["reflectance_per_mm2"]).shape == value.shape


def test_inspect_gives_advice(client, small):
    found = client.post("/v1/inspect", json=small).json()
    assert found["mesh"]["faces"] == 2 * 24 * 12 and found["uv"]["serves"] is True
    assert found["scale"]["texel_mm"] > 0
    coarse = small | {"mesh": small["mesh"] | {"unit_mm": 100.0}}
    advice = client.post("/v1/inspect", json=coarse).json()["advice"]
    assert any("unit of the mesh" in sentence for sentence in advice)


def test_catalogue(client):
    presets = {one["name"]: one for one in client.get("/v1/presets").json()}
    assert presets["skin1"]["sigma_a_per_mm"] == pytest.approx([0.032, 0.17, 0.48])
    schema = client.get("/v1/schema").json()
    assert "path" not in schema["$defs"]["Source"]["properties"]
    for scene in client.get("/v1/scenes").json():
        assert "path" not in json.dumps(scene["scene"])


def test_examples_of_the_openapi_work_when_pasted(client):
    document = client.get("/openapi.json").json()
    body = document["paths"]["/v1/render"]["post"]["requestBody"]["content"]["application/json"]
    for name, example in body["examples"].items():
        response = client.post("/v1/render?quality=draft", json=example["value"])
        assert response.status_code == 200, (name, response.text)


def test_drafts_supersede_older_drafts_of_the_same_client(server, small):
    """Of five drafts at once, one client gets the last; the others hear that it is newer."""
    statuses: dict[int, int] = {}

    def ask(number: int) -> None:
        scene = small | {"seed": 100 + number, "atlas": {"size": 512}}
        with server.client() as own:
            answer = own.post("/v1/render?quality=draft", json=scene, headers={"x-client-id": "me"})
            statuses[number] = answer.status_code
            if answer.status_code != 200:
                problem(answer, 409, "superseded")

    threads = [threading.Thread(target=ask, args=(n,)) for n in range(5)]
    for thread in threads:
        time.sleep(0.5 if thread is threads[-1] else 0.03)  # the last arrives last on a busy machine, too
        thread.start()
    for thread in threads:
        thread.join()
    assert statuses[4] == 200 and 409 in statuses.values()


def test_client_that_leaves_stops_its_work(server, small):
    """The render thread is free again long before the abandoned picture would be done."""
    slow = small | {"atlas": {"size": 2048}, "camera": {"resolution": [1600, 1200], "samples": 16}}
    with server.client() as client:
        with pytest.raises(httpx.ReadTimeout):
            client.post("/v1/render", json=slow | {"seed": 5}, timeout=0.3)
        start = time.monotonic()
        while "texsss_waiting 0.0" not in client.get("/metrics").text:
            time.sleep(0.05)
        assert client.post("/v1/render", json=small | {"seed": 6}).status_code == 200
        assert time.monotonic() - start < 8
        logged = server.log.read_text()
    assert '"status": 499' in logged
