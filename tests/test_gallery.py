"""The scenes that texsss ships work as they are, and each of their layers tells in the picture."""

import pytest

from texsss import gallery
from texsss.baker import Baker
from texsss.errors import AssetError
from texsss.scene import Scene


@pytest.fixture(scope="module")
def baker() -> Baker:
    return Baker()


def small(name: str, **more) -> Scene:
    data = gallery.scene(name).model_dump(mode="json", exclude_none=True)
    if data["methods"]["diffusion"] == "surface":
        data["methods"]["diffusion"] = "uv"
    return Scene.parse(data | {"atlas": {"size": 128}} | more)


@pytest.mark.parametrize("name", sorted({*gallery.names()} - {"veins-beneath"}))
def test_every_layer_of_a_shipped_scene_tells(name, baker):
    """Without its top layer, without what is painted below, or unscattered, the object looks another."""
    scene = small(name)
    assert scene.summary
    whole = baker.bake(scene).exitance
    assert float(whole.std()) > 0.05, "lit, and not the same all over"
    layers = scene.model_dump(mode="json")["material"]["layers"]
    others = [{"material": {"layers": layers[:k] + layers[k + 1 :]}} for k in range(len(layers))]
    if len(layers) == 1:
        others = [{"methods": {"diffusion": "none"}}]
    for changed in others:
        other = baker.bake(small(name, **changed)).exitance
        assert float((whole - other).norm() / whole.norm()) > 0.02


def test_vessels_and_flesh_tell_through_the_skin(baker):
    scene = small("veins-beneath")
    whole = baker.bake(scene).exitance
    methods = scene.model_dump(mode="json", exclude_none=True)["methods"]
    layers = methods["parallax"]["layers"]
    for kept in (layers[:1], layers[1:]):
        fewer = methods | {"parallax": methods["parallax"] | {"layers": kept}}
        other = baker.bake(small("veins-beneath", methods=fewer)).exitance
        assert float((whole - other).norm() / whole.norm()) > 0.02


def test_names_are_listed():
    with pytest.raises(AssetError, match="veined-marble"):
        gallery.scene("veined")
    assert "veined-marble" in gallery.names()
