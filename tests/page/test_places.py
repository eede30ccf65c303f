"""Phones, themes, screen readers, a service that goes away, a graphics card that is taken."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from obj_files import torus_obj
from paging import METHODS, SMALL, Gate, drop, pixels, pose, settle, state, until

AXE = Path(__file__).parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
TABS = ("Material", "Light", "Object", "Inside")


def test_axe_finds_nothing(visit):
    """In either theme."""
    page = visit()
    page.evaluate(AXE.read_text() + "; undefined")
    page.locator("#view").press("c")

    def everywhere(theme):
        for tab in TABS:
            page.get_by_role("tab", name=tab).click()
            page.wait_for_timeout(100)
            assert violations(page) == [], (theme, tab)
        for opener in ("Help and keys", "Take it with you"):
            page.get_by_role("button", name=opener).click()
            assert violations(page) == [], (theme, opener)
            page.keyboard.press("Escape")

    everywhere("dark")
    page.get_by_role("button", name="Light or dark page").click()
    everywhere("light")


def violations(page) -> list:
    found = page.evaluate("axe.run().then(({ violations }) => violations)")
    return [(one["id"], [node["html"][:120] for node in one["nodes"]]) for one in found]


def test_phone(visit):
    page = visit(viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True)
    wide = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert wide[0] <= wide[1]
    view, panel = page.locator("#view").bounding_box(), page.locator("#panel").bounding_box()
    assert view["height"] > 300 and panel["y"] >= view["y"] + view["height"] - 1
    assert panel["height"] > 250
    settle(page, lambda: page.get_by_role("button", name="Marble").tap())
    assert pixels(page).std() > 20

    stood, lit = pose(page), state(page)["lights"]
    touch = page.context.new_cdp_session(page)

    def fingers(kind, *places):
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def two_fingers():
        fingers("touchStart", (80, 340))
        fingers("touchStart", (80, 340), (160, 340))
        for step in range(1, 6):
            fingers("touchMove", (80 + 10 * step, 340), (160 + 10 * step, 340))
        fingers("touchEnd")

    settle(page, two_fingers)
    assert state(page)["lights"] != lit, "two fingers move the light"
    np.testing.assert_allclose(pose(page)["position_mm"], stood["position_mm"], rtol=1e-3)


def test_the_hint_lies_beside_the_badge_or_nowhere(visit):
    """However long the badge is: what marched takes most room."""
    page = visit()
    page.evaluate(
        "document.querySelector('#badge').textContent = '1024² · 12345 ms 1024 × 1024 marched in 12.3 s'"
    )
    for width in (1024, 1241, 1440):
        page.set_viewport_size({"width": width, "height": 400})
        badge, hint = (page.locator(name).bounding_box() for name in ("#badge", "#hint"))
        assert hint is None or badge["x"] + badge["width"] < hint["x"], width
    assert hint is not None, "on a wide window it shows"


def test_the_object_stays_in_view_when_a_phone_is_turned(visit):
    page = visit(viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True)
    upright, margin = pose(page), edges(page)
    page.set_viewport_size({"width": 800, "height": 390})
    until(page, "texsss.viewer.camera.aspect > 1.1")
    assert pose(page) != upright
    for turned in (margin, edges(page)):
        assert 0.04 < min(turned) < 0.12, "it fills the window, and all of it is seen"  # framed to 86 %
    page.set_viewport_size({"width": 390, "height": 800})
    until(page, "texsss.viewer.camera.aspect < 1.1")
    np.testing.assert_allclose(pose(page)["position_mm"], upright["position_mm"], rtol=1e-6, atol=1e-6)


def edges(page) -> list[float]:
    """How far the object stays from the left, right, top and bottom of the window, of its size."""
    seen = pixels(page)
    # at once: a frame between the two would put another material on
    page.evaluate(
        "() => { const { surface } = texsss.viewer; "
        "surface.dress = () => {}; surface.mesh.material.visible = false; }"
    )
    there = np.abs(seen - pixels(page)).max(2) > 6
    page.evaluate("delete texsss.viewer.surface.dress; texsss.viewer.surface.mesh.material.visible = true")
    rows, columns = np.nonzero(there.any(1))[0], np.nonzero(there.any(0))[0]
    height, width = there.shape
    return [columns[0] / width, 1 - columns[-1] / width, rows[0] / height, 1 - rows[-1] / height]


def test_the_context_comes_back(visit):
    page = visit()
    before = pixels(page)
    page.evaluate(
        """() => { window.loser = texsss.viewer.renderer.getContext().getExtension('WEBGL_lose_context');
                   window.loser.loseContext(); }"""
    )
    page.locator(".banner").filter(has_text="graphics card").wait_for()
    page.evaluate("window.loser.restoreContext()")
    page.locator(".banner").wait_for(state="hidden")
    page.wait_for_timeout(200)
    assert abs(pixels(page) - before).max() <= 2


def test_the_service_goes_and_comes_back(visit, page_server):
    """A gate before the service: closed, nothing listens at the address of the page."""
    with Gate(page_server) as gate:
        page = visit(server=replace(page_server, url=gate.url))
        gate.close()
        page.get_by_role("button", name="Milk on ketchup").click()
        page.get_by_role("alert").filter(has_text="can't be reached").wait_for()
        gate.open()
        page.locator(".banner").wait_for(state="hidden")
        page.wait_for_selector("#badge[data-state=final]")
        assert len(state(page)["layers"]) == 2
        page.goto("about:blank")  # it asks the service no more
    page.said[:] = [text for text in page.said if not any(word in text for word in GONE)]


def test_files_that_a_new_service_does_not_know_are_sent_again(visit, page_server, tmp_path):
    page = visit()
    mesh = tmp_path / "mine.obj"
    mesh.write_bytes(torus_obj(tube=25))
    settle(page, lambda: drop(page, mesh))
    asset = state(page)["mesh"]["source"]["asset"]
    with page_server.client() as client:
        assert client.delete(f"/v1/assets/{asset}").status_code == 204
        settle(page, lambda: page.get_by_role("button", name="Jade").click())
        assert client.get(f"/v1/assets/{asset}").json()["name"] == "mine.obj"
        assert page.get_by_role("alert").filter(visible=True).count() == 0

        assert client.delete(f"/v1/assets/{asset}").status_code == 204
        page.reload()  # now the page does not hold the file either
        said = page.get_by_role("alert").filter(has_text="no longer has your files")
        said.wait_for()
        assert "the mesh" in said.inner_text() and "Drop it" in said.inner_text()
        settle(page, lambda: drop(page, mesh))
    assert state(page)["mesh"]["source"]["asset"] == asset
    page.said.clear()  # the browser logs every 4xx as an error


GONE = ("REFUSED", "RESET", "EMPTY_RESPONSE")


def test_nothing_shifts_and_nothing_comes_from_elsewhere(visit):
    page = visit()
    shifts = page.evaluate(
        """() => new Promise((done) => {
          let total = 0;
          new PerformanceObserver((list) => {
            for (const entry of list.getEntries()) total += entry.value;
          }).observe({ type: 'layout-shift', buffered: true });
          setTimeout(() => done(total), 300);
        })"""
    )
    assert shifts == 0
    names = page.evaluate("performance.getEntriesByType('resource').map((one) => one.name)")
    assert names and all(name.startswith((page.url.partition("#")[0], "blob:")) for name in names)


def test_policy_and_caching(page_server):
    with page_server.client() as client:
        page = client.get("/")
        policy = page.headers["content-security-policy"]
        assert "unsafe" not in policy and "default-src 'none'" in policy and "script-src 'self'" in policy
        assert page.headers["cache-control"] == "no-cache"
        script = page.text.partition('src="')[2].partition('"')[0]
        asset = client.get(script)
        assert asset.status_code == 200 and "immutable" in asset.headers["cache-control"]
        assert "three" in client.get("/third-party.md").text
        assert client.get("/favicon.svg").headers["content-type"] == "image/svg+xml"


def test_the_exported_scene_is_the_scene(visit):
    page = visit()
    page.get_by_role("button", name="Take it with you").click()
    text = page.get_by_label("The scene as text")
    scene = json.loads(text.input_value())
    from texsss.scene import Scene

    parsed = Scene.parse(scene)
    assert parsed.camera.fit is False and parsed.atlas.size == 64
    page.get_by_label("As", exact=True).select_option("python")
    assert "tx.Scene.parse" in text.input_value()
    namespace: dict = {}
    exec(text.input_value().partition("baked =")[0], namespace)
    assert namespace["scene"] == parsed
    page.get_by_label("As", exact=True).select_option("command")
    assert "texsss render scene.json" in text.input_value()


def test_looks_inside(visit):
    page = visit()
    page.get_by_role("tab", name="Inside").click()
    first = pixels(page)
    page.get_by_label("Show", exact=True).select_option("irradiance")
    page.locator("#overlay > .legend").wait_for()
    assert "W/m²" in page.locator("#overlay > .legend").inner_text()
    assert abs(pixels(page) - first).mean() > 1
    for key in ("gaussian", "weight", "exitance", "thickness", "texel-mm", "normal", "position"):
        settle(page, lambda key=key: page.get_by_label("Show", exact=True).select_option(key))
    page.get_by_role("button", name="Lay flat").click()
    page.get_by_role("button", name="Show seams").click()
    assert pixels(page).std() > 10
    settle(page, lambda: page.get_by_label("Show", exact=True).select_option("picture"))
    rows = page.locator(".numbers tbody tr")
    assert rows.count() == 7 and "Mean free path" in rows.first.inner_text()
    page.get_by_text("The Gaussians of its sum").click()
    sums = page.locator(".gaussians tbody tr").filter(visible=True)
    assert sums.count() == state(page)["methods"]["terms"] and len(sums.first.locator("th, td").all()) == 5


def test_the_first_bounce_is_shown_without_a_march_in_the_picture(visit):
    page = visit(**SMALL)
    page.get_by_role("tab", name="Inside").click()
    page.get_by_label("Show", exact=True).select_option("single")
    until(page, "texsss.viewer.looks.B.marched === 1")
    alone = pixels(page)
    assert state(page)["methods"]["single_scattering"] == "none"
    assert "W/(m² sr)" in page.locator("#overlay > .legend").inner_text()
    assert "marched in" in page.locator("#badge").inner_text()
    page.get_by_label("Show", exact=True).select_option("picture")
    until(page, "texsss.viewer.looks.B.marched === 0")
    assert abs(pixels(page) - alone).mean() > 2
    blue = alone.mean((0, 1))
    assert blue[2] > blue[0], "skin scatters blue back first"


def test_the_march_is_blended_in_at_rest(visit):
    page = visit({"methods": METHODS | {"single_scattering": "auto"}}, **SMALL)
    page.locator("#badge:not(.marching)").wait_for()
    until(page, "texsss.viewer.looks.B.marched === 1")
    marched = pixels(page)
    page.locator("#view").press("ArrowRight")
    page.locator("#view").press("ArrowLeft")
    before = page.evaluate("texsss.viewer.looks.B.marched")
    assert before == 0
    apart = abs(pixels(page) - marched).mean()
    assert 0 < apart < 12, "another picture, but of the same thing"  # measured 3.9
