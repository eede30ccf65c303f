"""What people do: sliders, undo, links, comparisons, files; and that the camera stays meanwhile."""

import io
import time

import numpy as np
import pytest
from obj_files import torus_obj
from paging import METHODS, drop, pixels, pose, settle, state, until
from PIL import Image
from serving import OBJ

SLIDER = "#panel-material .card-body input[type=range]"


def two_layers(page):
    settle(page, lambda: page.get_by_role("button", name="Milk on ketchup").click())


def shown(page) -> np.ndarray:
    """What is on the object, at rest."""
    page.mouse.move(5, 5)
    return pixels(page)


def test_slider_gives_new_pixels_and_the_camera_stays(visit):
    page = visit()
    two_layers(page)
    before, stood, drafts = shown(page), pose(page), []
    page.on("request", lambda request: drafts.append(request.url) if "quality=draft" in request.url else None)
    slider = page.locator(SLIDER).first
    settle(page, lambda: slider.fill("900"))
    assert state(page)["layers"][0]["thickness_mm"] > 5
    assert pose(page) == stood
    assert np.abs(shown(page) - before).mean() > 0.5


def test_gloss_and_exposure_ask_the_service_for_nothing(visit):
    page = visit()
    asked = []
    page.on("request", lambda request: asked.append(request.url) if "/v1/render" in request.url else None)
    before = shown(page)
    page.get_by_label("Roughness", exact=True).fill("100")
    page.get_by_role("tab", name="Light").click()
    page.get_by_label("Exposure", exact=True).fill("700")
    page.wait_for_timeout(600)
    assert asked == []
    assert np.abs(shown(page) - before).mean() > 3


def test_undo_is_one_step_per_drag(visit):
    page = visit()
    two_layers(page)
    before, first = state(page), shown(page)
    page.locator(SLIDER).first.scroll_into_view_if_needed()
    box = page.locator(SLIDER).first.bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.4 * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.9 * box["width"], y, steps=12)
    settle(page, page.mouse.up)
    changed = state(page)
    assert changed["layers"][0]["thickness_mm"] != before["layers"][0]["thickness_mm"]
    settle(page, lambda: page.get_by_role("button", name="Undo").click())
    assert state(page) == before
    assert np.abs(shown(page) - first).max() <= 2
    settle(page, lambda: page.keyboard.press("Control+Shift+Z"))
    assert state(page) == changed


def test_the_address_holds_everything(visit):
    page = visit()
    two_layers(page)
    page.get_by_role("tab", name="Light").click()
    settle(page, lambda: page.get_by_role("button", name="From the side").click())
    page.locator("#view").press("ArrowLeft")
    was, stood, picture = state(page), pose(page), shown(page)
    other = again(page, visit)
    other.wait_for_timeout(300)
    assert state(other) == was
    np.testing.assert_allclose(pose(other)["position_mm"], stood["position_mm"], rtol=1e-6)
    assert np.abs(shown(other) - picture).max() <= 2


def test_compare_by_keyboard(visit):
    page = visit()
    whole = shown(page)
    page.locator("#view").press("c")
    page.wait_for_selector(".rmse:not(:empty)")
    divider = page.get_by_label("Where A ends and B begins")
    divider.focus()
    page.keyboard.press("End")
    assert divider.input_value() == "100"
    plain = shown(page)
    assert np.abs(plain - whole).max() > 12, "A does not spread light"
    page.keyboard.press("Home")
    assert np.abs(shown(page) - whole).max() <= 2, "B alone is the picture"
    percent = float(page.locator(".rmse").inner_text().split()[1])
    assert 2 < percent < 200
    page.get_by_role("button", name="Difference").click()
    assert np.abs(shown(page) - whole).mean() > 3


