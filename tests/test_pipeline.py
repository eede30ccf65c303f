"""The pipeline as a whole: laws it keeps, what it redoes and what it keeps, how it stops."""

import pytest
import torch

from texsss.baker import Baker, bake
from texsss.errors import AssetError, Cancelled, ShapeError
from texsss.io.images import read_image, write_png
from texsss.media.presets import preset
from texsss.media.stack import Stack
from texsss.numerics.sampling import bilinear
from texsss.profiles.hankel import hankel_profiles
from texsss.scene import Scene
from texsss.stages import STAGE_VERSIONS
from texsss.transport.bank import build_bank, exitance

LAMP = {"type": "point", "position_mm": [300.0, 400.0, 700.0], "intensity_w_per_sr": [3.0, 3.0, 3.0]}


@pytest.fixture(params=["axolotl", "head"])
def closed(request) -> dict:
    """A closed organic mesh under one light: our own asset, and a scanned head where that is at hand."""
    if request.param == "axolotl":
        return {"lights": [LAMP], "material": "skin1"}
    folder = request.getfixturevalue("shared_data") / "head"
    mesh = {"source": str(folder / "LeePerrySmith.obj"), "unit_mm": 1000.0}
    return {"mesh": mesh, "lights": [LAMP], "material": "skin1"}


@pytest.fixture(scope="module")
def baker() -> Baker:
    """One for all that bake the same meshes."""
    return Baker()


def of(closed: dict, size: int, **more) -> Scene:
    return Scene.parse(closed | {"atlas": {"size": size}, "methods": {"diffusion": "uv"}} | more)


@pytest.mark.parametrize("material", ["skin1", "marble"])
@pytest.mark.parametrize("size", [256, 1024])
def test_energy_that_leaves_a_closed_mesh_is_the_profile_total(baker, closed, material, size):
    """Σ M dA = R̂(0) Σ E dA."""
    baked = baker.bake(of(closed, size, material=material))
    left, entered = (torch.tensor(baked.report["energy"][name]) for name in ("left_w", "entered_w"))
    R, _ = hankel_profiles(Stack(preset(material)), torch.zeros(1), model="layered-sp3")
    torch.testing.assert_close(left / entered, R[0].float(), rtol=0.01, atol=0)


def test_constant_light_stays_constant(baker, closed):
    """E = 1 everywhere gives M = R̂(0), at chart edges too, in the gutter too."""
    baked = baker.bake(of(closed, 512))
    bank = build_bank(torch.ones(len(baked.texels), 3), baked.texels, baked.weights.variances, method="uv")
    left = exitance(bank, baked.weights, rule="exit")
    total = baked.weights.table.sum(1)
    assert float((left / total - 1).abs().max()) < 1e-3


@pytest.mark.parametrize("closed", ["head"], indirect=True)  # hundreds of charts mix by resolution
def test_resolutions_agree(baker, closed):
    """512² and 2048² show the same surface light: RMS difference ≤ 2 % of the RMS."""
    small, large = (baker.bake(of(closed, size)) for size in (512, 2048))
    both = large.coverage.reshape(512, 4, 512, 4).all(3).all(1) & small.coverage
    fine = large.exitance.reshape(512, 4, 512, 4, 3).mean((1, 3))[both]
    coarse = small.exitance[both]
    assert float((fine - coarse).square().mean().sqrt() / fine.square().mean().sqrt()) < 0.02


def test_same_inputs_same_bytes(small):
    scene = Scene.parse(small)
    first, second = bake(scene), bake(scene)
    assert torch.equal(first.exitance, second.exitance)
    assert torch.equal(first.picture, second.picture)


def test_panels_are_looked_at_as_often_as_the_scene_asks(small):
    """More looks, less noise: two seeds differ less."""
    panel = {"type": "rectangle", "position_mm": [0, 0, 150], "width_mm": [300, 0, 0]}
    apart = []
    for samples in (1, 64):
        scene = {**small, "lights": [panel | {"height_mm": [0, -300, 0], "samples": samples}]}
        first, second = (bake(Scene.parse({**scene, "seed": seed})).texel_irradiance for seed in (1, 2))
        apart.append(float((first - second).norm() / first.norm()))
    assert 0 < apart[1] < 0.3 * apart[0]


def test_maps_that_cannot_be_read_are_told_before_anything_is_waited_for(small):
    heard: list[str] = []
    material = {"layers": [{"medium": "skin1"}], "surface": {"roughness": "rough"}}
    maps = {**small["maps"], "rough": {"source": "none.png"}}
    scene = Scene.parse({**small, "maps": maps, "material": material})
    with pytest.raises(AssetError, match=r"none\.png"):
        bake(scene, progress=lambda stage, _: heard.append(stage))
    assert set(heard) <= {"mesh", "maps"}


