"""Bands of frequencies end where the light that comes back has no finer structure."""

import pytest
import torch

from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.bands import bands, extinction

SKIN, INK = preset("skin1"), Medium(100.0, 0.0)
BENEATH = float(SKIN.sigma_t_prime.max())


@pytest.mark.parametrize(
    ("stack", "met"),
    [
        ([Layer(SKIN)], BENEATH),
        ([Layer(INK)], 100.0),
        ([Layer(INK, 0.02), Layer(SKIN)], BENEATH),
        ([Layer(Medium(0.0, 0.0), 3.0), Layer(SKIN)], BENEATH),
        ([Layer(SKIN, 20.0), Layer(Medium(0.0, 50.0))], BENEATH),
        ([Layer(Medium(0.0, 10.0), 0.0), Layer(SKIN)], BENEATH),
        ([Layer(Medium(0.0, 8.0), float(torch.log(torch.tensor(2.0))) / 8), Layer(Medium(0.0, 2.0))], 4.0),
    ],
    ids=["one", "black", "beneath black", "beneath clear", "above", "beneath none", "half of each"],
)
def test_extinction_is_met_where_light_first_scatters(stack, met):
    """Of layers by what scatters there; half in either of two make their geometric mean."""
    assert float(extinction(Stack(stack).table())) == pytest.approx(met, rel=1e-6)


def test_bands_reach_twenty_mean_free_paths_and_share_rows_within_an_octave():
    """Every row once, and to the frequency of the densest of its band."""
    sigma_s = torch.tensor([[1.0, 1.9, 2.0, 7.0, 8.0]], dtype=torch.float64)
    table = Stack(Medium(0.0, sigma_s)).table()
    found = list(bands(table, 12, side="reflectance", model="layered-diffusion"))
    assert [band.rows.tolist() for band in found] == [[0, 1], [2], [3], [4]]
    assert [float(band.ds.sum()) for band in found] == pytest.approx([38.0, 40.0, 140.0, 160.0], rel=1e-6)
