"""Methods beside the default through the whole pipeline: octree, Poisson discs, light from the far side."""

import math
from pathlib import Path

import pytest
import torch

from texsss.baker import Baker, bake
from texsss.errors import Cancelled, DomainError
from texsss.io.images import write_png
from texsss.material import MaterialSpec
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.hankel import hankel_profiles
from texsss.result import Baked
from texsss.scene import Scene
from texsss.stages import STAGE_VERSIONS

ZERO = torch.zeros(1)


def plain(small: dict, **methods) -> Scene:
    """The torus of one medium, lit from above, by some methods."""
    bare = {name: part for name, part in small.items() if name not in ("maps", "material")}
    sky = [{"type": "directional", "direction": [0.0, 1.0, 0.0]}]
    return Scene.parse({**bare, "lights": sky, "methods": methods})


def test_octree_agrees_with_the_bank(small):
    """Two ways to the same light that share nothing but the profile; the plain sum is farther off."""
    baker = Baker()
    bank = baker.bake(plain(small, diffusion="surface"))
    found = [
        baker.bake(plain(small, diffusion="octree", octree={"spacing_mm": 1.0, "normalise": normalise}))
        for normalise in (True, False)
    ]
    expected = bank.texel_exitance[bank.texels.covered]
    tree, plainly = (
        float((x.texel_exitance[x.texels.covered] - expected).norm() / expected.norm()) for x in found
    )
    assert tree < 0.004 and tree < plainly  # measured .0014 and .0069 of the RMS


def test_a_wrong_unit_is_told_with_a_place(small):
    huge = {**small, "mesh": {**small["mesh"], "unit_mm": 1e4}}
    baked = bake(plain(huge))
    assert bool(torch.isfinite(baked.radiance).all())
    (said,) = (note for note in baked.report["notes"] if "times as wide as the material" in note)
    assert said.startswith(f"{baked.texels.covered_count:,} texels are more than 100 times")
    assert " mm near (" in said


def test_octree_sums_at_texels_or_at_hits(small):
    pictures = [
        bake(plain(small, diffusion="octree", octree={"spacing_mm": 2.0, "receivers": receivers})).picture
        for receivers in ("texels", "hits")
    ]
    difference = pictures[0] - pictures[1]
    # texels of 3 mm are blurrier than hits
    assert float(difference.norm() / pictures[1].norm()) < 0.03


def test_light_passes_through_thin_parts_alone(small):
    """With transmission the torus' dark side is lit as far as 40 mm let pass, and energy isn't made."""
    thin = {**small, "mesh": {**small["mesh"], "unit_mm": 0.1}}  # a tube of 4 mm
    for method in ("uv", "surface", "octree"):
        without, through = (bake(plain(thin, diffusion=method, transmission=on)) for on in (False, True))
        below = through.texels.points.normal(through.texels.mesh)[:, 1] < -0.9
        gained = float(through.texel_exitance[below, 0].mean() - without.texel_exitance[below, 0].mean())
        # diffusion over the surface and the octree's straight distances reach the dark side, too
        assert gained > {"uv": 0.05, "surface": 0, "octree": 0}[method] * float(
            through.texel_irradiance.max()
        )
        assert float(through.texel_exitance[below, 0].mean()) > 0.1
        energy = through.report["energy"]
        assert all(out < into for out, into in zip(energy["left_w"], energy["entered_w"], strict=True))


SIDE = 24.0  # of a plate [mm]


def plate(folder: Path, thickness: float, layers: list[dict], **methods) -> Scene:
    """Two sides [mm] without an edge, lit on one by 1 W/m², 32² texels."""
    rows = []
    for z, u in ((0.0, 0.02), (-thickness, 0.52)):
        for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)):
            rows.append(f"v {x * SIDE} {y * SIDE} {z}\nvt {u + 0.46 * x} {0.02 + 0.46 * y}")
    (folder / "plate.obj").write_text("\n".join([*rows, "f 1/1 2/2 3/3 4/4", "f 8/8 7/7 6/6 5/5"]))
    return Scene.parse(
        {
            "mesh": {"source": str(folder / "plate.obj"), "unit_mm": 1},
            "atlas": {"uv": "source", "size": 32},
            "material": {"layers": layers},
            "lights": [{"type": "directional", "direction": [0, 0, -1], "irradiance_w_per_m2": [1, 1, 1]}],
            "methods": {"transmission": True} | methods,
        }
    )


def middles(baked: Baked) -> list[torch.Tensor]:
    """Which texels lie in the middle of a plate's dark side, and of its lit one."""
    place = baked.texels.points.position(baked.texels.mesh)
    middle = ((place[:, :2] - SIDE / 2).abs() < 3).all(1)
    return [middle & (place[:, 2] == 0), middle & (place[:, 2] < 0)]


@pytest.mark.parametrize("thickness", [0.3, 1.0])
def test_plates_thinner_than_the_octrees_samples_are_apart_pass_what_they_should(tmp_path, thickness):
    """T̂(0) of a plate lit from behind, whose sides are nearer than the samples."""
    marble = [{"medium": "marble"}]
    baked = bake(plate(tmp_path, thickness, marble, diffusion="octree", octree={"spacing_mm": 1.0}))
    _, T = hankel_profiles(Stack([Layer(preset("marble"), thickness)]), torch.zeros(1))
    assert any("The surface is open" in note for note in baked.report["notes"])
    passed = baked.texel_exitance[middles(baked)[0]].mean(0) / baked.texel_irradiance.amax(0)
    torch.testing.assert_close(passed, T[0], rtol=0.01, atol=0)


