"""What pictures march unless told otherwise: which scenes, which lights, and that nothing counts twice."""

import pytest
import torch
from obj_files import torus_obj

from texsss.baker import Baker
from texsss.errors import DomainError, ShapeError
from texsss.io.exr import write_exr
from texsss.io.images import write_png
from texsss.light import irradiance
from texsss.pipeline import Run
from texsss.scene import Scene

LAMP = {"type": "point", "position_mm": [300.0, 400.0, 700.0], "intensity_w_per_sr": [3.0, 3.0, 3.0]}
SKY = {"type": "environment", "radiance": [0.5, 0.7, 1.0]}
BALL = {"type": "sphere", "position_mm": [300.0, 400.0, 700.0], "radius_mm": 50.0}


@pytest.fixture(scope="module")
def baker() -> Baker:
    return Baker()


@pytest.fixture(scope="module")
def ring(tmp_path_factory) -> dict:
    folder = tmp_path_factory.mktemp("ring")
    (folder / "ring.obj").write_bytes(torus_obj())
    write_png(folder / "flat.png", torch.tensor([0.5, 0.5, 1.0]).expand(8, 8, 3))
    tilted = torch.nn.functional.normalize(torch.tensor([0.0, 0.5, 1.0]), dim=0)
    write_png(folder / "tilted.png", (tilted / 2 + 0.5).expand(8, 8, 3))
    write_png(folder / "rainbow.png", torch.rand(8, 8, 3, generator=torch.Generator().manual_seed(0)))
    return {
        "mesh": {"source": str(folder / "ring.obj"), "unit_mm": 1.0},
        "maps": {n: {"source": str(folder / f"{n}.png")} for n in ("flat", "tilted", "rainbow")},
        "material": {"layers": [{"medium": "skin1"}]},
        "lights": [LAMP],
        "atlas": {"size": 64},
        "camera": {"resolution": [64, 48], "samples": 1},
        "output": {"background": [0.0, 0.0, 0.0]},
    }


def run(baker: Baker, scene: dict, **methods) -> Run:
    return Run(baker.cache, Scene.parse(scene | {"methods": {"diffusion": "uv"} | methods}))


@pytest.mark.parametrize(
    ("methods", "lights", "how"),
    [
        ({}, [LAMP], "exact"),
        ({"diffusion": "surface"}, [{"type": "studio"}], "exact"),
        ({}, [SKY, LAMP], "exact"),
        ({}, [SKY, BALL], "exact"),
        ({"angular": True}, [SKY, BALL], "exact"),
        ({}, [], "none"),
        *(({"diffusion": kind}, [LAMP], "none") for kind in ("none", "octree", "poisson", "parallax")),
        *(({"profile": kind}, [LAMP], "none") for kind in ("dipole", "multipole", "layered-diffusion")),
        ({"single_scattering": "none"}, [LAMP], "none"),
        ({"single_scattering": "uniform"}, [LAMP], "uniform"),
        ({"single_scattering": "exact", "diffusion": "octree"}, [SKY], "exact"),
    ],
)
def test_what_marches_unasked(baker, ring, methods, lights, how):
    made = run(baker, ring | {"lights": lights}, **methods)
    assert made.marching == how
    assert made.marches["method"] == how


def test_a_thickness_of_many_colours_does_not_march_and_says_why(baker, ring):
    painted = {"map": "rainbow", "range": [0.1, 1.0]}
    layers = [{"medium": "skin1", "thickness_mm": painted}, {"medium": "skin2"}]
    made = run(baker, ring | {"material": {"layers": layers}})
    assert made.marching == "none" and made.single is None
    assert [note for note in made.why_unmarched if "thickness differs between colours" in note]
    assert run(baker, ring).marching == "exact" and not run(baker, ring).why_unmarched


def test_what_cannot_be_marched_is_told_before_light_is_waited_for(baker, ring):
    """As many limits as no boundaries, and phases that differ."""
    layers = {"layers": [{"medium": "smoke", "thickness_mm": 1.0}, {"medium": "jelly"}]}
    smoke = {"sigma_a_per_mm": 0.1, "sigma_s_per_mm": 2.0, "g": 0.6}
    asked = ring | {"media": {"smoke": smoke, "jelly": smoke | {"phase": "schlick"}}, "material": layers}
    for scene, methods, named in (
        (asked | {"material": "jelly"}, {"march": {"deepest_mm": [1.0, 2.0]}}, "each of 0 boundaries, got 2"),
        (asked, {}, "one phase for all layers"),
    ):
        made = run(baker, scene, **methods)
        with pytest.raises((DomainError, ShapeError), match=named):
            made.baked()
        assert "light" not in made.seconds and "weights" not in made.seconds


def test_textures_hold_all_light_and_pictures_march_it(baker, ring):
    auto, none, exact = (
        baker.bake(Scene.parse(ring | {"methods": {"diffusion": "uv", "single_scattering": how}}))
        for how in ("auto", "none", "exact")
    )
    assert torch.equal(auto.texel_exitance, none.texel_exitance)
    assert torch.equal(auto.picture, exact.picture)
    assert not torch.equal(auto.picture, none.picture)
    assert auto.report["march"] == {"method": "exact", "steps": 4, "lights": 1}
    assert none.report["march"] == {"method": "none"}


PANEL = {
    "type": "rectangle",
    "position_mm": [150.0, 150.0, 250.0],
    "width_mm": [150.0, 0.0, -90.0],
    "height_mm": [0.0, -150.0, 0.0],
}


