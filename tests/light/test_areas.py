"""Lights with a size or a cone: limits and closed forms."""

import math

import pytest
import torch
from shapes import square

from texsss.errors import DomainError
from texsss.light.areas import RectangleLight, SphereLight
from texsss.light.emitters import PointLight, SpotLight
from texsss.light.irradiance import irradiance
from texsss.surface.points import Points

HERE = Points(torch.tensor([0]), torch.tensor([[0.5, 0.0, 0.5]]))  # the origin, facing +z


def entered(light, samples: int = 256) -> float:
    return float(irradiance(HERE, square(1.0), [light], area_samples=samples)[0, 0])


@pytest.mark.parametrize("side", [1.0, 0.1])
def test_small_areas_are_points(side):
    """100 mm away; the rest is the area's own curvature, side² / distance²."""
    panel = RectangleLight((0, 0, 100), (side, 0, 0), (0, -side, 0), (2e6, 1, 1))
    ball = SphereLight((0, 0, 100), side, (2e6, 1, 1))
    point = entered(PointLight((0, 0, 100), (2.0, 1, 1)))
    assert entered(panel) == pytest.approx(point * side**2, rel=1e-4 + 2e-4 * side**2)
    assert entered(ball) == pytest.approx(point * math.pi * side**2, rel=1e-4 + 2e-4 * side**2)


def test_ball_above_the_horizon():
    """E = π L sin² of its half angle, however near."""
    for distance in (11.0, 20.0, 1e4):
        ball = SphereLight((0, 0, distance), 10.0, (1, 1, 1))
        # measured 4e-3 at 11 mm
        assert entered(ball) == pytest.approx(math.pi * (10 / distance) ** 2, rel=6e-3)


def test_wide_panel():
    """A square panel straight above, by the closed form of its configuration factor."""
    a = 50.0 / 100.0  # half side over distance
    factor = 4 / (2 * math.pi) * 2 * a / math.sqrt(1 + a * a) * math.atan(a / math.sqrt(1 + a * a))
    panel = RectangleLight((0, 0, 100), (100, 0, 0), (0, -100, 0), (1, 1, 1))
    assert entered(panel, 1024) == pytest.approx(math.pi * factor, rel=2e-3)  # measured 3e-4


def test_panels_shine_to_one_side():
    assert entered(RectangleLight((0, 0, 100), (10, 0, 0), (0, 10, 0), (1, 1, 1))) == 0


@pytest.mark.parametrize("angle,share", [(0.0, 1.0), (0.29, 1.0), (0.35, None), (0.41, 0.0), (3.0, 0.0)])
def test_spots_have_a_cone(angle, share):
    aim = (math.sin(angle), 0.0, -math.cos(angle))
    spot = SpotLight((0, 0, 100), (1, 1, 1), aim, inner=0.3, outer=0.4)
    part = entered(spot) / entered(PointLight((0, 0, 100), (1, 1, 1)))
    assert 0 < part < 1 if share is None else part == pytest.approx(share)


def test_bad_lights_are_refused():
    with pytest.raises(DomainError, match="radius"):
        SphereLight((0, 0, 0), 0.0, (1, 1, 1))
    with pytest.raises(DomainError, match="area"):
        RectangleLight((0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 1))
    with pytest.raises(DomainError, match="inner"):
        SpotLight((0, 0, 0), (1, 1, 1), (0, 0, 1), inner=0.5, outer=0.4)


@pytest.mark.parametrize(
    "centre, width, height, noise",
    [
        ((0, 0, 50), (1000, 0, 0), (0, -1000, 0), 0.08),  # near and large: by area one look in ten glares
        ((0, 0, 1000), (1e6, 0, 0), (0, -1e6, 0), 0.08),
        ((60, 0, 520), (0, 0, 1000), (0, 5, 0), 0.06),  # a strip that rises beside the point
        ((0, 50, 200), (300, 0, 80), (50, -200, 30), 0.04),  # its edges are not perpendicular
        ((0, 0, 1e6), (1, 0, 0), (0, -1, 0), 1e-4),
    ],
)
def test_panels_send_what_their_polygon_does(centre, width, height, noise):
    """E = L/2 Σ of the angles of its sides times the cosines of their planes (Lambert 1760), every seed."""
    centre, width, height = (torch.tensor(x, dtype=torch.float64) for x in (centre, width, height))
    corners = [centre + (a * width + b * height) / 2 for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    truth = 0.0
    for a, b in zip(corners, corners[1:] + corners[:1]):
        across = torch.linalg.cross(a, b)
        angle = torch.atan2(across.norm(), a @ b)
        truth -= float(angle * across[2] / across.norm()) / 2
    panel = RectangleLight(centre, width, height, (1, 1, 1))
    found = torch.tensor(
        [float(irradiance(HERE, square(1.0), [panel], area_samples=16, seed=s)[0, 0]) for s in range(24)]
    )
    assert float((found / truth - 1).square().mean().sqrt()) < noise
    assert float(found.mean()) == pytest.approx(truth, rel=noise / 3)
    assert float(found.max()) < math.pi * 1.25, "the most that one look stands for is the whole panel"


def test_lights_beyond_all_measure_are_refused():
    with pytest.raises(DomainError, match=r"1e\+18"):
        PointLight((0, 0, 100), (1e38, 1, 1))
