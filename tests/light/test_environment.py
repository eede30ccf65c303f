"""Panoramas: furnaces, orientation, densities, noise."""

import math

import pytest
import torch
from shapes import scatter, sphere, square, together
from torch.quasirandom import SobolEngine

from texsss.errors import DomainError
from texsss.light.emitters import POOL, ConstantEnvironment, tilted
from texsss.light.environment import ImageEnvironment
from texsss.light.irradiance import irradiance
from texsss.light.panorama import centres, direction, solid_angle, turned
from texsss.light.sky import _sphere
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.types import unit


def spotted(row: int, column: int, height: int = 32, width: int = 64) -> torch.Tensor:
    image = torch.zeros(height, width, 3)
    image[row, column] = 1.0
    return image


def test_white_furnace_whatever_the_rotation():
    """E = π L F_dt; measured 4e-4: the sum over cells."""
    mesh = sphere(subdivisions=2)
    points, occluder = scatter(mesh, 100), Occluder(mesh)
    expected = torch.full((100, 3), math.pi * fresnel.F_dt(1.4))
    for angle in (0.0, 1.0, 4.0):
        light = ImageEnvironment(torch.full((16, 32, 3), 2.0), angle, intensity=0.5)
        entered = irradiance(points, mesh, [light], eta=1.4, occluder=occluder, environment_samples=16)
        torch.testing.assert_close(entered, expected, rtol=2e-3, atol=0)


def sunny(elevation: float, height: int = 64) -> torch.Tensor:
    """A sky over a dark ground, with a sun of 6° that brings about as much as the sky."""
    towards = direction(centres(height, 2 * height))
    high, around = math.radians(elevation), math.radians(20)
    sun = towards.new_tensor(
        [math.cos(high) * math.sin(around), math.sin(high), -math.cos(high) * math.cos(around)]
    )
    sky = torch.where(towards[:, 1] > 0, 0.3 + 0.7 * towards[:, 1], 0.2)
    sky = sky + 150 * (towards @ sun > math.cos(math.radians(3)))
    return sky[:, None].expand(-1, 3).reshape(height, 2 * height, 3).float().contiguous()


def summed(image: torch.Tensor, normal: torch.Tensor, eta: float) -> torch.Tensor:
    """Entered irradiance [W/m²] by the sum over all texels. float64."""
    power = (image.double() * solid_angle(*image.shape[:2])[:, None, None]).reshape(-1, 3)
    cosine = (normal.double() @ direction(centres(*image.shape[:2])).T).clamp_min(0)
    return (cosine * fresnel.transmittance(cosine, eta)) @ power


@pytest.mark.parametrize("elevation", [45, 15, 8])
def test_normals_that_look_up_and_down_receive_the_sum(elevation):
    """At the poles and around them in steps of 10°; measured 3e-3."""
    image = sunny(elevation)
    angle = torch.arange(36) * math.pi / 18
    rings = [
        torch.stack([off * torch.sin(angle), torch.ones(36), off * torch.cos(angle)], -1)
        for off in (0.0, 1e-7, 0.01, 0.03)
    ]
    normal = unit(torch.cat(rings + [-ring for ring in rings]))
    for eta in (1.0, 1.4):
        got = ImageEnvironment(image).unoccluded(eta)(normal)
        torch.testing.assert_close(got.double(), summed(image, normal, eta), rtol=6e-3, atol=0)