@pytest.mark.parametrize("diffusion", ["surface", "uv", "octree"])
def test_a_leaf_is_a_stack_with_two_faces(tmp_path, diffusion):
    """Layers with a bottom return and pass what they do by themselves, as thick as the mesh or not."""
    leaf = Stack([Layer(preset("apple"), 0.3), Layer(preset("potato"), 0.2)])
    layers = [{"medium": "apple", "thickness_mm": 0.3}, {"medium": "potato", "thickness_mm": 0.2}]
    baked = bake(plate(tmp_path, 0.4, layers, diffusion=diffusion, octree={"spacing_mm": 1.0}))
    entered = baked.texel_irradiance.amax(0)
    passed, returned = (baked.texel_exitance[side].mean(0) / entered for side in middles(baked))
    R, T = hankel_profiles(leaf, torch.zeros(1))
    torch.testing.assert_close(passed, T[0], rtol=0.005, atol=0)
    torch.testing.assert_close(returned, R[0], rtol=0.005, atol=0)


def test_thick_objects_let_nothing_through(small):
    """A torus of 40 mm is the same with transmission, but for its curvature."""
    with_it, without = (bake(plain(small, transmission=on, diffusion="uv")) for on in (True, False))
    torch.testing.assert_close(with_it.texel_exitance, without.texel_exitance, rtol=0.01, atol=2e-3)


def test_black_paint_lets_nothing_out(tmp_path, small):
    """Whichever way light came."""
    write_png(tmp_path / "black.png", torch.zeros(4, 4, 3))
    maps = {"albedo": {"source": str(tmp_path / "black.png"), "space": "srgb"}}
    baked = bake(Scene.parse({**small, "maps": maps, "methods": {"transmission": True}}))
    assert float(baked.texel_irradiance.max()) > 0.1
    assert float(baked.texel_exitance.abs().max()) == 0


def test_poisson_keeps_the_total(small):
    baked = bake(plain(small, diffusion="poisson"))
    energy = baked.report["energy"]
    for out, into, total in zip(energy["left_w"], energy["entered_w"], baked.weights.total[0].tolist()):
        assert out / into == pytest.approx(total, rel=0.02)
    assert len(baked.weights.variances) == 1
    wide = bake(plain(small, diffusion="poisson", poisson={"radius_mm": 30.0}))
    assert float(wide.texel_exitance.std()) < float(baked.texel_exitance.std())


def test_octree_stops_and_says_how_far_it_is(small):
    seen, baker, scene = [], Baker(), plain(small, diffusion="octree", octree={"spacing_mm": 2.0})
    with pytest.raises(Cancelled):
        baker.bake(scene, progress=lambda name, _: seen.append(name), cancel=lambda: "octree" in seen)
    heard = []
    baker.bake(scene, progress=lambda *said: heard.append(said))
    shares = [share for name, share in heard if name == "octree"]
    assert {name for name, _ in heard} <= STAGE_VERSIONS.keys() and len(shares) > 2


@pytest.mark.parametrize(
    ("methods", "said"),
    [
        ({"diffusion": "octree", "octree": {"epsilon": 0.0}}, "epsilon"),
        ({"diffusion": "octree", "octree": {"spacing_mm": -1.0}}, "spacing_mm"),
        ({"diffusion": "octree", "octree": {"spacing_mm": 1e-4}}, "try a spacing of"),
        ({"diffusion": "octree", "octree": {"receivers": "pixels"}}, "receivers"),
        ({"diffusion": "poisson", "poisson": {"taps": 0}}, "taps"),
        ({"diffusion": "poisson", "poisson": {"radius_mm": 0.0}}, "radius_mm"),
        ({"diffusion": "poisson", "poisson": {"passes": 1.5}}, "passes"),
        ({"transmission": "perhaps"}, "transmission"),
    ],
)
def test_bad_methods_are_answered(small, methods, said):
    with pytest.raises(DomainError, match=said):
        bake(plain(small, **methods))


@pytest.mark.parametrize(
    ("incidence", "angle"),
    [("normal", "normal"), ({"angle_deg": 75}, math.radians(75))],
)
def test_profiles_take_light_from_the_angle_that_a_scene_names(small, incidence, angle):
    """What comes back is R̂(0) at that angle, with a layer on top that is absent."""
    scene = plain(small, incidence=incidence, diffusion="none")
    layers = [{"medium": "skin2", "thickness_mm": 0}, {"medium": "skin1"}]
    baked = bake(scene.model_copy(update={"material": MaterialSpec.model_validate({"layers": layers})}))
    R = hankel_profiles(Stack([Layer(preset("skin2"), 0.0), Layer(preset("skin1"))]), ZERO, incidence=angle)[
        0
    ]
    torch.testing.assert_close(baked.texel_exitance, baked.texel_irradiance * R[0], rtol=1e-4, atol=1e-6)
