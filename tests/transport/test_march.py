"""The march: closed forms, limits, its literal twin, laws."""

import math
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest
import torch
from march_shapes import SUN, UNIT, centre, fish, hills, scattered_points, square, steps, veins
from march_twin import Layered, Site, march_one
from reference.transport import read_transport

from texsss.light.areas import SphereLight
from texsss.light.emitters import ConstantEnvironment, DirectionalLight, PointLight
from texsss.light.visibility import Occluder
from texsss.look import scattered_once
from texsss.media import fresnel
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.methods import MarchSpec
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.transport.march import march as module
from texsss.transport.march.gatherer import Gatherer
from texsss.transport.march.interior import from_depths, from_stack
from texsss.transport.march.march import March, march
from texsss.transport.march.noise import Noise
from texsss.transport.march.planes import fit_planes, tangent_planes
from texsss.transport.march.setup import Surface
from texsss.types import unit
from texsss.view.camera import Hits


def closed_form(media, thickness, view_cos, light_cos, straight) -> torch.Tensor:
    """Radiance of flat layers under distant light of unit irradiance facing it, all inside."""
    slant = 1 / view_cos + 1 / light_cos
    total = above = torch.zeros(3, dtype=torch.float64)
    for medium, d in zip(media, thickness):
        g = medium.g.double()
        phase = (1 - g * g) / (4 * math.pi * (1 + g * g + 2 * g * straight) ** 1.5)
        below = above + medium.sigma_t.double() * d
        step = torch.exp(-above * slant) - torch.exp(-below * slant)
        total = total + medium.sigma_s.double() * phase / view_cos / (medium.sigma_t.double() * slant) * step
        above = below
    return total


@pytest.mark.parametrize("last", [1.5, math.inf])
@pytest.mark.parametrize("samples", [1, 2, 4, 9])
@pytest.mark.parametrize("eye", [(0.5, 0.7, 0.2), (0.0, 1.0, 0.0), (0.99, 0.1, 0.0)])
def test_flat_layers_are_exact_with_any_number_of_steps(last, samples, eye):
    """float32; measured 2e-7."""
    thickness = [0.3, 0.5, last]
    stack = Stack([Layer(m, d) for m, d in zip(fish(), thickness)])
    view, sun = unit(torch.tensor(eye)), unit(torch.tensor(SUN))
    lit = march(
        centre(3), square(), None, stack, [DirectionalLight(SUN, UNIT)], view.expand(3, 3), samples=samples
    )
    straight = float(view.double() @ sun.double())
    truth = closed_form(fish(), thickness, float(view[1]), float(sun[1]), straight)
    torch.testing.assert_close(lit.double(), truth.expand(3, 3), rtol=1e-6, atol=0)


def test_layers_of_no_thickness_are_not_there():
    media = fish()
    view = unit(torch.tensor([0.5, 0.7, 0.2])).expand(2, 3)
    lights = [DirectionalLight(SUN, UNIT)]
    empty = Stack([Layer(media[1], 0.0), Layer(media[0], 0.4), Layer(media[1], 0.0), Layer(media[2])])
    plain = Stack([Layer(media[0], 0.4), Layer(media[2])])
    for method, samples in (("exact", 3), ("uniform", 50)):
        with_empty, without = (
            march(centre(2), square(), None, s, lights, view, method=method, samples=samples)
            for s in (empty, plain)
        )
        torch.testing.assert_close(with_empty, without, rtol=1e-5, atol=0)


def test_uniform_samples_converge_at_first_order():
    """Half the step, half the error: the sum takes each step's light from its start."""
    view = unit(torch.tensor([0.5, 0.7, 0.2], dtype=torch.float64)).expand(1, 3)
    stack = Stack([Layer(fish()[0], 2.0)])
    args = (centre(1), square(torch.float64), None, stack, [DirectionalLight(SUN, UNIT)], view)
    truth = march(*args, samples=1)
    counts = (50, 100, 200)
    errors = [float((march(*args, method="uniform", samples=n) - truth).mean().abs()) for n in counts]
    orders = [math.log2(a / b) for a, b in pairwise(errors)]
    # measured 1.04, 1.02
    assert all(0.98 < order < 1.06 for order in orders), orders


