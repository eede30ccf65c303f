"""Radiance towards the camera, and whole pictures."""

import math

import pytest
import torch
from shapes import sphere, square, together

from texsss.errors import Cancelled, DomainError
from texsss.light.emitters import ConstantEnvironment, DirectionalLight, PointLight
from texsss.light.environment import ImageEnvironment
from texsss.light.panorama import centres, direction, looked_up, solid_angle
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.numerics.sampling import Texture
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import unit
from texsss.view import ggx
from texsss.view.camera import Camera, Hits, fit_camera, pixel_centres, primary_hits
from texsss.view.picture import at_centres, picture
from texsss.view.shade import Gloss, facing, shade, sight


def flat(count: int, cosine: torch.Tensor) -> tuple[Mesh, torch.Tensor, Hits]:
    """Hits on a square seen under `cosine`."""
    mesh = square(1000.0)
    uv = torch.tensor([[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0]], [[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]]])
    view = torch.stack([torch.sqrt(1 - cosine**2), torch.zeros_like(cosine), cosine], -1)
    points = Points(torch.zeros(count).long(), torch.full((count, 3), 1 / 3))
    return mesh, uv, Hits(torch.arange(count), points, view, torch.ones(count))


def test_all_exitance_leaves():
    """∫ L cos dω = M: the exit factor only shapes it."""
    cosine = (torch.arange(2000) + 0.5) / 2000
    mesh, uv, hits = flat(2000, cosine)
    radiance = shade(hits, mesh, uv, torch.ones(4, 4, 3), [], eta=1.4)
    # measured 2e-4: the midpoint rule, and GRAZING
    assert float((2 * math.pi * radiance[:, 0] * cosine).mean()) == pytest.approx(1.0, abs=1e-3)


def test_furnace_of_both():
    """M = π L F_dt and a constant environment: what leaves plus what mirrors is L but for shadowing."""
    cosine = torch.linspace(0.1, 1.0, 50)
    mesh, uv, hits = flat(50, cosine)
    lights = [ConstantEnvironment((1.0, 1.0, 1.0))]
    exitance = torch.full((4, 4, 3), math.pi * fresnel.F_dt(1.4))
    smooth = Gloss(roughness=0.0)
    radiance = shade(hits, mesh, uv, exitance, lights, eta=1.4, gloss=smooth, occluder=Occluder(mesh))
    torch.testing.assert_close(radiance, torch.ones_like(radiance), atol=2e-3, rtol=0)


def test_two_lobes_are_the_mean_of_each():
    mesh, uv, hits = flat(20, torch.linspace(0.2, 1.0, 20))
    image = torch.zeros(2, 2, 3)
    for light in (DirectionalLight((-1.0, 0.2, 1.0), (1, 1, 1)), ConstantEnvironment((1, 1, 1))):

        def seen(gloss: Gloss, light=light) -> torch.Tensor:
            return shade(hits, mesh, uv, image, [light], gloss=gloss)

        both = seen(Gloss(0.3, second=0.4, second_ratio=2.0))
        torch.testing.assert_close(both, 0.6 * seen(Gloss(0.3)) + 0.4 * seen(Gloss(0.6)))


def test_shadows_take_highlights_away():
    mesh = together(square(10.0), square(100.0, z=20.0))
    points = Points(torch.tensor([0]), torch.full((1, 3), 1 / 3))
    view = unit(torch.tensor([[1.0, 0.0, 1.0]]))
    hits = Hits(torch.tensor([0]), points, view, torch.ones(1))
    uv, lights = torch.zeros(4, 3, 2), [PointLight((-30.0, 0.0, 30.0), (1, 1, 1))]
    image = torch.zeros(2, 2, 3)
    lit = shade(hits, mesh, uv, image, lights, gloss=Gloss())
    dark = shade(hits, mesh, uv, image, lights, gloss=Gloss(), occluder=Occluder(mesh))
    assert lit.min() > 0 and not dark.any()


def test_environment_highlights_converge():
    """Eight samples are near many."""
    cosine = torch.full((400,), 0.4)
    mesh, uv, hits = flat(400, cosine)
    lights, image = [ConstantEnvironment((1.0, 1.0, 1.0))], torch.zeros(2, 2, 3)
    few = shade(hits, mesh, uv, image, lights, gloss=Gloss(0.5))
    many = shade(hits, mesh, uv, image, lights, gloss=Gloss(0.5), environment_samples=128)
    assert float(few.mean()) == pytest.approx(float(many.mean()), rel=0.02)
    assert float((few - many).std() / many.mean()) < 0.25


