"""What scenes say of the march: depth textures, phase, noise from a map, limits of depth."""

import re

import pytest
import torch
from obj_files import torus_obj

from texsss.baker import Baker
from texsss.errors import DomainError, ShapeError
from texsss.io.images import write_png
from texsss.media.phase import schlick, schlick_k
from texsss.pipeline import Run
from texsss.scene import Scene

MEDIA = ("fish-dermis", "fish-blood", "fish-organs", "skin1", "skin2")


@pytest.fixture(scope="module")
def painted(tmp_path_factory) -> dict:
    """A torus and depth textures: rising, decreasing, without alpha, of another size; and grains."""
    folder = tmp_path_factory.mktemp("depths")
    (folder / "ring.obj").write_bytes(torus_obj())
    rising = torch.tensor([0.2, 0.4, 0.6, 0.8]).expand(8, 8, 4)
    write_png(folder / "rising.png", rising)
    write_png(folder / "shallow.png", rising.flip(-1))
    write_png(folder / "opaque.png", rising[..., :3])
    write_png(folder / "large.png", rising[:1, :1].expand(16, 16, 4))
    write_png(folder / "grain.png", torch.rand(8, 8, 1, generator=torch.Generator().manual_seed(0)))
    names = ("rising", "shallow", "opaque", "large")
    maps = {name: {"source": str(folder / f"{name}.png"), "channel": "rgba"} for name in names}
    maps["colours"] = {"source": str(folder / "rising.png")}
    maps["grain"] = {"source": str(folder / "grain.png")}
    lamp = {"type": "directional", "direction": [0.3, 0.8, 0.6]}
    return {
        "mesh": {"source": str(folder / "ring.obj"), "unit_mm": 1.0},
        "maps": maps,
        "atlas": {"size": 64},
        "lights": [lamp],
        "camera": {"resolution": [48, 36], "samples": 1},
    }


def material(*maps: str, layers: int = 4, **how) -> dict:
    made = [{"medium": MEDIA[i % len(MEDIA)]} for i in range(layers)]
    return {"layers": made, "depths": {"maps": list(maps), "range_mm": [0.0, 2.0]} | how}


def run(painted: dict, baker: Baker | None = None, **parts) -> Run:
    return Run((baker or Baker()).cache, Scene.parse(painted | parts))


def thicknesses(made: Run) -> list[float | None]:
    return [
        None if layer.thickness is None else round(float(layer.thickness.mean()), 2)
        for layer in made.stack.value.layers
    ]


def test_channels_are_layers(painted):
    """Four with alpha, three without, eight of two; one more has no end; bright is shallow if inverted."""
    assert thicknesses(run(painted, material=material("rising"))) == [0.4] * 4
    assert thicknesses(run(painted, material=material("rising", layers=5))) == [0.4] * 4 + [None]
    assert thicknesses(run(painted, material=material("opaque", layers=3))) == [0.4] * 3
    assert thicknesses(run(painted, material=material("colours", layers=4))) == [0.4] * 3 + [None]
    inverted = material("shallow", invert=True)
    assert thicknesses(run(painted, material=inverted)) == [0.4] * 4
    eight = material("rising", "shallow", layers=8, sort=True)
    assert thicknesses(run(painted, material=eight)) == [0.4, 0.0] * 4


