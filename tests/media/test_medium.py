"""Media and stacks: what they accept, derive and refuse."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from texsss.errors import DomainError, ShapeError
from texsss.media.medium import Medium, mix, number
from texsss.media.presets import PRESETS, preset
from texsss.media.stack import Layer, Stack


def test_derived_coefficients():
    medium = Medium([0.1, 0.5], [1.0, 2.0], 0.5, 1.0)
    torch.testing.assert_close(medium.sigma_s_prime, torch.tensor([0.5, 1.0]).double())
    torch.testing.assert_close(medium.sigma_t_prime, torch.tensor([0.6, 1.5]).double())
    torch.testing.assert_close(
        medium.sigma_tr_classical, torch.sqrt(3 * medium.sigma_a * medium.sigma_t_prime)
    )
    # Grosjean's D as printed: (2 σa + σs') / 3 σt'²
    printed = (2 * medium.sigma_a + medium.sigma_s_prime) / (3 * medium.sigma_t_prime**2)
    torch.testing.assert_close(medium.D, printed)
    torch.testing.assert_close(medium.z_b, 2 * medium.D)


def test_limits_are_defined():
    white = preset("spectralon")
    assert bool(torch.isinf(white.diffusion_length).all()) and bool((white.sigma_tr == 0).all())
    clear = Medium(0.0, 0.0)
    assert float(clear.albedo_prime) == 0 and math.isinf(clear.mean_free_path) and float(clear.sigma_tr) == 0


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_media(name):
    medium = preset(name)
    assert medium.channels == 3 and bool((medium.sigma_s > 0).all())


def test_skin_of_jensen():
    skin = preset("Skin1")
    torch.testing.assert_close(skin.sigma_s_prime, torch.tensor([0.74, 0.88, 1.01]).double())
    assert skin.eta == 1.3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sigma_a": -0.1, "sigma_s": 1.0}, "sigma_a: expected values >= 0"),
        ({"sigma_a": 0.1, "sigma_s": [1.0, -1.0, 1.0]}, "sigma_s: expected values >= 0"),
        ({"sigma_a": math.nan, "sigma_s": 1.0}, "finite"),
        ({"sigma_a": 0.1, "sigma_s": math.inf}, "finite"),
        ({"sigma_a": 0.1, "sigma_s": 1.0, "g": 1.0}, "-1 < g < 1"),
        ({"sigma_a": 0.1, "sigma_s": 1.0, "g": -1.0}, "-1 < g < 1"),
        ({"sigma_a": 0.1, "sigma_s": 1.0, "eta": 0.9}, "eta >= 1"),
        ({"sigma_a": 0.1, "sigma_s": 1.0, "eta": math.nan}, "eta >= 1"),
        ({"sigma_a": [0.1, 0.2], "sigma_s": [1.0, 1.0, 1.0]}, "channels"),
    ],
)
def test_media_check_themselves(arguments, message):
    with pytest.raises((DomainError, ShapeError), match=message) as error:
        Medium(**arguments)
    assert "\n" not in str(error.value)


def test_unknown_presets_list_the_choices():
    with pytest.raises(DomainError, match=r"marble.*skin1.*got 'granite'"):
        preset("granite")


@pytest.mark.parametrize("thickness", [-1.0, math.nan, [1.0, -0.5, 1.0]])
def test_layers_refuse_impossible_thickness(thickness):
    with pytest.raises(DomainError, match="thickness"):
        Layer(preset("skin1"), thickness)


def test_stacks_check_themselves():
    with pytest.raises(ShapeError, match="at least one layer"):
        Stack([])
    with pytest.raises(DomainError, match="only the last"):
        Stack([Layer(preset("skin1")), Layer(preset("skin2"))])
    with pytest.raises(ShapeError, match="channels"):
        Stack([Layer(Medium([0.1, 0.2], 1.0), 1.0), Layer(preset("skin1"))])


def test_numbers_triples_and_maps_mix():
    grey, coloured = torch.rand(4, 5), torch.rand(4, 5, 3)
    stack = Stack([Layer(Medium(grey, 1.0, 0.0), coloured), Layer(preset("skin1"), 2.0)])
    table = stack.table()
    assert (
        stack.varies
        and table.batch == (4, 5)
        and table.sigma_a.shape == (4, 5, 2, 3)
        and not table.bottomless
    )
    torch.testing.assert_close(table.sigma_a[..., 0, 1], grey.to(table.sigma_a.dtype))
    torch.testing.assert_close(table.thickness[..., 0, :], coloured.to(table.sigma_a.dtype))
    torch.testing.assert_close(table.thickness[..., 1, :], torch.full_like(coloured, 2.0).double())
    uniform = Stack(preset("skin1")).table()
    assert uniform.batch == () and uniform.bottomless and bool(torch.isinf(uniform.thickness).all())


def test_maps_are_looked_up_at_texture_coordinates():
    """Sizes may differ there; a table on texels needs them equal."""
    ramp = (torch.arange(8.0) + 0.5) / 8
    stack = Stack([Layer(Medium(ramp.expand(6, 8), 1.0), torch.rand(3, 3)), Layer(preset("skin1"))])
    uv = torch.tensor([[0.25, 0.5], [0.5, 0.5], [0.7, 0.1]])
    table = stack.at(uv)
    torch.testing.assert_close(table.sigma_a[:, 0, 0].float(), uv[:, 0])
    with pytest.raises(ShapeError, match="maps of one size"):
        stack.table()


def test_mixing_by_a_mask():
    first, second = Medium([1.0, 2.0, 3.0], 1.0, 0.8), Medium(0.0, 3.0, 0.0)
    mask = torch.tensor([[0.0, 0.5, 1.0]])
    mixed = mix(first, second, mask)
    torch.testing.assert_close(mixed.sigma_a[0, 1].double(), torch.tensor([0.5, 1.0, 1.5]).double())
    # reduced scattering mixes linearly, too: g by the share of scattering
    expected = torch.lerp(first.sigma_s_prime, second.sigma_s_prime, torch.tensor(0.5).double())
    torch.testing.assert_close(mixed.sigma_s_prime[0, 1, :1].double(), expected, rtol=1e-6, atol=0)
    with pytest.raises(DomainError, match=r"0\.\.1"):
        mix(first, second, mask * 2)
    with pytest.raises(DomainError, match="one refractive index"):
        mix(first, Medium(0.1, 1.0, 0.0, 1.5), mask)
    with pytest.raises(ShapeError, match="one size"):
        mix(Medium(torch.rand(2, 2), 1.0), second, mask)


@settings(deadline=None)
@given(st.floats(0, 1e3), st.floats(0, 1e3), st.floats(-0.99, 0.99), st.floats(1, 2))
def test_any_medium_has_finite_albedo(sigma_a, sigma_s, g, eta):
    medium = Medium(sigma_a, sigma_s, g, eta)
    for share in (medium.albedo, medium.albedo_prime):
        assert 0 <= float(share) <= 1
    assert not bool(torch.isnan(medium.sigma_tr).any())


def test_a_number_has_no_gradient_and_no_warning():
    assert number("eta", torch.tensor([1.5], requires_grad=True)) == 1.5
    assert number("eta", -(10**400)) == -math.inf
