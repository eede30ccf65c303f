"""The page as its tests see it: addresses, pixels, what it says of itself."""

import base64
import json
from urllib.parse import quote

import numpy as np

SETTLED = "#badge[data-state=final]"


METHODS = {
    **{"profile": "layered-sp3", "diffusion": "uv", "rule": "exit", "terms": 8, "incidence": "diffuse"},
    **{"single_scattering": "none", "march_samples": 4},
}
"""All of them, the quick one for diffusion: a scene with a mesh of its own starts from the page's."""


def address(scene: dict) -> str:
    """The page with a scene as text in its address."""
    return "/#scene=" + quote(json.dumps(scene))


def pixels(page) -> np.ndarray:
    """(H, W, 3) of the canvas as drawn now, read back in the task that drew it."""
    found = page.evaluate(
        """() => {
          const { width, height, data } = window.texsss.viewer.pixels();
          let text = '';
          for (let i = 0; i < data.length; i += 32768)
            text += String.fromCharCode(...data.subarray(i, i + 32768));
          return { width, height, data: btoa(text) };
        }"""
    )
    flat = np.frombuffer(base64.b64decode(found["data"]), np.uint8)
    return flat.reshape(found["height"], found["width"], 4)[::-1, :, :3].astype(np.int32)


def settle(page, act) -> None:
    """Does `act` and waits until the light it asks for is on the object in full."""
    before = page.evaluate("window.texsss.live.settles")
    act()
    deadline = 600
    while page.evaluate("window.texsss.live.settles") == before:
        page.wait_for_timeout(50)
        deadline -= 1
        assert deadline, "nothing new was shown within 30 s"


def until(page, expression: str) -> None:
    """Waits until an expression is true; the page's policy forbids the browser's own way of waiting."""
    for _ in range(300):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(100)
    raise AssertionError(f"not true within 30 s: {expression}")


def pose(page) -> dict:
    """Where the camera stands."""
    return page.evaluate("window.texsss.viewer.orbit.pose")


def state(page) -> dict:
    """What is undone, shared and saved."""
    return page.evaluate("window.texsss.store.state")
