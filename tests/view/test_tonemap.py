"""Tone maps: laws that any of them must keep, and known values."""

import pytest
import torch

from texsss.errors import DomainError
from texsss.view.tonemap import NAMES, decode, encode, tonemap


@pytest.mark.parametrize("name", NAMES)
def test_grey_stays_grey_and_brighter_is_never_darker(name):
    grey = torch.logspace(-6, 5, 3000, dtype=torch.float64)[:, None, None].expand(-1, 1, 3).contiguous()
    shown = tonemap(grey, 0.0, name)
    assert float((shown.amax(-1) - shown.amin(-1)).max()) < 1e-12  # measured 6e-15
    assert float(shown[:, 0, 0].diff().min()) >= 0
    assert float(shown.min()) >= 0 and float(shown.max()) <= 1
    assert float(shown[0, 0, 0]) < 0.002 and float(shown[-1, 0, 0]) > 0.998


@pytest.mark.parametrize("name", NAMES)
def test_exposure_is_in_stops(name):
    image = torch.rand(4, 5, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(tonemap(image, 1.5, name), tonemap(image * 2**1.5, 0.0, name))


@pytest.mark.parametrize("name", NAMES)
def test_nothing_breaks_them(name):
    wild = torch.tensor([float("nan"), float("inf"), -float("inf"), -1.0, 3e38, 0.0]).reshape(2, 1, 3)
    shown = tonemap(wild, 3.0, name)
    assert bool(torch.isfinite(shown).all()) and float(shown.min()) >= 0 and float(shown.max()) <= 1


def test_middle_grey():
    """.18 → sRGB .461; AgX near .5 of the display's range; ACES as fitted, .358."""
    grey = torch.full((1, 1, 3), 0.18)
    shown = {name: float(tonemap(grey, 0.0, name)[0, 0, 0]) for name in NAMES}
    assert shown == pytest.approx({"linear": 0.4614, "agx": 0.4967, "aces": 0.3585}, abs=1e-3)


def test_agx_sends_bright_colours_to_white():
    red = torch.tensor([[[1.0, 0.1, 0.05]]])
    saturation = [
        float(1 - c.min() / c.max()) for c in (tonemap(red, ev, "agx")[0, 0] for ev in (0.0, 4.0, 8.0))
    ]
    assert saturation[0] > saturation[1] > saturation[2] and saturation[2] < 0.2


def test_encoding_round_trip():
    image = torch.rand(3, 4, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(decode(encode(image)), image, atol=1e-6, rtol=0)


def test_unknown_name_lists_the_choices():
    with pytest.raises(DomainError, match="linear, agx, aces"):
        tonemap(torch.zeros(1, 1, 3), 0.0, "filmic")
