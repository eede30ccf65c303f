"""How frames are drawn: quick while things move, whole at rest; shadowed highlights; numbers of the march."""

import json

from paging import METHODS, pixels, until


def test_moving_frames_are_coarser_and_rest_is_whole(visit):
    """The browser of the tests has no graphics card."""
    page = visit()
    whole = pixels(page)
    sizes = page.evaluate(
        """() => new Promise((done) => {
          const { viewer } = texsss;
          const sizes = [viewer.canvas.width];
          let left = 4;
          const step = () => {
            if (left-- > 0) {
              viewer.redraw(true);
              requestAnimationFrame(step);
              return;
            }
            sizes.push(viewer.canvas.width);
            setTimeout(() => done([...sizes, viewer.canvas.width]), 1500);
          };
          step();
        })"""
    )
    assert sizes[1] < 0.7 * sizes[0] and sizes[2] == sizes[0]
    assert abs(pixels(page) - whole).max() <= 2
    page.evaluate("texsss.viewer.draw(true)")
    quick = page.evaluate("texsss.viewer.surface.turned !== null")
    assert quick, "a torus is closed: its far side is left out"


def test_highlights_stay_out_of_shadows(visit):
    """The far side of the ring lies in the shadow of the near one, low over it."""
    lamp = {"type": "point", "position_mm": [0, 10, 400], "intensity_w_per_sr": [2, 2, 2]}
    page = visit(
        {"lights": [lamp], "material": {"layers": [{"medium": "skin1"}], "surface": {"roughness": 0.6}}}
    )
    shadowed = pixels(page)
    page.evaluate("texsss.viewer.surface.shadows.B.update = () => 0")
    bare = pixels(page)
    assert (shadowed <= bare + 2).all()
    assert (bare - shadowed).max() > 20


def test_numbers_of_the_march_are_followed(visit):
    page = visit({"methods": METHODS | {"single_scattering": "uniform"}})
    until(page, "texsss.viewer.uniforms.marched.value === 1")
    asked = []
    page.on("request", lambda one: asked.append(one) if "image=picture" in one.url else None)
    page.get_by_role("tab", name="Inside").click()
    noise = page.get_by_label("Noise of the start", exact=True)
    before = pixels(page)
    noise.fill("800")
    assert page.evaluate("texsss.viewer.uniforms.marched.value") == 1, "it stays while it is pulled"
    for _ in range(100):
        if len(asked) > 1 and abs(pixels(page) - before).max() > 3:
            break
        page.wait_for_timeout(50)
    sent = [json.loads(one.post_data)["methods"]["march"]["noise"] for one in asked]
    assert sent and all(value == 0.8 for value in sent)
    assert abs(pixels(page) - before).max() > 3
    assert "Monte Carlo" in page.locator("#panel-inside").inner_text(), "skin1 is known"
