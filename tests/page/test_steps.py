"""One step after another: undo across meshes, late answers, lights that are gone, maps of one name, links."""

from contextlib import suppress

import numpy as np
from obj_files import torus_obj
from paging import address, drop, pixels, settle, state
from PIL import Image
from playwright.sync_api import Error

TRIANGLES = "texsss.viewer.surface.geometry.index.count / 3"


def test_undo_brings_the_other_mesh_back(visit, tmp_path):
    page = visit()
    seen = page.evaluate(TRIANGLES)
    mesh = tmp_path / "other.obj"
    mesh.write_bytes(torus_obj(around=20, through=16))
    settle(page, lambda: drop(page, mesh))
    assert page.evaluate(TRIANGLES) == 640 != seen
    settle(page, lambda: page.get_by_role("button", name="Undo").click())
    assert page.evaluate(TRIANGLES) == page.evaluate("texsss.live.showing.mesh.faces") == seen


def test_numbers_follow_the_light_map_and_the_last_material(visit):
    """Texels in the table; and a profile that comes after its material was undone is not shown."""
    page = visit()
    page.get_by_role("tab", name="Inside").click()
    cell = page.locator(".numbers tbody tr").first.locator("td small").first
    before = float(cell.inner_text().split()[0])
    page.get_by_role("tab", name="Object").click()
    settle(page, lambda: page.get_by_label("Light map", exact=True).select_option("128"))
    page.get_by_role("tab", name="Inside").click()
    assert 1.8 < float(cell.inner_text().split()[0]) / before < 2.2
    skin = page.locator(".numbers").inner_text()

    held = []
    page.route("**/v1/profile", lambda route: held.append(route))
    page.get_by_role("tab", name="Material").click()
    settle(page, lambda: page.get_by_role("button", name="Marble").click())
    for _ in range(40):
        if held:
            break
        page.wait_for_timeout(50)
    settle(page, lambda: page.get_by_role("button", name="Undo").click())
    page.unroute("**/v1/profile")
    for route in held:
        with suppress(Error):  # the page has given it up
            route.continue_()
    page.get_by_role("tab", name="Inside").click()
    page.wait_for_timeout(300)
    assert page.locator(".numbers").inner_text() == skin


def test_the_sun_follows_the_pointer(visit):
    """Behind the object, too; and when the chosen light is gone, the one whose sun is shown moves."""
    page = visit()
    page.get_by_role("tab", name="Light").click()
    settle(page, lambda: page.get_by_role("button", name="From behind").click())
    sun = page.locator(".light-handle")
    assert "behind" in sun.get_attribute("class")

    def pull(x: int, y: int) -> np.ndarray:
        box = sun.bounding_box()
        at = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
        page.mouse.move(*at)
        page.mouse.down()
        page.mouse.move(at[0] + x, at[1] + y, steps=3)
        settle(page, page.mouse.up)
        box = sun.bounding_box()
        return np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]) - at

    assert pull(40, 0)[0] > 20
    assert pull(0, 25)[1] > 10
    add = page.get_by_role("group", name="Add a light").get_by_role("button", name="Lamp")
    settle(page, add.click)
    settle(page, lambda: page.get_by_role("button", name="Undo").click())
    assert len(state(page)["lights"]) == 2
    moved = pull(-40, 0)
    assert moved[0] < -20, "the light whose sun is shown is the one that moves"


def test_maps_of_one_name_stay_apart(visit, tmp_path):
    page = visit()
    names = []
    for shade in (90, 200):
        folder = tmp_path / str(shade)
        folder.mkdir()
        Image.new("RGB", (8, 8), (shade, 60, 60)).save(folder / "map.png")
        settle(page, lambda folder=folder: drop(page, folder / "map.png"))
        names.append(state(page)["surface"]["albedo"])
    seen, held = pixels(page), []
    page.route("**/v1/render*", lambda route: held.append(route))
    with page.expect_response("**/v1/map*"):
        drop(page, tmp_path / "90" / "map.png")
    page.wait_for_timeout(300)
    assert abs(pixels(page) - seen).max() <= 2, "a map waits for its light"
    settle(page, lambda: page.unroute("**/v1/render*"))  # what was held goes on
    settle(page, lambda: page.get_by_role("button", name="Undo").click())
    maps = state(page)["maps"]
    assert names == ["map", "map-2"] and maps["map"]["source"] != maps["map-2"]["source"]

    page.get_by_role("tab", name="Material").click()
    settle(page, lambda: page.get_by_role("button", name="Marble").click())
    assert "albedo" not in state(page)["surface"]
    page.get_by_role("status").filter(has_text="map-2").wait_for()  # said, not done in silence
    settle(page, lambda: page.get_by_role("button", name="Fair skin").click())
    assert state(page)["surface"]["albedo"] == "map-2"


def test_the_focus_stays_and_fields_show_what_holds(visit):
    page = visit()
    page.get_by_role("button", name="Milk on ketchup").click()
    down = page.get_by_role("button", name="Move layer 1 down")
    down.focus()
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.closest('.card') !== null")
    page.get_by_role("button", name="Hide layer 1").focus()
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "Show layer 1"
    number = page.get_by_label("Roughness, as a number")
    number.fill("5")
    number.press("Enter")
    assert number.input_value() == "1" and state(page)["surface"]["roughness"] == 1


def test_links_that_say_little_and_links_that_are_wrong(visit, ring):
    """A part of a scene is enough; what is wrong is told; a link pasted into an open page is followed."""
    part = {**ring, "material": {"layers": [{"medium": "skin1"}]}, "output": {"exposure_ev": 0.5}}
    page = visit(path=address(part))
    assert state(page)["output"]["tonemap"] and pixels(page).std() > 10
    other = {**ring, "material": {"layers": [{"medium": "marble"}]}}
    with page.expect_navigation():
        page.evaluate("(hash) => { location.hash = hash }", address(other)[1:])
    page.wait_for_selector("#badge[data-state=final]")
    assert state(page)["layers"][0]["preset"] == "marble"
    page.goto("about:blank")
    broken = {**ring, "material": {"layers": 3}, "atlas": {"size": 64}}
    page.goto(address(broken))
    said = page.get_by_role("alert").filter(has_text="link could not be read")
    said.wait_for()
    assert len(state(page)["layers"]) == 1, "what the page starts with"
    page.said.clear()