def test_a_pinned_setting_stays_while_the_rest_changes(visit, page_server, tmp_path):
    """With its colour map and its glass; a link keeps it, and how all of it is looked at."""
    page = visit()
    ramp = np.stack([np.tile(np.linspace(60, 250, 16), (16, 1))] * 2 + [np.full((16, 16), 90)], 2)
    Image.fromarray(ramp.astype(np.uint8)).save(tmp_path / "ramp.png")
    settle(page, lambda: drop(page, tmp_path / "ramp.png"))
    page.locator("#view").press("c")
    page.get_by_label("A is").select_option("pinned")
    page.get_by_label("Where A ends and B begins").fill("100")
    page.wait_for_selector(".rmse:not(:empty)")
    pinned = shown(page)
    said = "document.querySelector('.rmse').value"
    jade = page.get_by_role("button", name="Jade")
    stale = f"(jade) => {{ jade.click(); return {said} }}"
    was = []
    settle(page, lambda: was.append(page.evaluate(stale, jade.element_handle())))
    assert was == [""], "no figure while the light of one side is of before"
    page.wait_for_timeout(300)
    assert "albedo" not in state(page)["surface"] and np.abs(shown(page) - pinned).mean() < 0.5

    until(page, f"{said} !== ''")
    assert float(page.evaluate(said).split()[1]) == pytest.approx(percent(page, page_server), rel=0.02)

    other = again(page, visit)
    until(other, "texsss.compare.liveA.settles > 0 && texsss.viewer.looks.A.maps.albedo")
    until(other, "texsss.viewer.looks.A.eta !== texsss.viewer.looks.B.eta")
    assert np.abs(shown(other) - pinned).max() <= 2
    other.get_by_role("button", name="Difference").click()
    other.get_by_role("tab", name="Inside").click()
    other.get_by_role("button", name="Lay flat").click()
    other.get_by_role("button", name="Show seams").click()
    until(other, "texsss.viewer.surface.difference")
    picture = shown(other)
    third = again(other, visit)
    until(third, "texsss.viewer.surface.difference && texsss.viewer.looks.A.maps.albedo")
    assert np.abs(shown(third) - picture).max() <= 2


def percent(page, server) -> float:
    """RMSE of A and B as the service has the light that leaves, colour maps included [%]."""
    with server.client(accept="application/x-npy") as client:
        ask = lambda scene, image: client.post("/v1/render", params={"image": image}, json=scene).content  # noqa: E731
        a, b = (page.evaluate(f"texsss.{live}.wanted") for live in ("compare.liveA", "live"))
        held = ((a, "exitance"), (b, "exitance"), (b, "coverage"))
        of, to, there = (np.load(io.BytesIO(ask(*one))).astype(float) for one in held)
    there = there[..., 0] >= 0.5
    return 100 * np.sqrt(np.square(of - to)[there].mean()) / to[there].mean()


def again(page, visit):
    """Another visit by the link of one."""
    page.evaluate("texsss.address.write()")
    return visit(path=page.url[page.url.index("/#") :])


def test_a_mesh_of_ones_own(visit, tmp_path):
    page = visit()
    mesh = tmp_path / "other.obj"
    mesh.write_bytes(torus_obj(tube=30))
    drop(page, mesh)
    page.get_by_role("tab", name="Object").click()
    page.get_by_text("other", exact=True).wait_for()
    page.wait_for_selector("#badge[data-state=final]")
    assert "asset" in state(page)["mesh"]["source"]
    assert shown(page).std() > 10
    page.get_by_text("The mesh is here, ", exact=False).wait_for()
    # lamps stay around what is larger now, and as bright there
    page.evaluate("(lamp) => texsss.store.edit((s) => { s.mesh.unit_mm = 1; s.lights = [lamp]; })", LAMP)
    page.get_by_label("One unit of the file is in mm").fill("10")
    settle(page, lambda: page.get_by_label("One unit of the file is in mm").press("Enter"))
    lamp = state(page)["lights"][0]
    assert np.allclose(lamp["position_mm"], [10 * x for x in LAMP["position_mm"]])
    assert np.allclose(lamp["intensity_w_per_sr"], [100 * x for x in LAMP["intensity_w_per_sr"]])
    page.wait_for_timeout(400)
    page.reload()
    page.get_by_role("tab", name="Object").click()
    page.get_by_text("other", exact=True).wait_for()


LAMP = {"type": "point", "position_mm": [300, 150, 250], "intensity_w_per_sr": [0.8, 0.8, 0.8]}


