"""Panoramas: furnaces, orientation, densities, noise."""

import math

import pytest
import torch
from shapes import scatter, sphere, square, together

from texsss.errors import DomainError
from texsss.light.emitters import POOL, ConstantEnvironment, tilted
from texsss.light.environment import ImageEnvironment
from texsss.light.irradiance import irradiance
from texsss.light.sky import _sphere
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.types import unit


def spotted(row: int, column: int, height: int = 32, width: int = 64) -> torch.Tensor:
    image = torch.zeros(height, width, 3)
    image[row, column] = 1.0
    return image


def test_white_furnace_whatever_the_rotation():
    """E = π L F_dt in 36 steps of 10°; measured 4e-4: the sum over cells."""
    mesh = sphere(subdivisions=2)
    points, occluder = scatter(mesh, 100), Occluder(mesh)
    expected = torch.full((100, 3), math.pi * fresnel.F_dt(1.4))
    for step in range(36):
        turned = ImageEnvironment(torch.full((16, 32, 3), 2.0), math.radians(10 * step), intensity=0.5)
        entered = irradiance(points, mesh, [turned], eta=1.4, occluder=occluder, environment_samples=16)
        torch.testing.assert_close(entered, expected, rtol=2e-3, atol=0)


@pytest.mark.parametrize(
    "column,direction", [(32, (0, 0, -1)), (48, (1, 0, 0)), (0, (0, 0, 1)), (16, (-1, 0, 0))]
)
def test_orientation(column, direction):
    """The centre lies at -z, to its right +x; a quarter turn brings -z to -x."""
    light = ImageEnvironment(spotted(16, column))
    axis = torch.tensor([direction]).float()
    assert float(light.radiance_from(axis)[0, 0]) > 0.2
    turned = ImageEnvironment(spotted(16, column), rotation=math.pi / 2)
    x, y, z = direction
    assert float(turned.radiance_from(torch.tensor([[z, y, -x]]).float())[0, 0]) > 0.2
    top = ImageEnvironment(spotted(0, 0))
    assert float(top.radiance_from(unit(torch.tensor([[0.0, 1.0, 0.05]])))[0, 0]) > 0.2


def test_rotation_by_the_object_or_by_the_light():
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(16, 32, 3, generator=generator)
    normal = unit(torch.randn(50, 3, generator=generator))
    turn = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # a quarter about +y
    still = ImageEnvironment(image).unoccluded(1.3)(normal)
    turned = ImageEnvironment(image, rotation=math.pi / 2).unoccluded(1.3)(normal @ turn.T)
    torch.testing.assert_close(still, turned, rtol=1e-4, atol=1e-5)


def test_samples_agree_with_the_sum():
    """The estimator by both densities has the mean of the sum over cells, for a panorama with a sun."""
    image = torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(1)) + spotted(6, 20) * 300
    light = ImageEnvironment(image, rotation=0.5)
    normal = unit(torch.tensor([[0.3, 0.8, -0.4]])).expand(100_000, 3)
    draw = torch.rand(100_000, 2, generator=torch.Generator().manual_seed(2))
    seen = light.sample(torch.zeros_like(normal), normal, draw)
    cosine = (seen.direction * normal).sum(-1).clamp_min(0)
    mean = (seen.irradiance[:, 0] * cosine).mean()
    expected = light.unoccluded(1.0)(normal[:1])[0, 0]
    assert float(mean) == pytest.approx(float(expected), rel=0.02)
    assert float(seen.irradiance.max() / expected) < 100  # no fireflies


def test_looks_agree_with_the_sum():
    """Both kinds of looks together have the mean of the sum over cells; measured .3 and .9 %."""
    image = torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(1)) + spotted(6, 20) * 300
    light = ImageEnvironment(image, rotation=0.5)
    cells = torch.arange(POOL * POOL)
    around = _sphere(torch.Generator().manual_seed(2))
    for direction in ([0.3, 0.8, -0.4], [0.1, -0.9, 0.2]):
        normal = unit(torch.tensor([direction])).expand(len(cells), 3)
        found = sum(light.look(bright, cells, around, normal)[1].mean(0) for bright in (True, False))
        torch.testing.assert_close(found, light.unoccluded(1.0)(normal[:1])[0], rtol=0.02, atol=0)


def test_looks_around_are_distributed_as_the_cosine():
    """Mean of cos^n over the density cos/π: 2 / (n + 2)."""
    normal = unit(torch.tensor([[0.3, 0.8, -0.4]])).expand(POOL * POOL, 3)
    direction, cosine = tilted(normal, _sphere(torch.Generator().manual_seed(0)))
    torch.testing.assert_close(cosine, (direction * normal).sum(-1), rtol=0, atol=1e-4)
    for power in (1, 2, 5):
        assert float((cosine**power).mean()) == pytest.approx(2 / (power + 2), rel=2e-3)


@pytest.mark.parametrize("height", [250, 750, 1024])
def test_large_panoramas_lose_no_light(height):
    """Merged into the grids of samples and of the sum, whether these divide it or not."""
    light = ImageEnvironment(torch.ones(height, 2 * height, 3))
    _, rows, _ = light._chances
    assert float(rows[-1]) == pytest.approx(1)
    normal = unit(torch.randn(9, 3, generator=torch.Generator().manual_seed(3)))
    torch.testing.assert_close(light.unoccluded(1.0)(normal), torch.full((9, 3), math.pi), rtol=2e-3, atol=0)


def test_sharing_lowers_noise_and_keeps_the_mean():
    mesh = together(square(100.0), square(100.0).moved(square(100.0).vertices[:, [2, 1, 0]] * -1))
    points = scatter(mesh, 4000, faces=slice(0, 2))
    lights, occluder = [ConstantEnvironment((1, 1, 1))], Occluder(mesh)

    def noise(samples: int, sharing: int) -> tuple[float, float]:
        got = irradiance(
            points, mesh, lights, occluder=occluder, environment_samples=samples, sharing=sharing
        )
        return float((got - exact)[:, 0].std()), float(got.mean())

    exact = irradiance(points, mesh, lights, occluder=occluder, environment_samples=512, sharing=1)
    (alone, _), (shared, mean) = noise(8, 1), noise(128, 16)
    assert shared < alone / 2
    assert mean == pytest.approx(float(exact.mean()), rel=0.01)


def test_bad_panoramas_are_refused():
    with pytest.raises(DomainError, match="finite radiance"):
        ImageEnvironment(torch.full((2, 4, 3), float("nan")))
    with pytest.raises(DomainError, match="intensity"):
        ImageEnvironment(torch.ones(2, 4, 3), intensity=-1.0)