@pytest.mark.parametrize("depths", [veins, steps], ids=["veins", "steps"])
def test_four_exact_steps_beat_a_hundred_samples(depths):
    """RMSE as a share of the mean, against 1600 samples and their first-order error removed."""
    mesh = hills()
    points = scattered_points(mesh, 150, seed=2)
    interior = from_depths(depths(), fish())
    args = (points, mesh, fit_planes(mesh, 2.0), interior, [PointLight([5.0, 40.0, 10.0], UNIT)])
    eye = torch.tensor([3.0, 40, 9])
    fine, coarse = (march(*args, eye, method="uniform", samples=n) for n in (1600, 800))
    truth = 2 * fine - coarse

    def rmse(method: str, samples: int) -> float:
        image = march(*args, eye, method=method, samples=samples)
        return float(((image - truth) ** 2).mean().sqrt() / truth.mean())

    exact, uniform = rmse("exact", 4), rmse("uniform", 100)
    assert exact < uniform / 3, (exact, uniform)
    assert exact < 0.02


@pytest.mark.parametrize("seed", range(3))
def test_uniform_march_is_its_literal_twin(seed):
    """Curved surface, near light, veins, Schlick: the scalar algebra is Algorithms 1 and 2 as mended."""
    mesh = hills()
    points = scattered_points(mesh, 12, seed=seed)
    planes = fit_planes(mesh, 2.0)
    depth = veins()
    light = torch.tensor([2.0, 6.0, -3.0], dtype=torch.float64)
    eye = torch.tensor([4.0, 30.0, 12.0], dtype=torch.float64)
    interior = from_depths(depth, fish())
    for samples in (1, 7, 25):
        ours = march(
            points, mesh, planes, interior, [PointLight(light, UNIT)], eye, method="uniform", samples=samples,
            phase="schlick",
        )  # fmt: skip
        layered = Layered(
            depth.numpy(), *(x.numpy() for x in (interior.sigma_s, interior.sigma_t, interior.g[:, 0]))
        )
        sites = Surface(mesh, planes, mesh.source_uv).at(points)
        for p in range(len(points)):
            a, b, c = sites.per_mm[p].numpy()
            site = Site(
                sites.position[p].numpy(), sites.normal[p].numpy(), sites.plane_normal[p].numpy(),
                float(sites.offset[p]), sites.tangent[p].numpy(),
                sites.bitangent[p].numpy(), sites.uv[p].numpy(),
                np.array([[a, b], [0, c]]),
            )  # fmt: skip
            towards = unit(eye - sites.position[p]).numpy()
            twin = march_one(site, layered, towards, light.numpy(), np.full(3, 1e6), samples)
            np.testing.assert_allclose(ours[p].numpy(), twin, rtol=1e-9)


def test_views_of_a_slab_add_up_to_its_single_scattering(shared_data):
    """∫ L cos dω over the hemisphere = R1 of the integral transport equation, eta 1 to 1.5.

    48 Gauss nodes in μ.
    """
    x, w = np.polynomial.legendre.leggauss(48)
    mu = torch.from_numpy((x + 1) / 2).float()
    view = torch.stack([torch.sqrt(1 - mu**2), mu, torch.zeros_like(mu)], -1)
    weight = torch.from_numpy(w / 2) * 2 * math.pi * mu
    checked = set()
    for case in read_transport(shared_data):
        eta = case.layers[0].eta
        layers = [
            Layer(Medium([la.sigma_a] * 3, [la.sigma_s] * 3, 0.0, eta), la.thickness) for la in case.layers
        ]
        light = DirectionalLight([0.0, 1.0, 0.0], UNIT)
        radiance = march(centre(48), square(), None, Stack(layers), [light], view)
        total = float((radiance[:, 0] * weight).sum()) / fresnel.transmittance(1.0, eta)
        bounces = not math.isinf(case.layers[-1].thickness) and eta > 1
        # slabs of eta > 1 also reflect the beam from below, which the march leaves out
        if not bounces:
            assert total == pytest.approx(case.R1[0], rel=0.01), case.name
            checked.add(eta)
    assert {1.0, 1.4} <= checked