@pytest.mark.parametrize("roughness", [0.02, 0.15, 0.4, 0.8])
def test_a_sun_in_a_panorama_glares_at_no_pixel(roughness):
    """At the mirror direction, eight samples: its light is the sum over its texels, alike at every hit.

    Looked for by the lobe alone, noise is many times the mean at .4; measured .04 to .11.
    """
    count = 256
    mesh, uv, hits = flat(count, torch.full((count,), 0.6))
    mirror = torch.tensor([[-0.8, 0.0, 0.6]])
    height = 360  # texels of half a degree
    towards = direction(centres(height, 2 * height)).float()
    disc = (towards @ mirror[0] > math.cos(math.radians(1.0))).float()
    image = (1e4 * disc + 0.01)[:, None].expand(-1, 3).reshape(height, 2 * height, 3).contiguous()
    seen = shade(hits, mesh, uv, torch.zeros(2, 2, 3), [ImageEnvironment(image)], gloss=Gloss(roughness))[
        :, 0
    ]
    # 8 × 8 places within each texel around the sun
    around = (towards @ mirror[0] > math.cos(math.radians(2.0))).nonzero()[:, 0]
    within = (torch.cartesian_prod(torch.arange(8), torch.arange(8)) - 3.5) / 8
    texel = torch.tensor([0.5 / height, 1 / height])
    place = (centres(height, 2 * height).float()[around][:, None] + within * texel).reshape(-1, 2)
    angle = (solid_angle(height, 2 * height).float()[around // (2 * height)] / 64).repeat_interleave(64)
    one = torch.ones(len(place), 1)
    lobe = ggx.reflection(
        one * torch.tensor([0.0, 0, 1]), one * hits.view[:1], direction(place), roughness * one[:, 0], 1.4
    )
    expected = float((looked_up(image, place)[:, 0] * angle * lobe).sum())
    assert float(seen.mean()) == pytest.approx(expected, rel=0.02)
    assert float(seen.std() / seen.mean()) < 0.15 and float(seen.max() / seen.mean()) < 2


def test_normals_that_turn_away_are_bent_back():
    view = unit(torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]))
    normal = unit(torch.tensor([[1.0, 0.0, -0.5], [1.0, 0.0, 0.5]]))
    bent = facing(normal, view)
    torch.testing.assert_close(bent.norm(dim=-1), torch.ones(2))
    assert float(bent[0, 2]) == pytest.approx(0.02) and torch.equal(bent[1], normal[1])


def test_gradient_reaches_the_exitance():
    mesh, uv, hits = flat(5, torch.linspace(0.2, 1, 5))
    image = torch.rand(3, 3, 3, requires_grad=True)
    shade(hits, mesh, uv, image, [], eta=1.3).sum().backward()
    assert image.grad is not None and float(image.grad.sum()) > 0


def test_picture_of_a_sphere():
    """Coverage is the disk's; refined edges are near the true mean; the background shows."""
    mesh = sphere(50.0, 4)
    occluder, camera = Occluder(mesh), fit_camera(mesh, resolution=(96, 64), margin=0.1)
    image = picture(
        camera, occluder, lambda h: torch.ones(len(h.pixel), 3), samples=16, background=(0.0, 0.5, 1.0)
    )
    assert image.shape == (64, 96, 4)
    assert float(image[..., 3].sum()) == pytest.approx(math.pi * (0.8 * 32) ** 2, rel=0.002)  # measured 6e-4
    torch.testing.assert_close(image[0, 0], torch.tensor([0.0, 0.5, 1.0, 0.0]))
    part = image[..., 3]
    assert ((part > 0) & (part < 1)).sum() > 100
    # ones over a background of brightness ½, each weighed by 1 / (1 + brightness)
    torch.testing.assert_close(image[..., 0], part / 2 / (part / 2 + (1 - part) / 1.5))


@pytest.mark.parametrize("blue", [0.0, -1e-6])
def test_dark_outlines_are_as_smooth_as_bright_ones(blue):
    """Where a channel falls a little below black, too, and before a background seen in corners alone."""
    mesh = sphere(50.0, 4)
    occluder, camera = Occluder(mesh), Camera((0, 0, 150), (0, 0, 0), fov_y=0.58, resolution=(64, 64))

    def coverage(colour: list[float]) -> torch.Tensor:
        radiance = torch.tensor(colour)
        return picture(
            camera, occluder, lambda h: radiance.expand(len(h.pixel), 3), background=(0.2, 0.2, 0.2)
        )[..., 3]

    bright, dark = coverage([1.0, 1.0, 1.0]), coverage([1e-6, 1e-6, blue])
    assert int(((bright > 0) & (bright < 1)).sum()) > 30 and float(bright.mean()) > 0.9
    assert torch.equal(bright, dark)


