"""How frames are drawn: quick while things move, whole at rest; shadowed highlights; numbers of the march."""

import json

from paging import METHODS, SMALL, address, pixels, settle, until


def test_moving_frames_are_coarser_and_rest_is_whole(visit):
    """The browser of the tests has no graphics card."""
    page = visit()
    whole = pixels(page)
    sizes = page.evaluate(
        """() => new Promise((done) => {
          const { viewer } = texsss;
          Object.defineProperty(viewer.pace, 'share', { get: () => 0.5, set: () => {} });
          const sizes = [viewer.canvas.width];
          let left = 4;
          const step = () => {
            if (left-- > 0) {
              viewer.redraw(true);
              requestAnimationFrame(step);
              return;
            }
            sizes.push(viewer.canvas.width);
            setTimeout(() => done([...sizes, viewer.canvas.width]), 800);
          };
          step();
        })"""
    )
    assert sizes[1] < 0.7 * sizes[0] and sizes[2] == sizes[0]
    assert abs(pixels(page) - whole).max() <= 2


def test_orbit_on_the_default_object(visit, capsys):
    """Frames a second, as printed; and that what stands in for the object while it turns looks like it."""
    page = visit(
        path=address({"atlas": {"size": 64}}), viewport={"width": 1160, "height": 646}, device_scale_factor=1
    )
    until(page, "texsss.viewer.surface.quick !== null")
    page.evaluate(ORBIT % 8)
    seconds = page.evaluate(ORBIT % 30) / 1000
    size = page.evaluate("[texsss.viewer.canvas.clientWidth, texsss.viewer.canvas.clientHeight]")
    with capsys.disabled():
        print(f"\norbit at {size[0]} x {size[1]}: {30 / seconds:.1f} frames a second")
    assert size == [800, 600]
    page.wait_for_timeout(400)
    whole = pixels(page)
    page.evaluate("Object.defineProperty(texsss.viewer.pace, 'share', { value: 1 })")
    quick = pixels(page, quickly=True)
    faces = page.evaluate("texsss.viewer.surface.quick.geometry.drawRange.count / 3")
    assert 1000 < faces < 5000, "fewer, and those alone that face the eye"
    assert abs(quick - whole).mean() < 3  # measured 2.4: outlines, and gloss by vertices


ORBIT = """() => new Promise((done) => {
  let left = %d, start = performance.now();
  const step = () => {
    if (left-- === 0) return done(performance.now() - start);
    texsss.viewer.orbit.turn(0.02);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})"""


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


def test_pictures_beneath_the_surface(visit):
    """They shift with the view: the service draws them when it rests, and again when their depth changes."""
    parallax = {"opacity": 0.3, "layers": [{"base": "vessels", "depth_mm": 2.0}]}
    vessels = {"source": {"builtin": "scenes/vessels.png"}, "space": "srgb"}
    page = visit(
        {"methods": METHODS | {"diffusion": "parallax", "parallax": parallax}, "maps": {"vessels": vessels}},
        **SMALL,
    )
    until(page, "texsss.viewer.looks.B.marched === 1")
    before = pixels(page)
    page.get_by_role("tab", name="Inside").click()
    settle(page, lambda: page.get_by_label("The surface hides", exact=True).fill("950"))
    until(page, "texsss.viewer.looks.B.marched === 1")
    assert abs(pixels(page) - before).mean() > 1
    page.get_by_role("button", name="Remove picture 1").click()
    page.get_by_text("Nothing lies there yet").wait_for()


def test_numbers_of_the_march_are_followed(visit):
    page = visit({"methods": METHODS | {"single_scattering": "uniform"}}, **SMALL)
    until(page, "texsss.viewer.looks.B.marched === 1")
    asked = []
    page.on("request", lambda one: asked.append(one) if "image=picture" in one.url else None)
    page.get_by_role("tab", name="Inside").click()
    noise = page.get_by_label("Noise of the start", exact=True)
    before = pixels(page)
    noise.fill("800")
    assert page.evaluate("texsss.viewer.looks.B.marched") == 1, "it stays while it is pulled"
    for _ in range(150):
        if len(asked) > 1 and abs(pixels(page) - before).max() > 3:
            break
        page.wait_for_timeout(50)
    assert len(asked) > 1, "a coarse one while it is pulled, then the whole"
    sent = [json.loads(one.post_data)["methods"]["march"]["noise"] for one in asked]
    assert sent and all(value == 0.8 for value in sent)
    assert abs(pixels(page) - before).max() > 3
    assert "Monte Carlo" in page.locator("#panel-inside").inner_text(), "skin1 is known"
    before = pixels(page)
    settle(page, lambda: page.get_by_label("Parts light each other", exact=True).fill("1000"))
    assert abs(pixels(page) - before).max() > 3, "folds of the object lie brighter"
    page.get_by_label("Light spreads").select_option("octree")
    page.get_by_label("Parts light each other", exact=True).wait_for(state="hidden")
