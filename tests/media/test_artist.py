"""Colour, skin and depth textures to media and back."""

import pytest
import torch

from texsss.errors import DomainError, ShapeError
from texsss.media.artist import from_colour, skin, to_colour
from texsss.media.depths import depths_of, stack_from_depths
from texsss.media.medium import Medium
from texsss.media.phase import henyey_greenstein, schlick
from texsss.media.presets import preset
from texsss.media.stack import Stack
from texsss.profiles.hankel import hankel_profiles


def test_colour_and_mean_free_path_come_back():
    colour = torch.tensor([0.01, 0.2, 0.5, 0.8, 0.97], dtype=torch.float64)
    path = torch.tensor([0.1, 0.5, 1.0, 2.0, 8.0], dtype=torch.float64)
    for g in (0.0, 0.7, -0.3):
        medium = from_colour(colour, path, g)
        seen, length = to_colour(medium)
        torch.testing.assert_close(seen, colour, rtol=0, atol=1e-4)
        torch.testing.assert_close(length, path)


def test_colour_is_what_a_half_space_sends_back_of_even_light():
    """By the default model where nothing refracts: within 1 %, for dark colours .0006 of the light."""
    colour = torch.tensor([0.02, 0.1, 0.5, 0.97], dtype=torch.float64)
    for g in (0.0, 0.7):
        R, _ = hankel_profiles(from_colour(colour, 1.0, g, eta=1.0), torch.zeros(1).double())
        torch.testing.assert_close(R[0], colour, rtol=0.01, atol=6e-4)


def test_ends_of_the_scale():
    """Black scatters nothing, white absorbs nothing, to the digits of the printed fit."""
    black, white = from_colour(0.0, 1.0), from_colour(1.0, 1.0)
    assert float(black.sigma_s) < 1e-4 and float(white.sigma_a) < 1e-6


def test_whole_numbers_are_numbers():
    whole, real = (from_colour(0.5, torch.tensor([1, 2, 3], dtype=d)) for d in (torch.int64, torch.float64))
    torch.testing.assert_close(whole.sigma_s, real.sigma_s)
    assert skin(torch.zeros(4, 4, dtype=torch.uint8)).layers[0].medium.sigma_a.dtype == torch.float64


def test_artist_inputs_are_checked():
    with pytest.raises(DomainError, match="-1 < g < 1"):
        from_colour(0.5, 1.0, g=2.0)
    with pytest.raises(DomainError, match="colour"):
        from_colour(1.2, 1.0)
    with pytest.raises(DomainError, match="mean free path"):
        from_colour(0.5, 0.0)
    with pytest.raises(DomainError, match="melanin"):
        skin(melanin=1.5)


def test_skin_darkens_with_melanin_and_reddens_with_blood():
    pale, dark, flushed = (s.layers for s in (skin(0.02), skin(0.3), skin(0.02, blood=0.05)))
    assert bool((dark[0].medium.sigma_a > pale[0].medium.sigma_a).all())
    more = flushed[1].medium.sigma_a - pale[1].medium.sigma_a
    assert float(more[0]) < 0.1 * float(more[1])  # red passes
    varied = skin(torch.rand(3, 4), torch.rand(3, 4) * 0.05, torch.rand(3, 4) * 0.1)
    assert varied.table().batch == (3, 4)


def test_skin_is_made_of_what_jacques_and_prahl_measured():
    """At 540 nm melanosomes 526/cm, whole blood 285/cm oxygenated and 250/cm not; at 630 nm scattering 25/cm.

    Worked out from the formulas and extinctions of their pages, in 1/mm.
    """
    epidermis, blood = (layer.medium for layer in skin(melanin=1.0, blood=1.0, oxygen=1.0).layers)
    venous = skin(blood=1.0, oxygen=0.0).layers[1].medium
    bloodless = skin(melanin=0.0, blood=0.0).layers
    for found, known in (
        (epidermis.sigma_a, [31.459, 52.562, 96.46]),
        (blood.sigma_a, [0.3267, 28.512, 33.643]),
        (venous.sigma_a, [2.7576, 24.954, 55.321]),
        (bloodless[0].medium.sigma_a, [0.03083, 0.04944, 0.12192]),
        (bloodless[1].medium.sigma_a, [0.03083, 0.04944, 0.12192]),
        (epidermis.sigma_s_prime, [2.5344, 3.9459, 6.9724]),
        (blood.sigma_s_prime, [2.5344, 3.9459, 6.9724]),
    ):
        torch.testing.assert_close(found, torch.tensor(known, dtype=torch.float64), rtol=3e-4, atol=0)