@pytest.mark.parametrize(
    ("how", "said"),
    [
        (material("shallow"), "channel shallow g to lie below channel shallow r.*sort"),
        (
            material("rising", "shallow", layers=8),
            "channel shallow g to lie below channel shallow r",
        ),
        (material("opaque", layers=5), "expected 3 layers for the 3 channels of opaque.*rgba has four"),
        (material("rising", "large", layers=8), "images of one size, got 8 × 8 and 16 × 16; resize"),
    ],
)
def test_depths_that_do_not_fit_are_told_in_a_sentence(painted, how, said):
    with pytest.raises((DomainError, ShapeError), match=re.compile(said, re.S)):
        _ = run(painted, material=how).stack


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"material": material("nowhere")}, "material.depths.maps.0: no map is named 'nowhere'"),
        ({"material": material("rising", range_mm=[2.0, 1.0])}, "range_mm to rise.*invert"),
        (
            {"material": material("rising") | {"layers": [{"medium": "skin1", "thickness_mm": 1.0}]}},
            "no thickness_mm beside depths, got one in layers.0",
        ),
        (
            {"material": {"layers": [{"medium": "skin1"}], "surface": {"albedo": "rising"}}},
            "got 'rising' with channel 'rgba'; only material.depths",
        ),
        ({"methods": {"march": {"deepest_mm": [1.0, 0.5]}}}, "deepest_mm that do not decrease"),
        ({"methods": {"march": {"noise_map": "nowhere"}}}, "methods.march.noise_map: no map"),
    ],
)
def test_scenes_that_contradict_themselves(painted, parts, said):
    with pytest.raises(DomainError, match=said):
        Scene.parse(painted | parts)


def test_depths_may_end_at_a_limit_of_their_own(painted):
    """A number for every boundary; as many numbers as no boundaries are refused."""
    baker = Baker()
    clamped = [
        run(painted, baker, material=material("rising"), methods={"march": {"deepest_mm": limit}})
        for limit in (0.3, [0.3] * 4, [0.3, 9.0, 9.0, 9.0], [0.3])
    ]
    pictures = [one.picture for one in clamped[:3]]
    assert torch.equal(pictures[0], pictures[1]) and not torch.equal(pictures[0], pictures[2])
    with pytest.raises(ShapeError, match="one for each of 4 boundaries, got 1"):
        _ = clamped[3].picture


def test_noise_from_a_map_sticks_to_the_surface(painted):
    """Whatever the seed; that from a seed does not."""
    baker, how = Baker(), {"single_scattering": "uniform", "march": {"noise": 1.0}}
    mapped = how | {"march": {"noise": 1.0, "noise_map": "grain"}}

    def single(methods: dict, seed: int) -> torch.Tensor:
        return baker.intermediate(Scene.parse(painted | {"methods": methods, "seed": seed}), "single")

    assert torch.equal(single(mapped, 0), single(mapped, 1))
    assert not torch.equal(single(how, 0), single(how, 1))
    assert not torch.equal(single(how, 0), single(mapped, 0))


def test_schlick_has_the_mean_cosine_that_is_asked_for():
    """By quadrature; k = .8 has .63."""
    mean = torch.tensor([-0.9, -0.3, 1e-4, 0.0, 0.02, 0.5, 0.95]).double()
    cosine = torch.linspace(-1, 1, 200_001, dtype=torch.float64)
    found = [
        float(torch.trapezoid(2 * torch.pi * cosine * schlick(cosine, k), cosine)) for k in schlick_k(mean)
    ]
    assert found == pytest.approx(mean.tolist(), abs=2e-6)
    assert float(schlick_k(torch.tensor(0.63))) == pytest.approx(0.8, abs=0.005)


def test_media_march_by_their_phase(painted):
    """All by one; g 0 goes with any."""

    def media(phase: str, g: float = 0.6) -> dict:
        forwards = {"sigma_a_per_mm": 0.1, "sigma_s_per_mm": 2.0, "g": g, "phase": phase}
        return {"media": {"fog": forwards}, "material": {"layers": [{"medium": "fog"}]}}

    baker = Baker()
    hg, other = (run(painted, baker, **media(phase)).picture for phase in ("henyey-greenstein", "schlick"))
    assert not torch.equal(hg, other)
    # one mean cosine, two shapes: of all light .7 %
    assert float((other.mean() / hg.mean() - 1).abs()) < 0.05
    both = media("schlick")
    both["media"]["plain"] = both["media"]["fog"] | {"phase": "henyey-greenstein"}
    both["material"] = {"layers": [{"medium": "fog", "thickness_mm": 1.0}, {"medium": "plain"}]}
    with pytest.raises(DomainError, match="one phase for all layers"):
        _ = run(painted, baker, **both).picture
    both["media"]["plain"] |= {"g": 0.0}
    assert run(painted, baker, **both).phase == "schlick"
