"""Depths of nested meshes and of stacks, through a file and back by a scene."""

import pytest
import torch
from obj_files import torus_obj

import texsss as tx
from texsss.pipeline import Run

SIZE = 64
LAYERS = ("fish-dermis", "fish-blood", "fish-organs", "skin1", "skin2", "marble")


def read_back(folder, parts: dict, layers: int) -> torch.Tensor:
    """Boundaries [mm] as a scene has them, (H, W, L)."""
    material = {"layers": [{"medium": LAYERS[i % 6]} for i in range(layers)], "depths": parts["depths"]}
    mesh = {"source": str(folder / "body.obj"), "unit_mm": 1.0}
    scene = tx.Scene.parse({"mesh": mesh, "maps": parts["maps"], "material": material})
    thickness = Run(tx.Baker().cache, scene).stack.value.table().thickness.mean(-1)
    channels = sum(len(read["channel"]) for read in parts["maps"].values())
    return thickness[..., :channels].cumsum(-1)


@pytest.fixture(scope="module")
def nested(tmp_path_factory):
    """Tori whose tubes are 20, 15 and 10 mm wide."""
    folder = tmp_path_factory.mktemp("nested")
    for name, tube in (("body", 20.0), ("muscle", 15.0), ("organs", 10.0)):
        (folder / f"{name}.obj").write_bytes(torus_obj(tube=tube))
    return folder


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_nested_meshes_become_the_layers_of_a_scene(nested, suffix):
    """5 and 10 mm deep, but for the facets of the tori (.42 mm); the file loses half a level of 65535."""
    files = [nested / f"{name}.obj" for name in ("muscle", "organs")]
    depth = tx.bake_depths(nested / "body.obj", files, unit_mm=1, size=SIZE)
    assert depth.shape == (SIZE, SIZE, 2)
    torch.testing.assert_close(depth, torch.tensor([5.0, 10.0]).expand_as(depth), rtol=0, atol=0.5)
    back = read_back(nested, tx.save_depths(nested / f"two{suffix}", depth), layers=3)
    torch.testing.assert_close(back.to(depth), depth, rtol=0, atol=1.01 * 10 / 65535)


@pytest.mark.parametrize("layers", range(1, 7))
@pytest.mark.parametrize("invert", [False, True])
def test_stacks_come_back_whatever_their_number_of_layers(nested, layers, invert):
    thickness = torch.rand(8, 8, layers, generator=torch.Generator().manual_seed(layers))
    stack = tx.Stack([tx.Layer(tx.preset(LAYERS[i]), thickness[..., i]) for i in range(layers)])
    parts = tx.save_depths(nested / f"deep-{layers}{invert}.png", stack, (0.0, 8.0), invert=invert)
    back = read_back(nested, parts, layers)
    torch.testing.assert_close(back, thickness.double().cumsum(-1), rtol=0, atol=1.01 * 8 / 65535)


def test_layers_that_all_end_at_the_range_stay_layers(nested):
    """The alpha of the fourth is 1 everywhere, which elsewhere means none."""
    depth = torch.tensor([1.0, 2.0, 3.0, 4.0]).expand(4, 4, 4)
    for file in ("even.png", "even.exr"):
        back = read_back(nested, tx.save_depths(nested / file, depth), layers=5)
        torch.testing.assert_close(back.float(), depth, rtol=0, atol=1e-3)


def test_what_is_no_depth_is_refused(nested):
    with pytest.raises(tx.DomainError, match=r"\.png or \.exr"):
        tx.save_depths(nested / "depths.jpg", torch.ones(2, 2, 1))
    with pytest.raises(tx.ShapeError, match=r"\(H, W, L\)"):
        tx.save_depths(nested / "depths.png", torch.ones(2, 2))
    with pytest.raises(tx.ShapeError, match="at least one layer"):
        tx.bake_depths(nested / "body.obj", [])
    (nested / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(tx.DomainError, match="bare has none; unwrap"):
        tx.bake_depths(nested / "bare.obj", [nested / "muscle.obj"])


def test_a_layer_is_written_as_its_stack_and_disorder_is_refused(tmp_path):
    layer = tx.Layer(tx.preset("skin1"), torch.rand(4, 4, generator=torch.Generator().manual_seed(3)))
    for file, given in (("a.exr", layer), ("b.exr", tx.Stack(layer))):
        tx.save_depths(tmp_path / file, given)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    with pytest.raises(tx.DomainError, match=r"channel 1 to lie below channel 0.*sort them"):
        tx.save_depths(tmp_path / "c.exr", torch.tensor([2.0, 1.0]).expand(2, 2, 2))
    assert not (tmp_path / "c.exr").exists()