def test_refraction_keeps_phase_function_and_eta_apart():
    """g ≠ 0 and eta 1.4 in closed form: both rays bent, flux kept on entry, radiance / eta² on exit."""
    eta = 1.4
    media = fish(eta)
    eye, sun = unit(torch.tensor([0.5, 0.7, 0.2])), unit(torch.tensor(SUN))
    inner = [
        unit(torch.tensor([v[0] / eta, math.sqrt(1 - (1 - float(v[1]) ** 2) / eta**2), v[2] / eta]))
        for v in (eye, sun)
    ]
    truth = closed_form(
        media, [0.3, 0.5, 1.5], float(inner[0][1]), float(inner[1][1]), float(inner[0] @ inner[1])
    )
    entry = fresnel.transmittance(float(sun[1]), eta) * float(sun[1]) / float(inner[1][1])
    exit_ = fresnel.transmittance(float(eye[1]), eta) / eta**2
    stack = Stack([Layer(m, d) for m, d in zip(media, [0.3, 0.5, 1.5])])
    lit = march(centre(1), square(), None, stack, [DirectionalLight(SUN, UNIT)], eye[None])
    torch.testing.assert_close(lit[0].double(), truth * entry * exit_, rtol=2e-6, atol=0)


def test_light_adds_up_and_scales():
    mesh = hills(torch.float32)
    points = scattered_points(mesh, 100, seed=5)
    interior = from_depths(veins(dtype=torch.float32), fish())
    eye = torch.tensor([4.0, 30.0, 12.0])
    sun, lamp = DirectionalLight(SUN, UNIT), PointLight([2.0, 6.0, -3.0], [1e-4, 2e-4, 3e-4])
    both = march(points, mesh, None, interior, [sun, lamp], eye)
    apart = [march(points, mesh, None, interior, [light], eye) for light in (sun, lamp)]
    torch.testing.assert_close(both, apart[0] + apart[1])
    # the same scene in other units: lengths × 16, coefficients / 16; radii of planes are rounded per doubling
    large = mesh.moved(mesh.vertices * 16)
    media = [Medium(m.sigma_a / 16, m.sigma_s / 16, m.g, m.eta) for m in fish()]
    scaled = march(points, large, None, from_depths(veins(dtype=torch.float32) * 16, media), [sun], eye * 16)
    torch.testing.assert_close(scaled, apart[0], rtol=1e-3, atol=1e-6)


def test_sky_is_what_many_suns_add_up_to():
    """A constant sky over a flat slab, against 16 × 6 directions of its hemisphere."""
    x, w = np.polynomial.legendre.leggauss(16)
    mu, eye = (x + 1) / 2, unit(torch.tensor([0.3, 0.9, 0.1]))
    stack = Stack([Layer(m, d) for m, d in zip(fish(), [0.3, 0.5, 1.5])])
    suns = [
        DirectionalLight(
            [math.sqrt(1 - m * m) * math.cos(a), float(m), math.sqrt(1 - m * m) * math.sin(a)], [v] * 3
        )
        for m, v in zip(mu, w * math.pi / 6)
        for a in np.arange(6) * math.pi / 3
    ]
    truth = march(centre(1), square(), None, stack, suns, eye[None])
    sky = march(
        centre(2000),
        square(),
        None,
        stack,
        [ConstantEnvironment(UNIT)],
        eye.expand(2000, 3),
        environment_samples=64,
    )
    # the mean over points takes the noise away; measured 3e-3
    torch.testing.assert_close(sky.mean(0), truth[0], rtol=1e-2, atol=0)