def test_maps_that_are_read_otherwise_than_meant_are_told(small, tmp_path):
    """A coloured roughness map is averaged; a square panorama is stretched."""
    colours = torch.rand(8, 8, 3, generator=torch.Generator().manual_seed(0))
    write_png(tmp_path / "orm.png", colours)
    maps = {name: {"source": str(tmp_path / "orm.png")} for name in ("rough", "sky")}
    scene = {
        **small,
        "maps": maps,
        "material": {"layers": [{"medium": "skin1"}], "surface": {"roughness": "rough"}},
        "lights": [{"type": "environment", "map": "sky", "samples": 2}],
    }
    notes = " ".join(bake(Scene.parse(scene)).report["notes"])
    assert "roughness map rough is coloured" in notes and "Panorama sky is 8 × 8" in notes
    scene["maps"]["rough"]["channel"] = "g"
    assert "coloured" not in " ".join(bake(Scene.parse(scene)).report["notes"])


def test_nothing_lit_is_told(small):
    away = {
        "type": "rectangle",
        "position_mm": [0, 0, 150],
        "width_mm": [300, 0, 0],
        "height_mm": [0, 300, 0],
    }
    within = {"type": "point", "position_mm": [60.0, 0, 0], "intensity_w_per_sr": [1.0] * 3}
    first, *others = bake(Scene.parse({**small, "lights": [away, within]})).report["notes"]
    assert "No light reaches the surface" in first
    assert any("(60, 0, 0) mm is inside the object" in note for note in others)


def test_light_on_faces_that_own_no_texel_is_told(tmp_path):
    """Two sides of a plate share the square: the first one owns it, the sun shines on the second."""
    lines = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    (tmp_path / "plate.obj").write_text("\n".join([*lines, "f 1/1 4/4 3/3 2/2", "f 1/1 2/2 3/3 4/4"]))
    found = []
    for z in (1.0, -1.0):
        scene = {
            "mesh": {"source": str(tmp_path / "plate.obj"), "unit_mm": 20.0},
            "atlas": {"uv": "source", "size": 32},
            "lights": [{"type": "directional", "direction": [0.0, 0.0, z]}],
            "methods": {"diffusion": "octree"},
        }
        found += [note for note in bake(Scene.parse(scene)).report["notes"] if "No light" in note]
    assert len(found) == 1 and "50% of the surface lie under others in uv" in found[0]


