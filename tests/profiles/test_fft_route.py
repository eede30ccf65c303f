"""The grid of Fourier transforms against the closed form in Hankel space."""

import pytest
import torch

from texsss.errors import DomainError
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.profiles.fft_route import fft_combined
from texsss.profiles.multipole import stacked

TWO = Stack([Layer(Medium(0.1, 1.0, 0.0, 1.4), 2.0), Layer(Medium(0.3, 1.5, 0.0, 1.3))]).table()
SLABS = Stack([Layer(Medium(0.2, 1.0, 0.0, 1.3), 1.5), Layer(Medium(0.1, 0.8, 0.0, 1.3), 2.0)]).table()


@pytest.mark.parametrize("table", [TWO, SLABS], ids=["half-space below", "two slabs"])
def test_both_routes_combine_layers_alike(table):
    """Reflectance and transmittance from both sides; measured 2e-6 of R(0)."""
    s, whole = fft_combined(table, 0.25, 128)
    few = slice(0, 32)  # up to half of the grid's Nyquist frequency
    exact = stacked(table, s[few], pairs=2)
    for ours, truth in zip(whole, exact, strict=True):
        torch.testing.assert_close(ours[few], truth, rtol=0, atol=1e-5 * float(exact.R_plus[0]))


def test_a_coarse_grid_misses():
    """Half a mean free path: 6e-4 of R(0), by aliasing."""
    s, whole = fft_combined(TWO, 0.5, 64)
    exact = stacked(TWO, s[:16], pairs=2)
    assert 1e-4 < float((whole.R_plus[:16] - exact.R_plus).abs().max() / exact.R_plus[0]) < 2e-3


def test_grids_have_points():
    with pytest.raises(DomainError, match="expected at least 2 points"):
        fft_combined(TWO, 0.0, 64)