def test_one_bright_hit_does_not_whiten_its_pixel():
    mesh = square(100.0)
    camera = fit_camera(mesh, resolution=(16, 16))

    def speckled(hits: Hits) -> torch.Tensor:
        bright = hits.points.position(mesh)[:, :1].abs() < 0.3
        return torch.where(bright, 1e4, 1.0).expand(-1, 3)

    image = picture(camera, Occluder(mesh), speckled, samples=16)
    assert float(image[..., :3].max()) < 1e3


def test_pictures_repeat_and_stop():
    mesh = sphere(50.0, 2)
    occluder, camera = Occluder(mesh), fit_camera(mesh, resolution=(24, 16))
    uv = torch.zeros(320, 3, 2)
    lights = [DirectionalLight((1, 1, 1), (3, 3, 3)), ConstantEnvironment((1, 1, 1))]

    def shader(hits: Hits) -> torch.Tensor:
        return shade(hits, mesh, uv, torch.ones(2, 2, 3), lights, gloss=Gloss(), occluder=occluder)

    one, two = (picture(camera, occluder, shader, samples=4, seed=1) for _ in range(2))
    assert torch.equal(one, two)
    with pytest.raises(Cancelled):
        picture(camera, occluder, shader, cancel=lambda: True)
    with pytest.raises(DomainError, match="sample"):
        picture(camera, occluder, shader, samples=0)


def test_what_moves_elsewhere_moves_no_ray():
    """Edges of what stands still are the same, whatever else there is to refine: films do not flicker."""
    camera = fit_camera(square(400.0), resolution=(96, 48))
    still = sphere(50.0, 2, centre=(-100, -60, 0))
    pictures = []
    for x in (60.0, 130.0):
        mesh = together(sphere(40.0, 1, centre=(x, 80, 0)), still)
        shader = lambda hits, mesh=mesh: hits.points.normal(mesh).abs()  # noqa: E731
        pictures.append(picture(camera, Occluder(mesh), shader, samples=9))
    height = pictures[0].shape[0]
    below = [image[height // 2 + 2 :] for image in pictures]
    assert torch.equal(below[0][..., 3], below[1][..., 3]) and not torch.equal(*pictures)
    assert bool(((below[0][..., 3] > 0) & (below[0][..., 3] < 1)).any())
    # rays weigh by the mean brightness, which is that of all; measured 3e-5
    torch.testing.assert_close(*below, atol=5e-4, rtol=0)


def test_what_is_known_of_the_centres_is_not_looked_at_again():
    """Sights kept from one material show another exactly as a picture made anew."""
    mesh = sphere(50.0, 2)
    occluder, camera = Occluder(mesh), fit_camera(mesh, resolution=(24, 16))
    lights = [DirectionalLight((1, 1, 1), (3, 3, 3)), ConstantEnvironment((1, 1, 1))]

    def see(hits):
        return sight(hits, mesh, lights, gloss=Gloss(), occluder=occluder)

    seen = list(at_centres(camera, occluder, see))
    uv, image = torch.zeros(320, 3, 2), torch.rand(4, 4, 3, generator=torch.Generator().manual_seed(1))

    def shader(hits: Hits) -> torch.Tensor:
        return shade(hits, mesh, uv, image, lights, gloss=Gloss(), occluder=occluder)

    def refuse(hits: Hits) -> torch.Tensor:
        raise AssertionError(f"looked at {len(hits.pixel)} hits again")

    at = Texture.of(image).at
    known = [(s.hits.pixel, at(s.hits.points.uv(uv)) * s.gain + s.gloss) for s in seen]
    anew = picture(camera, occluder, shader, samples=1)
    assert torch.equal(picture(camera, occluder, refuse, samples=1, centres=known), anew)


def test_bad_gloss_is_refused():
    with pytest.raises(DomainError, match="roughness"):
        Gloss(roughness=1.5)
    with pytest.raises(DomainError, match="strength"):
        Gloss(strength=torch.tensor([-1.0]))


def test_hits_know_their_pixel():
    mesh = square(100.0)
    camera = fit_camera(mesh, resolution=(8, 8))
    hits = primary_hits(camera, Occluder(mesh), pixel_centres(camera), torch.arange(64), torch.float32)
    assert len(hits.pixel.unique()) == len(hits.pixel) == 64
