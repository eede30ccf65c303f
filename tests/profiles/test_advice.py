"""Materials that do not suit an object's scale are named, with numbers."""

import pytest

from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.advice import advice


def test_skin_on_a_head_needs_no_advice():
    assert (
        advice(Stack([Layer(preset("skin2"), 0.5), Layer(preset("skin1"))]), texel_mm=0.4, extent_mm=400.0)
        == []
    )
    assert advice(preset("spectralon"), texel_mm=0.2, extent_mm=100.0) == []  # absorbs nothing: spreads far


@pytest.mark.parametrize(
    ("material", "texel_mm", "extent_mm", "said"),
    [
        (preset("skin1"), 400.0, 400000.0, "less than a quarter of a texel"),
        (preset("skin1"), 0.0004, 0.4, "longer than the object"),
        (preset("marble"), 0.002, 2.0, "farther than the object"),
        (Stack([Layer(preset("skin1"), 30.0), Layer(preset("skin2"))]), 0.02, 20.0, "deeper than the object"),
        (Medium(1000.0, 1000.0), 0.5, 300.0, "less than a quarter of a texel"),
        (Medium(1e-8, 0.0), 0.5, 300.0, "longer than the object"),
    ],
)
def test_scales_that_do_not_fit_are_named(material, texel_mm, extent_mm, said):
    sentences = advice(material, texel_mm=texel_mm, extent_mm=extent_mm)
    assert any(said in sentence and "mm" in sentence for sentence in sentences), sentences


@pytest.mark.parametrize("film", [Layer(Medium(0.0005, 0.001), 0.05), Layer(Medium(1.0, 1e6), 0.0)])
def test_films_that_hardly_scatter_say_nothing_of_what_lies_beneath(film):
    """Light goes through the one, and there is none of the other."""
    assert advice(Stack([film, Layer(preset("skin1"))]), texel_mm=0.4, extent_mm=400.0) == []


def test_white_and_dense_matter_spreads_light_a_little():
    assert "quarter of a texel" in advice(Medium(0.0, 1e5), texel_mm=0.4, extent_mm=400.0)[0]


@pytest.mark.parametrize(
    ("medium", "reach"), [(Medium(1.0, 9.0), 30**-0.5), (Medium(0.0, 2.0), 35.0), (Medium(9.0, 1.0), 0.1)]
)
def test_advice_begins_at_a_quarter_of_a_texel(medium, reach):
    """Of the diffusion length; of 70 mean free paths where that is endless, of one where that is shorter."""
    assert advice(medium, texel_mm=3.99 * reach, extent_mm=1e6) == []
    assert "quarter of a texel" in advice(medium, texel_mm=4.01 * reach, extent_mm=1e6)[0]


def test_matter_that_does_nothing_is_named():
    assert "neither" in advice(Medium(0.0, 0.0), texel_mm=0.4, extent_mm=400.0)[0]


def test_layers_deeper_than_a_plate_are_named():
    stack = Stack([Layer(preset("skin1"), 20.0), Layer(preset("skin2"))])
    assert advice(stack, texel_mm=0.4, extent_mm=100.0) == []
    (said,) = advice(stack, texel_mm=0.4, extent_mm=100.0, thickness_mm=2.0)
    assert "20 mm" in said and "(2 mm)" in said


def test_layers_that_a_model_leaves_out_are_named():
    def said(model: str, thickness: float) -> list[str]:
        layers = [Layer(preset("skin1"), thickness), Layer(preset("skin2"))]
        return advice(Stack(layers), texel_mm=0.4, extent_mm=400.0, model=model)

    assert "outermost of 2 layers" in said("better-dipole", 3.0)[0]
    assert "down to 0.39 of one" in said("multipole", 0.5)[0]  # of the red mean free path, 1.3 mm
    slab = Stack([Layer(preset("skin1"), 2.0)])
    assert "knows the layer, as if" in advice(slab, texel_mm=0.4, extent_mm=400.0, model="dipole")[0]
    assert said("multipole", 3.0) == said("layered-sp3", 0.5) == []
    assert advice(preset("skin1"), texel_mm=0.4, extent_mm=400.0, model="dipole") == []