@pytest.mark.parametrize("light", [ConstantEnvironment(UNIT), SphereLight([0.0, 30.0, 0.0], 20.0, UNIT)])
def test_one_sample_of_a_large_light_is_a_random_one(light):
    """So that its mean over points is that of many; measured 2 %, noise included."""
    view = unit(torch.tensor([0.3, 0.9, 0.1])).expand(4000, 3)
    args = (centre(4000), square(), None, Stack([Layer(fish()[0])]), [light], view)
    one, many = (march(*args, environment_samples=k, area_samples=k, compiled=True).mean() for k in (1, 16))
    assert float(one) == pytest.approx(float(many), rel=0.03)


def test_every_ray_of_a_pixel_samples_the_sky_by_itself():
    """So that more rays lessen the noise; and the maps are packed once for all of them."""
    mesh, view = square(), unit(torch.tensor([0.3, 0.9, 0.1])).expand(500, 3)
    once = scattered_once(
        Stack([Layer(fish()[0])]), mesh, tangent_planes(mesh), [ConstantEnvironment(UNIT)],
        atlas_uv=mesh.source_uv, scale=None, how=MarchSpec(), seed=0, method="exact", samples=4, pixels=1,
        bumps=lambda points: None,
    )  # fmt: skip
    rays = [once(Hits(torch.arange(500), centre(500), view, torch.ones(500), k))[:, 0] for k in range(9)]
    assert float(torch.corrcoef(torch.stack(rays[1:3]))[0, 1]) < 0.2
    mean, one = torch.stack(rays).mean(0), rays[0]
    assert float(mean.std() / mean.mean()) < 0.5 * float(one.std() / one.mean())


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("method", ["exact", "uniform"])
def test_an_object_ends_where_it_is_thin(method, compiled):
    """A half-space of some thickness is the slab, and of none it is dark; measured 3e-7."""
    view = unit(torch.tensor([0.5, 0.7, 0.2])).expand(3, 3)
    how = {"method": method, "samples": 8}
    light, thickness = [DirectionalLight(SUN, UNIT)], torch.tensor([0.0, 0.7, math.inf])
    endless = March(square(), None, Stack([Layer(fish()[0])]), light, **how)
    lit = endless(centre(3), view, thickness=thickness, compiled=compiled)
    slab = march(centre(3), square(), None, Stack([Layer(fish()[0], 0.7)]), light, view, **how)
    torch.testing.assert_close(lit[1], slab[1], rtol=1e-5, atol=0)
    assert float(lit[0].max()) < 1e-4 * float(lit[1].min())
    torch.testing.assert_close(lit[2], endless(centre(3), view, compiled=compiled)[2], rtol=0, atol=0)


@pytest.mark.parametrize("compiled", [False, True])
def test_a_march_is_made_once_for_all_that_see_it(compiled, monkeypatch):
    mesh = hills(torch.float32)
    points = scattered_points(mesh, 90, seed=3)
    args = (mesh, None, from_depths(veins(dtype=torch.float32), fish()), [DirectionalLight(SUN, UNIT)])
    made, eye = [], torch.tensor([4.0, 30.0, 12.0])
    monkeypatch.setattr(module, "Gatherer", lambda *how: made.append(how) or Gatherer(*how))
    ready = March(*args)
    assert not made
    with ThreadPoolExecutor(3) as pool:
        parts = pool.map(lambda k: ready(points[k : k + 30], eye, compiled=compiled), range(0, 90, 30))
        together = torch.cat(list(parts))
    assert len(made) == 1
    apart = [march(points[k : k + 30], *args, eye, compiled=compiled) for k in range(0, 90, 30)]
    assert torch.equal(together, torch.cat(apart))