def test_a_turned_sun_changes_orientation_alone():
    """In 36 steps of 10°: a floor receives the same, other normals what they did before they turned along."""
    image = sunny(15)
    normal = unit(torch.randn(50, 3, generator=torch.Generator().manual_seed(4)))
    normal[0] = torch.tensor([0.0, 1.0, 0.0])
    still = ImageEnvironment(image).unoccluded(1.4)(normal)
    torch.testing.assert_close(still.double(), summed(image, normal, 1.4), rtol=0.02, atol=2e-3)
    for step in range(36):
        angle = math.radians(10 * step)
        received = ImageEnvironment(image, rotation=angle).unoccluded(1.4)
        torch.testing.assert_close(received(turned(normal, angle)), still, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(received(normal[:1]), still[:1], rtol=1e-4, atol=0)


def test_gradients_of_normals_are_finite_and_right():
    """Straight up, too, where a panorama has a pole."""
    normal = torch.tensor([[0.0, 1.0, 0.0], [0.6, 0.64, -0.48]], requires_grad=True)
    image, step = sunny(45), 0.03
    ImageEnvironment(image).unoccluded(1.0)(normal).sum().backward()
    for axis in range(3):
        moved = normal.detach().clone()
        moved[:, axis] += step
        back = 2 * normal.detach() - moved
        slope = (summed(image, unit(moved), 1.0) - summed(image, unit(back), 1.0)).sum(1) / (2 * step)
        # of slopes up to 9; the table's steps are finite
        assert float((normal.grad[:, axis] - slope).abs().max()) < 0.15


@pytest.mark.parametrize(
    "column,towards", [(32, (0, 0, -1)), (48, (1, 0, 0)), (0, (0, 0, 1)), (16, (-1, 0, 0))]
)
def test_orientation(column, towards):
    """The centre lies at -z, to its right +x; a quarter turn brings -z to -x."""
    light = ImageEnvironment(spotted(16, column))
    axis = torch.tensor([towards]).float()
    assert float(light.radiance_from(axis)[0, 0]) > 0.2
    turned = ImageEnvironment(spotted(16, column), rotation=math.pi / 2)
    x, y, z = towards
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
    for towards in ([0.3, 0.8, -0.4], [0.1, -0.9, 0.2]):
        normal = unit(torch.tensor([towards])).expand(len(cells), 3)
        found = sum(light.look(bright, cells, around, normal)[1].mean(0) for bright in (True, False))
        torch.testing.assert_close(found, light.unoccluded(1.0)(normal[:1])[0], rtol=0.02, atol=0)


def test_looks_around_are_distributed_as_the_cosine():
    """Mean of cos^n over the density cos/π: 2 / (n + 2)."""
    normal = unit(torch.tensor([[0.3, 0.8, -0.4]])).expand(POOL * POOL, 3)
    looked, cosine = tilted(normal, _sphere(torch.Generator().manual_seed(0)))
    torch.testing.assert_close(cosine, (looked * normal).sum(-1), rtol=0, atol=1e-4)
    for power in (1, 2, 5):
        assert float((cosine**power).mean()) == pytest.approx(2 / (power + 2), rel=2e-3)


@pytest.mark.parametrize("height", [250, 750, 1024])
def test_large_panoramas_lose_no_light(height):
    """Merged into the grids of samples and of the sum, whether these divide it or not."""
    light = ImageEnvironment(torch.ones(height, 2 * height, 3))
    assert float(light._chances.rows[-1]) == pytest.approx(1)
    normal = unit(torch.randn(9, 3, generator=torch.Generator().manual_seed(3)))
    torch.testing.assert_close(light.unoccluded(1.0)(normal), torch.full((9, 3), math.pi), rtol=2e-3, atol=0)


def test_shadows_of_a_sun_are_even():
    """Behind a wall a floor sees half of the sky, evenly: that the sun is hidden adds no noise."""
    wall = square(1e4).moved(square(1e4).vertices[:, [2, 1, 0]] - torch.tensor([20.0, 0, -5e3]))
    mesh = together(square(10.0), wall)
    points = scatter(mesh, 1000, faces=slice(0, 2))
    height = 128
    towards = direction(centres(height, 2 * height)).float()
    sun = (towards @ unit(torch.tensor([-1.0, 0, 1])) > math.cos(math.radians(2))).float()
    image = (1 + 1000 * sun)[:, None].expand(-1, 3).reshape(height, 2 * height, 3).contiguous()
    plain, lit = (
        irradiance(points, mesh, [ImageEnvironment(sky)], occluder=Occluder(mesh))[:, 0]
        for sky in (torch.ones_like(image), image)
    )
    assert float(lit.mean()) == pytest.approx(float(plain.mean()), rel=0.03)
    assert float(lit.std() / lit.mean()) < 2 * float(plain.std() / plain.mean())
    free = irradiance(points, mesh, [ImageEnvironment(image)])[:, 0]
    assert float(free.mean()) > 1.5 * float(lit.mean())


def test_parts_are_the_whole():
    light = ImageEnvironment(sunny(45))
    assert len(light.parts) == 2
    normal = unit(torch.randn(20, 3, generator=torch.Generator().manual_seed(1)))
    together = sum(part.unoccluded(1.4)(normal) for part in light.parts)
    torch.testing.assert_close(together, light.unoccluded(1.4)(normal), rtol=0.03, atol=2e-2)


def test_samples_of_a_part_add_up_to_its_light():
    """Those of the rest follow the cosine alone, those of the spots what shines alone, and find it."""
    light = ImageEnvironment(sunny(45))
    normal = unit(torch.tensor([[0.3, 0.8, -0.4]])).expand(4096, 3)
    square = SobolEngine(2, scramble=True, seed=0).draw(4096)
    for part in (*light.parts, light):
        seen = part.sample(torch.zeros_like(normal), normal, square)
        cosine = (seen.direction * normal).sum(-1, keepdim=True).clamp_min(0)
        got = (seen.irradiance * cosine).mean(0)
        # measured 9e-4
        torch.testing.assert_close(got, part.unoccluded(1.0)(normal[:1])[0], rtol=0.005, atol=0)
        # .95: texels of the sun's rim hold more than the looks that are drawn from them; by the cosine .01
        assert float((seen.irradiance > 0).any(-1).float().mean()) > 0.9


@pytest.mark.parametrize("lamps", [2, 60])
def test_mean_looks_are_all_light_from_few_directions(lamps):
    """However faint a lamp, and however many there are."""
    image = torch.zeros(64, 128, 3)
    place = torch.randperm(64 * 128, generator=torch.Generator().manual_seed(3))[:lamps]
    image.reshape(-1, 3)[place] = torch.logspace(0, 2, lamps)[:, None] * torch.tensor([1.0, 0.5, 0.2])
    light = ImageEnvironment(image, rotation=0.7, intensity=2.0)
    towards, brought = light.mean_looks(8)
    assert len(towards) <= 8
    whole = (image * solid_angle(64, 128)[:, None, None]).sum((0, 1)).float() * 2
    torch.testing.assert_close(brought.sum(0), whole, rtol=0.01, atol=0)
    if lamps == 2:
        # measured .3 %: of the faint one as of the bright one
        for normal in towards:
            found = (brought * (towards @ normal).clamp_min(0)[:, None]).sum(0)
            torch.testing.assert_close(found, light.unoccluded(1.0)(normal[None])[0], rtol=0.02, atol=0)


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
    with pytest.raises(DomainError, match=r"sky\.hdr: .* scale it down"):
        ImageEnvironment(torch.full((2, 4, 3), 3e38), name="sky.hdr")


def test_drawn_directions_carry_alike_in_panoramas_of_any_size():
    """Radiance over density of looks at what is bright: constant but for the floor, merged texels too."""
    fine = torch.rand(1024, 2048, 3, generator=torch.Generator().manual_seed(1)) ** 20 + 1
    pool = ImageEnvironment(fine)._pool
    carried = pool[:, 3:6].mean(1) / pool[:, 6]
    assert float(carried.std() / carried.mean()) < 0.01  # the floor's share
