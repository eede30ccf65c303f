"""The object on screen: it is there, it follows what is asked of it, and the camera stays."""

import numpy as np
from paging import address, pixels, pose, settle


def test_first_picture_is_not_flat(visit):
    """The default object, with its maps."""
    page = visit(path=address({"atlas": {"size": 64}}))
    seen = pixels(page)
    middle = seen[seen.shape[0] // 4 : -seen.shape[0] // 4, seen.shape[1] // 4 : -seen.shape[1] // 4]
    assert middle.max() > 120 and middle.std() > 25  # measured 255, 61


def test_light_drag_changes_pixels_and_not_the_camera(visit):
    page = visit()
    before, stood = pixels(page), pose(page)
    box = page.locator("#view").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag():
        page.keyboard.down("Shift")
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 180, y + 20, steps=6)
        page.mouse.up()
        page.keyboard.up("Shift")

    settle(page, drag)
    assert pose(page) == stood
    assert np.abs(pixels(page) - before).mean() > 2


def test_drag_orbits(visit):
    page = visit()
    stood = pose(page)
    box = page.locator("#view").bounding_box()
    page.mouse.move(box["x"] + 300, box["y"] + 300)
    page.mouse.down()
    page.mouse.move(box["x"] + 420, box["y"] + 320, steps=4)
    page.mouse.up()
    turned = pose(page)
    assert turned["target_mm"] == stood["target_mm"]
    assert np.linalg.norm(np.subtract(turned["position_mm"], stood["position_mm"])) > 50