def test_no_diffusion_is_lambert(small):
    """With a normalised profile and no diffusion, M = albedo E."""
    baked = bake(Scene.parse({**small, "methods": {"diffusion": "none"}}))
    image, mesh = read_image(small["maps"]["albedo"]["source"]), baked.texels.mesh
    albedo = bilinear(image, baked.texels.points.uv(mesh.source_uv), "repeat")
    torch.testing.assert_close(baked.texel_exitance, albedo * baked.texel_irradiance, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("mode", ["pre", "post", "both"])
def test_albedo_modes_agree_without_diffusion(mode, small):
    surface = {"albedo": "albedo", "albedo_mode": mode}
    material = {"layers": [{"medium": "skin1"}], "surface": surface}
    baked = bake(Scene.parse({**small, "material": material, "methods": {"diffusion": "none"}}))
    reference = bake(Scene.parse({**small, "methods": {"diffusion": "none"}}))
    torch.testing.assert_close(baked.texel_exitance, reference.texel_exitance, rtol=1e-5, atol=1e-6)


def made(baked) -> set[str]:
    return set(baked.report["seconds"])


def test_edits_redo_what_they_change_and_no_more(small):
    baker = Baker()
    scene = Scene.parse(small)
    _ = baker.bake(scene).picture
    other_material = scene.model_copy(
        update={"material": Scene.parse({"mesh": "x", "material": "marble"}).material}
    )
    moved_light = Scene.parse({**small, "lights": [LAMP]})
    exposed = Scene.parse({**small, "output": {"exposure_ev": 1.0}})
    assert made(baker.bake(scene)) == set()
    assert made(baker.bake(other_material)) == {"weights", "exitance", "light", "bank"}  # of another index
    assert made(baker.bake(moved_light)) == {"light", "bank", "exitance"}
    assert made(baker.bake(exposed)) == set()


def test_material_of_the_same_index_costs_no_blur(small):
    baker = Baker()
    for medium in ("skin1", "skin2"):
        material = {"layers": [{"medium": medium}]}
        baked = baker.bake(Scene.parse({**small, "material": material}))
    assert made(baked) == {"weights", "exitance"}


def test_full_cache_gives_the_same(small):
    scene = Scene.parse(small)
    assert torch.equal(Baker(cache_bytes=0).bake(scene).exitance, bake(scene).exitance)


def test_progress_names_the_stages(small):
    heard = []
    _ = bake(Scene.parse(small), progress=lambda stage, fraction: heard.append((stage, fraction))).picture
    stages = ["mesh", "atlas", "texels", "sites", "light", "bank", "weights", "exitance", "picture"]
    assert {*stages} <= {stage for stage, _ in heard} <= STAGE_VERSIONS.keys()
    for stage in stages:
        fractions = [fraction for name, fraction in heard if name == stage]
        assert fractions[0] == 0 and fractions[-1] == 1
        # what is marched asks some stages for another result, once the first is whole
        again = [k for k in range(1, len(fractions)) if fractions[k] < fractions[k - 1]]
        assert all((fractions[k - 1], fractions[k]) == (1, 0) for k in again) and len(again) < 2


@pytest.mark.parametrize("stage", ["mesh", "texels", "light", "bank"])
def test_cancel_stops_and_keeps_what_was_done(stage, small):
    baker, scene, seen = Baker(), Scene.parse(small), []

    with pytest.raises(Cancelled):
        baker.bake(scene, progress=lambda name, _: seen.append(name), cancel=lambda: stage in seen)
    baked = baker.bake(scene)
    assert bool(torch.isfinite(baked.exitance).all())
    order = ["mesh", "atlas", "texels", "light", "bank"]
    redone = [name for name in order if name in baked.report["seconds"]]
    assert redone == order[order.index(stage) :] if stage != "mesh" else redone == order[1:]


def test_images_are_full_squares_without_nan(small):
    baked = bake(Scene.parse(small))
    for image in (baked.irradiance, baked.exitance, baked.radiance):
        assert image.shape == (128, 128, 3)
        assert bool(torch.isfinite(image).all())
        assert bool((image.sum(-1) > 0).any())
    assert baked.coverage.shape == (128, 128) and baked.coverage.dtype == torch.bool


def test_maps_need_texture_coordinates(tmp_path, small):
    path = tmp_path / "bare.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    albedo = {"source": {"builtin": "axolotl/albedo.png"}, "space": "srgb"}
    data = {"mesh": str(path), "maps": {"albedo": albedo}, "material": {"surface": {"albedo": "albedo"}}}
    with pytest.raises(ShapeError, match="no texture coordinates"):
        bake(Scene.parse({**small, **data}))


def test_unknown_builtin_lists_the_choices(small):
    with pytest.raises(AssetError, match=r"axolotl/axolotl\.obj"):
        bake(Scene.parse({**small, "mesh": {"source": {"builtin": "../../etc/passwd"}}}))


def test_light_crosses_the_seams_of_a_torus(small):
    """Turned about its axis the torus is the same, so `surface` sees no seam where `uv` stops."""
    sky = [{"type": "directional", "direction": [0.0, 1.0, 0.0]}]
    plain = {name: part for name, part in small.items() if name not in ("maps", "material")}
    jump = {}
    for method in ("uv", "surface"):
        baked = bake(Scene.parse({**plain, "lights": sky, "methods": {"diffusion": method}}))
        left = baked.exitance.mean(-1)
        jump[method] = float((left[0] - left[-1]).abs().max() / left.max())  # both sides of the seam along v
        energy = baked.report["energy"]
        for out, into, total in zip(energy["left_w"], energy["entered_w"], baked.weights.total[0].tolist()):
            assert out / into == pytest.approx(total, rel=0.01)
    assert jump["surface"] < 0.5 * jump["uv"]


def test_march_takes_the_place_of_what_profiles_no_longer_hold(small):
    """Light scattered once plus the rest is as bright as both diffused: nothing counts twice, or is lost."""
    mean = {}
    for method in ("none", "exact"):
        # thin, free below and of an index: its bottom mirrors light that the march does not see
        forwards = {"sigma_a_per_mm": [0.01] * 3, "sigma_s_per_mm": [4.5] * 3, "g": 0.8, "eta": 1.4}
        material = {"layers": [{"medium": "thin", "thickness_mm": 0.1}], "surface": {"specular": 0.0}}
        scene = {**small, "maps": {}, "media": {"thin": forwards}, "material": material}
        scene |= {"methods": {"single_scattering": method}}
        picture = bake(Scene.parse({**scene, "output": {"background": [0.0, 0.0, 0.0]}})).picture
        mean[method] = picture.mean((0, 1))
    # measured 1 %; without the mirrored light a quarter is missing
    torch.testing.assert_close(mean["exact"], mean["none"], rtol=0.03, atol=0)


def marched(small: dict, thickness: float, method: str = "exact", **march) -> torch.Tensor:
    """Light scattered once in a layer on an endless one [W/(m² sr)]."""
    layers = [{"medium": "skin2", "thickness_mm": thickness}, {"medium": "ketchup"}]
    methods = {"single_scattering": method, "march_samples": 6, "march": march}
    scene = {**small, "maps": {}, "material": {"layers": layers}, "methods": methods}
    return Baker().intermediate(Scene.parse(scene), "single")


def test_a_clamped_layer_is_a_thinner_one(small):
    assert torch.equal(marched(small, 1.0, deepest_mm=0.3), marched(small, 0.3))
    assert not torch.equal(marched(small, 1.0), marched(small, 0.3))


def test_noise_moves_even_steps_and_not_the_exact_ones(small):
    for method, same in (("uniform", False), ("exact", True)):
        still, noisy = (marched(small, 0.5, method, noise=noise) for noise in (0.0, 0.5))
        assert torch.equal(still, noisy) is same
