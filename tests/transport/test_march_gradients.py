"""What the march is differentiable in."""

import math

import pytest
import torch
from march_shapes import centre, hills, scattered_points, square

from texsss.light.emitters import DirectionalLight, PointLight
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.surface.mesh import Mesh
from texsss.transport.march import gatherer
from texsss.transport.march.interior import from_depths
from texsss.transport.march.march import march
from texsss.transport.march.planes import fit_planes
from texsss.transport.march.setup import Reach


@pytest.mark.parametrize("method", ["exact", "uniform"])
def test_gradients_reach_depths_and_coefficients(method, monkeypatch):
    # where steps meet depends on extinctions, which gradients do not see
    monkeypatch.setattr(gatherer, "reach", lambda interior, across: Reach(3.2 * (1 + 1e-4), math.inf, 0.3))
    mesh = hills(count=8)
    points = scattered_points(mesh, 4, seed=8)
    planes = fit_planes(mesh, 2.0)
    lights = [PointLight([2.0, 6.0, -3.0], [1e-4] * 3)]
    eye = torch.tensor([4.0, 30.0, 12.0])

    def radiance(depth, sigma_s, sigma_a, g):
        media = [Medium(sigma_a[i], sigma_s[i], g[i]) for i in range(2)]
        # a fixed layer below, to which the reach goes
        media.append(Medium([0.1] * 3, [0.2] * 3, 0.1))
        depth = torch.cat([depth, torch.full_like(depth[..., :1], 3.2)], -1)
        return march(points, mesh, planes, from_depths(depth, media), lights, eye, method=method, samples=3)

    generator = torch.Generator().manual_seed(0)
    depth = torch.rand(4, 4, 2, generator=generator, dtype=torch.float64).cumsum(-1) + 0.2
    sigma_s, sigma_a, g = (
        torch.tensor([[1.0, 0.7, 0.5], [2.0, 1.2, 0.8]]),
        torch.tensor([[0.6, 0.5, 0.4], [0.4, 0.3, 0.2]]),
        torch.tensor([[0.3], [0.6]]),
    )
    sigma_s, sigma_a, g = (x.double().requires_grad_() for x in (sigma_s, sigma_a, g))
    inputs = (torch.zeros_like(depth).requires_grad_(), sigma_s, sigma_a, g)
    if method == "exact":
        assert torch.autograd.gradcheck(
            lambda z, *r: radiance(depth + z, *r), inputs, eps=1e-7, atol=1e-5, rtol=1e-3
        )
    else:
        # samples jump from layer to layer: depth has no gradient through which layer they fall in
        assert torch.autograd.gradcheck(
            lambda *r: radiance(depth, *r), inputs[1:], eps=1e-7, atol=1e-5, rtol=1e-3
        )


def slab(thickness, g=0.25) -> Stack:
    return Stack([Layer(Medium([0.6] * 3, [2.0, 1.0, 1.0], g), thickness)])


def seen(stack, view, samples=4) -> torch.Tensor:
    light = [DirectionalLight([-0.3, 0.8, 0.6], [1.0] * 3)]
    points = centre(len(view), torch.float64)
    return march(points, square(torch.float64), None, stack, light, view, samples=samples)


def test_gradients_of_equal_channels_of_g_stay_apart():
    view = torch.nn.functional.normalize(torch.tensor([[0.5, 0.7, 0.2]], dtype=torch.float64))
    g = torch.full((3,), 0.3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda g: seen(slab(1.0, g), view), (g,), eps=1e-6, atol=1e-7)


@pytest.mark.parametrize("samples", [1, 4])
def test_gradients_reach_the_deepest_boundary(samples):
    """It ends the ray: rounding must not decide whether it is crossed. Twelve views at once."""
    generator = torch.Generator().manual_seed(0)
    aside = torch.rand(12, generator=generator, dtype=torch.float64) / 2
    view = torch.nn.functional.normalize(torch.stack([aside, 0.7 + 0 * aside, 0.2 + 0 * aside], -1))
    for depth in (0.2, 0.7, 1.0):
        known = torch.tensor(depth, dtype=torch.float64, requires_grad=True)
        assert torch.autograd.gradcheck(
            lambda d: seen(slab(d), view, samples), (known,), eps=1e-7, atol=1e-7, rtol=1e-4
        )


@pytest.mark.parametrize("eta", [1.0, 1.3])
@pytest.mark.parametrize(
    ("sun", "eye"), [((0.0, 1.0, 0.0), (0.3, 0.9, 0.1)), ((-0.3, 0.8, 0.2), (0.0, 1.0, 0.0))]
)
def test_gradients_reach_vertices_and_lights_along_the_normal(eta, sun, eye):
    """Where light or view does not bend, the bend has a derivative all the same."""
    flat = square(torch.float64, 10.0)
    points = scattered_points(flat, 3, seed=1)
    planes = fit_planes(flat, 2.0)  # gradients do not see how they were fitted
    media = [Medium([0.6] * 3, [2.0] * 3, 0.25, eta)] * 2
    interior = from_depths(torch.full((2, 2, 1), 0.4, dtype=torch.float64), media)
    view = torch.nn.functional.normalize(torch.tensor([eye], dtype=torch.float64)).expand(3, 3)

    def radiance(moved, towards):
        mesh = Mesh(flat.vertices + moved, flat.faces, flat.source_uv)
        return march(points, mesh, planes, interior, [DirectionalLight(towards, [1.0] * 3)], view)

    inputs = (torch.zeros_like(flat.vertices), torch.tensor(sun, dtype=torch.float64))
    inputs = tuple(x.requires_grad_() for x in inputs)
    assert torch.autograd.gradcheck(radiance, inputs, eps=1e-6, atol=1e-5, rtol=1e-3)
