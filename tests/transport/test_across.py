"""Light across an object in texture space: against slabs, and the one-sided bank against all pairs."""

import math

import pytest
import torch
from shapes import square as plate
from shapes import together
from squares import ball, lit

from texsss.light.thickness import far_side
from texsss.light.visibility import Occluder
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.project import variance_ladder
from texsss.profiles.through import weights_through
from texsss.surface.mesh import Mesh
from texsss.surface.raster import rasterise
from texsss.transport.bank import build_bank, diffusion
from texsss.transport.through import Across, on_one_side, transmitted
from texsss.types import Tensor

THICK, SIDE, SIZE = 2.0, 120.0, 256


def slab() -> Mesh:
    """Two plates, 2 mm apart, that face away from each other, side by side in texture space."""
    lower = plate(SIDE, z=-THICK)
    return together(plate(SIDE), Mesh(lower.vertices, lower.faces.flip(1)))


def slab_uv(mesh: Mesh) -> Tensor:
    uv = (mesh.corners[..., :2] / SIDE + 0.5) * 0.46 + 0.02
    return torch.cat([uv[:2], uv[2:] + uv.new_tensor([0.5, 0.0])])


@pytest.fixture(scope="module")
def lit_from_behind():
    """Texels of the slab, its lower side lit in stripes of one frequency, its ladder and frequency [1/mm]."""
    mesh = slab()
    texels = rasterise(mesh, slab_uv(mesh), (SIZE, SIZE))
    position = texels.points.position(mesh)
    below = texels.points.face_normal(mesh)[:, 2] < 0
    s = 2 * math.pi / 12.0
    light = torch.where(below, 1 + torch.cos(s * position[:, 0]), 0)[:, None].expand(-1, 3)
    far = far_side(texels.points, mesh, Occluder(mesh))
    return texels, light, far, s


@pytest.mark.parametrize("rule", ["exit", "entry", "geometric-mean"])
@pytest.mark.parametrize("method", ["uv", "surface"])
def test_a_slab_passes_its_transmittance_at_every_frequency(lit_from_behind, method: str, rule: str):
    texels, light, far, s = lit_from_behind
    stack = Stack(preset("skin1"))
    variances = variance_ladder(texels.texel_mm, SIDE)
    _, passed = weights_through(stack, variances, far.thickness)
    blur = diffusion(texels, method)
    if method == "surface":
        blur = on_one_side(blur, texels.points.normal(texels.mesh))
    bank = build_bank(light, texels, variances)
    bank = type(bank)(variances, light, blur(light, variances))
    found = transmitted(bank, passed, Across(far, texels), rule, blur=blur)
    position = texels.points.position(texels.mesh)
    middle = (position[:, :2].abs() < 24).all(1) & (position[:, 2] == 0)
    _, T = hankel_profiles(Stack([Layer(preset("skin1"), THICK)]), torch.tensor([0.0, s]))
    wave = torch.cos(s * position[middle, 0])[:, None]
    expected = T[0] + T[1] * wave
    # the geometric mean leaves out negative weights
    error = (found[middle] - expected).norm(dim=0) / expected.norm(dim=0)
    assert float(error.max()) < (0.06 if rule == "geometric-mean" else 0.025), error
    unlit = position[:, 2] < 0
    assert float(found[unlit].abs().max()) < 0.01, "nothing came from the dark side"


def test_the_far_side_leaves_the_bank(lit_from_behind):
    texels, light, _, _ = lit_from_behind
    variances = torch.tensor([9.0, 50.0])
    dark = (texels.points.position(texels.mesh)[:, :2].abs() < 24).all(1) & (light[:, 0] == 0)
    both = diffusion(texels, "surface")(light, variances)[:, dark]
    gated = on_one_side(diffusion(texels, "surface"), texels.points.normal(texels.mesh))
    near = gated(light, variances)[:, dark]
    assert float(both.mean()) > 0.3 and float(near.abs().max()) < 0.02


def test_one_side_keeps_constants_and_weighs_by_normals():
    """Against the sum over all pairs on a sphere."""
    texels = ball(64)
    values, normal = lit(texels), texels.points.normal(texels.mesh)
    variances = torch.tensor([300.0, 1500.0])
    blur = on_one_side(diffusion(texels, "surface"), normal)
    constant = blur(torch.ones_like(values), variances)
    torch.testing.assert_close(constant, torch.ones_like(constant), rtol=1e-4, atol=0)
    position, area = texels.points.position(texels.mesh), texels.area
    some = torch.arange(0, texels.covered_count, 97)
    facing = (1 + normal[some] @ normal.T) / 2
    for variance, found in zip(variances.tolist(), blur(values, variances), strict=True):
        kernel = torch.exp(torch.cdist(position[some], position).square() / (-2 * variance)) * area * facing
        expected = (kernel @ values) / kernel.sum(1, keepdim=True)
        assert float((found[some] - expected).norm() / expected.norm()) < 0.02


def test_gradients_reach_the_light_behind(lit_from_behind):
    texels, light, far, _ = lit_from_behind
    asking = light.clone().requires_grad_()
    Across(far, texels).of(asking[None]).sum().backward()
    assert asking.grad is not None
    middle = (texels.points.position(texels.mesh)[:, :2].abs() < 24).all(1)
    torch.testing.assert_close(asking.grad[middle].mean(), torch.tensor(1.0), rtol=0.01, atol=0)