def test_shadows_fall_where_something_stands_in_the_light():
    ground = square(edge=40.0)
    roof = square(edge=20.0)
    vertices = torch.cat([ground.vertices, roof.vertices + torch.tensor([0.0, 10.0, 0.0])])
    faces = torch.cat([ground.faces, roof.faces + 4])
    mesh = Mesh(vertices, faces, torch.cat([ground.source_uv, roof.source_uv]))
    # the centre lies under the roof, the corner does not
    points = Points(torch.tensor([0, 0]), torch.tensor([[0.5, 0.0, 0.5], [0.98, 0.01, 0.01]]))
    stack = Stack([Layer(fish()[0])])
    view = torch.tensor([0.0, 1.0, 0.0]).expand(2, 3)
    light = [DirectionalLight([0.0, 1.0, 0.0], UNIT)]
    open_air = march(points, mesh, None, stack, light, view)
    shadowed = march(points, mesh, None, stack, light, view, occluder=Occluder(mesh))
    assert float(shadowed[0].abs().max()) == 0
    torch.testing.assert_close(shadowed[1], open_air[1])


def test_maps_of_coefficients_agree_with_numbers():
    """A stack with constant maps is the stack with numbers; one texel of pigment shows only near itself."""
    mesh = hills()
    points = scattered_points(mesh, 60, seed=9)
    plain = Medium([0.6, 0.6, 0.6], [2.0, 1.0, 1.0], 0.3)
    mapped = Medium(torch.full((16, 16, 3), 0.6, dtype=torch.float64), plain.sigma_s, 0.3)
    eye, lights = torch.tensor([4.0, 30.0, 12.0]), [DirectionalLight(SUN, UNIT)]
    thickness = torch.full((8, 8), 0.4, dtype=torch.float64)
    numbers, maps = (
        march(points, mesh, None, Stack([Layer(m, thickness), Layer(plain)]), lights, eye)
        for m in (plain, mapped)
    )
    torch.testing.assert_close(maps, numbers, rtol=1e-10, atol=0)


def test_noise_is_seeded_bounded_and_sticks_to_the_surface():
    mesh = hills()
    points = scattered_points(mesh, 60, seed=4)
    interior = from_depths(veins(), fish())
    eye, lights = torch.tensor([4.0, 30.0, 12.0]), [DirectionalLight(SUN, UNIT)]
    cloud = torch.rand(32, 32, generator=torch.Generator().manual_seed(0))

    def shot(noise: Noise | None, seed: int) -> torch.Tensor:
        return march(
            points, mesh, None, interior, lights, eye, method="uniform", samples=20, noise=noise, seed=seed
        )

    still = shot(None, 0)
    torch.testing.assert_close(shot(Noise(), 0), still)
    jittered = shot(Noise(uv=0.01, start=1.0), 3)
    assert torch.equal(jittered, shot(Noise(uv=0.01, start=1.0), 3))
    assert not torch.equal(jittered, shot(Noise(uv=0.01, start=1.0), 4))
    painted = Noise(uv=0.01, start=1.0, texture=cloud)
    assert torch.equal(shot(painted, 3), shot(painted, 4))
    assert bool(torch.isfinite(jittered).all())


def test_texels_and_hits_are_the_same_to_it():
    """An eye and the directions towards it; chunks of either make no difference."""
    mesh = hills(torch.float32)
    points = scattered_points(mesh, 50, seed=6)
    eye = torch.tensor([4.0, 30.0, 12.0])
    interior = from_stack(Stack([Layer(m, d) for m, d in zip(fish(), [0.3, 0.5, 1.5])]))
    lights = [DirectionalLight(SUN, UNIT)]
    texels = march(points, mesh, None, interior, lights, eye)
    hits = march(points, mesh, None, interior, lights, unit(eye - points.position(mesh)))
    torch.testing.assert_close(texels, hits)