def test_depth_textures_come_back():
    texture = torch.rand(5, 6, 4).sort(-1).values
    media = [preset("fish-dermis"), preset("fish-blood"), preset("fish-organs"), preset("fish-blood")]
    for invert in (False, True):
        source = 1 - texture if invert else texture
        stack = stack_from_depths([source], media, (0.0, 3.0), invert=invert)
        (back,) = depths_of(stack, (0.0, 3.0), invert=invert)
        torch.testing.assert_close(back.to(source.dtype), source, rtol=0, atol=1e-6)
    nine = [*media, *media, preset("skin1")]
    # the second image begins above the first's last boundary
    with pytest.raises(DomainError, match=r"channel 4 to lie below channel 3.*sort=True"):
        stack_from_depths([texture, texture], nine, (0.0, 2.0), infinite=True)
    layered = stack_from_depths([texture, texture], nine, (0.0, 2.0), infinite=True, sort=True)
    assert len(layered.layers) == 9 and layered.table().bottomless
    ends = torch.cat([layer.thickness for layer in layered.layers[:8]], -1).cumsum(-1)
    torch.testing.assert_close(ends, torch.cat([texture, texture], -1).sort(-1).values.to(ends) * 2)


def test_boundaries_that_touch_leave_no_layer_between():
    """One layer, equal depths, and all at the surface: thickness 0, and a stack that profiles take."""
    media = [preset("skin1")] * 4
    (one,) = stack_from_depths([torch.full((1, 1, 1), 0.25)], media[:1], (0.0, 2.0)).layers
    assert float(one.thickness) == 0.5
    equal = stack_from_depths([torch.full((2, 2, 4), 0.5)], media, (0.0, 2.0))
    assert equal.table().thickness[0, 0, :, 0].tolist() == [1.0, 0.0, 0.0, 0.0]
    (back,) = depths_of(equal, (0.0, 2.0))
    assert bool((back == 0.5).all())
    nothing = stack_from_depths([torch.zeros(1, 1, 4)], media, (0.0, 2.0))
    R, _ = hankel_profiles(nothing, torch.zeros(1))
    assert float(R.abs().max()) == 0
    flat = stack_from_depths([torch.rand(1, 1, 4)], media, (1, 1))
    assert flat.table().thickness[0, 0, :, 0].tolist() == [1.0, 0.0, 0.0, 0.0]
    hole = torch.full((2, 2, 4), 0.5)
    hole[1, 1, 2] = torch.nan
    with pytest.raises(DomainError, match=r"0\.\.1.*nan"):
        stack_from_depths([hole], media, (0.0, 2.0))


def test_depth_textures_need_a_range_and_channels():
    texture = torch.rand(2, 2, 1)
    with pytest.raises(DomainError, match="range"):
        stack_from_depths([texture], [preset("skin1")], (2.0, 1.0))
    with pytest.raises(ShapeError, match="one channel for each of 2 layers"):
        stack_from_depths([texture], [preset("skin1")] * 2, (0.0, 1.0))
    with pytest.raises(ShapeError, match="one size"):
        stack_from_depths([texture, torch.rand(3, 2, 1)], [preset("skin1")], (0.0, 1.0))
    with pytest.raises(ShapeError, match="finite layer"):
        depths_of(Stack(Medium(0.1, 1.0)), (0.0, 1.0))


@pytest.mark.parametrize("g", [-0.5, 0.0, 0.8])
def test_phase_functions_are_densities(g):
    """∫ p dω = 1; the mean cosine of Henyey-Greenstein is g, of Schlick's .8 it is .63."""
    cosine = torch.linspace(-1, 1, 20001, dtype=torch.float64)
    k = torch.tensor(g, dtype=torch.float64)
    for phase in (henyey_greenstein, schlick):
        density = 2 * torch.pi * phase(cosine, k)
        assert abs(float(torch.trapezoid(density, cosine)) - 1) < 2e-6
        mean = float(torch.trapezoid(density * cosine, cosine))
        if phase is henyey_greenstein:
            assert abs(mean - g) < 2e-6
        elif g == 0.8:
            assert abs(mean - 0.63) < 0.005
