"""Maps to look inside a bake: what they say about places with known answers."""

import math

import pytest
import torch
from test_methods import plain

from texsss.baker import Baker
from texsss.errors import DomainError


def test_seams_jump_where_diffusion_stops_and_nowhere_else(small):
    jump = {}
    for method in ("uv", "surface"):
        image = Baker().intermediate(plain(small, diffusion=method), "seam-jump")
        assert image.shape == (128, 128, 1)
        assert float(image[40:60, 40:60].abs().max()) == 0.0, "no seam runs there"
        jump[method] = float(image.amax())
    assert 0 < jump["surface"] < 0.6 * jump["uv"]


def test_the_metric_is_that_of_the_torus(small):
    """One texel spans 2π R / 128 around and 2π r / 128 through, R from 40 to 80, r 20."""
    longest, shortest, ratio = Baker().intermediate(plain(small), "metric").unbind(-1)
    longest, shortest = longest / (1 - longest), shortest / (1 - shortest)  # of the typical texel
    typical = math.sqrt(60 * 20)  # root of the mean area
    assert float(longest.amax()) == pytest.approx(80 / typical, rel=0.02)
    assert float(shortest.median()) == pytest.approx(20 / typical, rel=0.02)
    torch.testing.assert_close(ratio, shortest / longest)


def test_the_torus_is_as_thick_as_its_tube(small):
    image = Baker().intermediate(plain(small), "through-mm")
    # rays through the middle of the tube
    assert float(image.amin()) > 38 and float(image.amax()) < 42


def test_gaussians_get_smoother(small):
    baker, scene = Baker(), plain(small, diffusion="surface")
    spread = [float(baker.intermediate(scene, f"gaussian-{k}").std()) for k in (1, 4, 8)]
    assert spread == sorted(spread, reverse=True)
    with pytest.raises(DomainError, match="blurs no light"):
        baker.intermediate(plain(small, diffusion="octree"), "gaussian-1")


def test_unknown_names_list_the_choices(small):
    with pytest.raises(DomainError, match="seam-jump"):
        Baker().intermediate(plain(small), "seams")