def test_a_shared_mesh_with_its_colours(visit, shared_data):
    page = visit({"methods": METHODS, "atlas": {"size": 256}})
    settle(page, lambda: drop(page, shared_data / "meshes" / "spot_uv.obj"))
    first = shown(page)
    settle(page, lambda: drop(page, shared_data / "meshes" / "spot_texture.png"))
    page.wait_for_timeout(300)
    assert state(page)["surface"]["albedo"] == "spot_texture"
    assert np.abs(shown(page) - first).mean() > 1


def test_a_bad_file_is_told(visit, tmp_path):
    page = visit()
    before = state(page)
    bad = tmp_path / "empty.obj"
    bad.write_text("# nothing\n")
    drop(page, bad)
    alert = page.get_by_role("alert").filter(has_text="mesh")
    alert.wait_for()
    assert "empty.obj: expected OBJ, PLY, STL" in alert.inner_text()
    assert state(page) == before
    page.said.clear()  # the browser logs every 4xx as an error


def test_problems_stand_at_their_fields(visit):
    page = visit()
    two_layers(page)
    page.route("**/v1/render*", lambda route: route.fulfill(status=422, json=PROBLEM, headers=TYPE))
    page.get_by_label("Thickness in mm").fill("3")
    page.get_by_label("Thickness in mm").press("Enter")
    page.get_by_role("alert").wait_for()
    field = page.get_by_label("Thickness in mm")
    assert field.get_attribute("aria-invalid") == "true"
    assert page.locator(".field-problem").inner_text() == "Expected less."
    page.unroute("**/v1/render*")
    settle(page, lambda: (field.fill("2"), field.press("Enter")))
    assert field.get_attribute("aria-invalid") is None
    page.said.clear()


def test_long_work_is_cancelled(visit, page_server):
    """On a mesh of its own: what the service has kept is no work."""
    with page_server.client(**OBJ) as client:
        asset = client.post("/v1/assets", params={"name": "own.obj"}, content=torus_obj(tube=22)).json()[
            "asset"
        ]
    page, told = visit({"mesh": {"source": {"asset": asset}, "unit_mm": 1.0}}), []
    page.on("request", lambda one: told.append(one.url) if one.method == "DELETE" else None)
    at_once = {"prefer": "respond-async"}  # however little time it takes
    page.route("**/v1/geometry", lambda route: route.continue_(headers=route.request.headers | at_once))
    page.route("**/v1/jobs/*/events", lambda route: None)  # it never says that it is done
    page.get_by_role("tab", name="Object").click()
    with page.expect_request("**/v1/jobs/*/events"):  # the job is known
        page.get_by_label("Light map", exact=True).select_option("256")
    page.get_by_role("button", name="Cancel").click()
    page.locator("#badge[data-state=stopped]").wait_for()
    assert page.locator(".progress").is_hidden()
    deadline = time.monotonic() + 10
    while not told and time.monotonic() < deadline:
        page.wait_for_timeout(50)
    assert len(told) == 1 and "/v1/jobs/" in told[0]
    page.unroute_all()
    settle(page, lambda: page.get_by_role("button", name="Undo").click())


def test_pictures_and_turns(visit):
    """Screenshot and turntable, by their keys; the material in use is marked."""
    page = visit()
    with page.expect_download() as download:
        page.locator("#view").press("s")
    assert download.value.suggested_filename == "ring.png"
    with Image.open(download.value.path()) as picture:
        assert np.asarray(picture).std() > 10
    stood = pose(page)
    page.locator("#view").press("t")
    page.wait_for_timeout(300)
    page.locator("#view").press("t")
    turned = pose(page)
    assert turned["target_mm"] == stood["target_mm"] and turned["position_mm"] != stood["position_mm"]
    assert turned["position_mm"][1] == pytest.approx(stood["position_mm"][1])
    chip = page.get_by_role("button", name="Jade")
    assert chip.get_attribute("aria-pressed") == "false"
    settle(page, chip.click)
    assert chip.get_attribute("aria-pressed") == "true"


PROBLEM = {
    "type": "/problems/invalid-parameters",
    "title": "Something in the request is out of range",
    "status": 422,
    "detail": "Expected less.",
    "errors": [{"pointer": "/material/layers/0/thickness_mm", "in": "body", "detail": "Expected less."}],
}
TYPE = {"content-type": "application/problem+json"}
