"""What lies beneath, painted: depth textures, phase functions, noise and limits of the march."""

import json

import numpy as np
from paging import METHODS, settle, state
from PIL import Image
from test_places import AXE, violations


def test_depth_textures_and_what_marches_through_them(visit, tmp_path):
    """Controls write what the service takes, say what it refuses, and are undone step by step."""
    four = np.stack([np.full((16, 16), depth, np.uint8) for depth in (40, 90, 140, 200)], -1)
    four[:8, :, 0] = 10
    Image.fromarray(four).save(tmp_path / "organs.png")
    grain = np.random.default_rng(0).integers(0, 255, (16, 16), np.uint8)
    Image.fromarray(grain).save(tmp_path / "grain.png")
    page = visit({"methods": METHODS})

    def choose(button: str, name: str) -> None:
        with page.expect_file_chooser() as chooser:
            page.get_by_role("button", name=button).click()
        chooser.value.set_files(tmp_path / name)

    settle(page, lambda: choose("Depths from a texture…", "organs.png"))
    found = state(page)
    assert found["depths"] == {"range_mm": [0, 2], "maps": ["organs"]}
    assert found["maps"]["organs"]["channel"] == "rgba" and len(found["layers"]) == 5, "alpha is a depth, too"
    settle(page, lambda: page.get_by_label("Put channels in order").check())
    settle(page, lambda: page.get_by_label("Bright is shallow").check())
    deepest = page.get_by_label("Black is in mm")
    settle(page, lambda: (deepest.fill("3"), deepest.press("Enter")))
    assert state(page)["depths"] == {"range_mm": [0, 3], "maps": ["organs"], "invert": True, "sort": True}
    page.evaluate(AXE.read_text() + "; undefined")
    assert violations(page) == []

    settle(page, lambda: page.get_by_label("Made of").select_option("coefficients"))
    settle(page, lambda: page.get_by_label("Scatters as").select_option("schlick"))
    page.get_by_role("tab", name="Inside").click()
    page.get_by_label("Scattered once").select_option("exact")
    choose("Noise from a picture…", "grain.png")
    page.get_by_text("Noise painted in “grain”").wait_for()
    page.get_by_label("Each boundary by itself").check()
    second = page.get_by_label("Boundary 2 at most at in mm")
    second.fill("0.8")
    whole = lambda one: "/v1/render" in one.url and "quality" not in one.url and "picture" in one.url  # noqa: E731
    with page.expect_response(whole) as answer:
        second.press("Enter")
    asked = json.loads(answer.value.request.post_data)
    assert answer.value.status == 200 and asked["methods"]["march"]["noise_map"] == "grain"
    assert asked["material"]["depths"]["sort"] and asked["media"]["layer-1"]["phase"] == "schlick"
    assert violations(page) == []
    march = state(page)["methods"]["march"]
    assert march["noise_map"] == "grain"
    assert march["deepest_mm"] == [0.8, 0.8, 20, 20], "none above the one before"

    page.get_by_role("button", name="Take it with you").click()
    scene = page.get_by_role("dialog").locator("textarea").input_value()
    assert '"phase": "schlick"' in scene and '"noise_map": "grain"' in scene and '"sort": true' in scene
    page.keyboard.press("Escape")

    for _ in range(3):
        page.get_by_role("button", name="Undo").click()
    methods = state(page)["methods"]
    assert methods["single_scattering"] == "exact" and "noise_map" not in methods["march"]
    page.get_by_role("tab", name="Material").click()
    settle(page, lambda: page.get_by_role("button", name="Take away depth texture organs").click())
    assert "depths" not in state(page)