@pytest.mark.parametrize(
    ("light", "few", "most"),  # measured .010, .005, .0005, and means off by .13, .12, .00 %
    [(PANEL, 64, 0.02), (BALL, 64, 0.01), (SKY, 64, 0.002), (SKY, 1, 0.002)],
    ids=["panel", "ball", "sky", "sky seen once"],
)
def test_lights_with_an_extent_are_marched_as_with_many_rays(baker, ring, light, few, most):
    """Looks without rays, scaled to what entered, against looks with thousands of rays.

    What grazes the surface scatters once most of all: looks that lack it are too dark on average.
    """

    def single(how: str, samples: int) -> torch.Tensor:
        asked = {"lights": [light | {"samples": samples}], "camera": {"resolution": [48, 36], "samples": 1}}
        methods = {"diffusion": "uv", "single_scattering": how}
        return baker.intermediate(Scene.parse(ring | asked | {"methods": methods}), "single")

    auto, exact = single("auto", few), single("exact", 2048)
    on = exact.sum(-1) > 0.05 * float(exact.sum(-1).mean())
    assert float((auto - exact)[on].norm() / exact[on].norm()) < most
    assert float(auto.sum() / exact.sum()) == pytest.approx(1, abs=0.005)
    # the same looks for all: neighbours differ no more than with thousands
    rough = [float(image.diff(dim=1)[on[:, 1:] & on[:, :-1]].norm()) for image in (auto, exact)]
    assert rough[0] < 1.1 * rough[1]


def test_a_faint_lamp_of_a_panorama_is_marched_where_the_bright_one_is_not_seen(baker, ring, tmp_path):
    """Places drawn by brightness would miss it, and with it all light that it alone brings: .4 was left."""
    lamps = torch.full((64, 128, 3), 0.02)
    lamps[20:22, 30:32], lamps[20:22, 94:96] = 300.0, 30.0
    write_exr(tmp_path / "lamps.exr", lamps)
    lit = ring | {"maps": ring["maps"] | {"lamps": {"source": str(tmp_path / "lamps.exr")}}}

    def single(how: str, samples: int) -> torch.Tensor:
        light = {"type": "environment", "map": "lamps", "samples": samples}
        asked = {
            "lights": [light],
            "camera": {"direction": [1, 0.3, 0], "resolution": [32, 24], "samples": 1},
        }
        methods = {"diffusion": "uv", "single_scattering": how}
        return baker.intermediate(Scene.parse(lit | asked | {"methods": methods}), "single")

    assert float(single("auto", 64).sum() / single("exact", 1024).sum()) == pytest.approx(1, abs=0.03)


def test_light_of_every_extent_is_looked_for_once(ring, monkeypatch):
    """A march that takes what entered of each asks for no rays that diffusion has not traced already."""
    traced = []
    monkeypatch.setattr(
        irradiance,
        "_lit",
        lambda *a, apart, _lit=irradiance._lit, **k: traced.append(apart) or _lit(*a, apart=apart, **k),
    )
    lit = ring | {"lights": [SKY, BALL, LAMP]}
    auto, none = (
        Baker().bake(Scene.parse(lit | {"methods": {"diffusion": "uv", "single_scattering": how}}))
        for how in ("auto", "none")
    )
    assert auto.picture is not None and none.picture is not None
    assert traced == [True, False]
    assert torch.equal(auto.texel_exitance, none.texel_exitance)


def test_another_phase_is_marched_anew_and_nothing_else_is_redone(baker, ring):
    """Diffusion has Henyey and Greenstein's alone; and media that no layer names are nobody's."""

    def baked(phase: str, spare: float):
        medium = {"sigma_a_per_mm": 0.1, "sigma_s_per_mm": 2.0, "g": 0.6, "phase": phase}
        media = {"jelly": medium, "spare": {"sigma_a_per_mm": spare, "sigma_s_per_mm": 1.0}}
        made = baker.bake(
            Scene.parse(ring | {"media": media, "material": "jelly", "methods": {"diffusion": "uv"}})
        )
        return made.picture, set(made.report["seconds"])

    first, _ = baked("henyey-greenstein", 1.0)
    other, redone = baked("schlick", 1.0)
    assert redone == {"picture"} and not torch.equal(first, other)
    same, redone = baked("schlick", 2.0)
    assert not redone and torch.equal(same, other)


def test_a_lamp_and_a_sky_are_marched_apart(baker, ring):
    """Each by what enters of itself: their sum is that of both alone, and so is what is left to diffusion."""
    single = lambda lights: baker.intermediate(Scene.parse(ring | {"lights": lights}), "single")  # noqa: E731
    alone = [single([light]) for light in (SKY, BALL, LAMP)]
    torch.testing.assert_close(
        single([SKY, BALL, LAMP]), sum(alone), rtol=0, atol=0.05 * float(alone[0].mean())
    )
    left = [run(baker, ring | {"lights": [light]}).diffused("unmarched").value for light in (SKY, LAMP)]
    both = run(baker, ring | {"lights": [SKY, LAMP]}).diffused("unmarched").value
    torch.testing.assert_close(both, sum(left), rtol=0, atol=1e-5 * float(both.mean()))


def test_bumps_bend_light_that_is_marched(baker, ring):
    """A flat normal map changes nothing; one that tilts towards the lamp, or away from it, does."""

    def single(surface: dict) -> torch.Tensor:
        material = {"layers": [{"medium": "skin1"}], "surface": surface}
        return baker.intermediate(Scene.parse(ring | {"material": material}), "single")

    plain, flat = single({}), single({"normal": "flat"})
    # 8 bits cannot say 0, and outlines that turn away are bent back: measured .3 %
    assert float((flat - plain).abs().mean()) < 0.01 * float(plain.mean())
    up, down = (single({"normal": "tilted", "normal_y": y}) for y in ("+y", "-y"))
    assert float((up - down).abs().max()) > 0.05 * float(plain.amax())
