"""The compiled loop is the march that torch does."""

import ctypes

import pytest
import torch
from march_shapes import SUN, UNIT, centre, fish, hills, scattered_points, square, veins

from texsss.light.emitters import DirectionalLight, PointLight
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.numerics import native
from texsss.transport.march.fused import Fused, packed
from texsss.transport.march.interior import Interior, from_depths, from_stack
from texsss.transport.march.kernel import FRAME
from texsss.transport.march.march import march
from texsss.transport.march.noise import Noise
from texsss.transport.march.planes import fit_planes

pytestmark = pytest.mark.skipif(native._compiler() is None, reason="no C++ compiler: nothing is compiled")


def mapped() -> Interior:
    """Maps of everything, g per channel, an infinite layer below."""
    grain = torch.rand(16, 16, 3, generator=torch.Generator().manual_seed(1))
    first = Medium(0.4 + 0.3 * grain, 1 + grain, 0.2 * grain, 1.4)
    return from_stack(Stack([Layer(first, 0.3 + 0.2 * grain[..., :1]), Layer(fish(1.4)[1])]))


CASES = {
    "veins, Schlick": (lambda: from_depths(veins(dtype=torch.float32), fish()), "schlick"),
    "maps": (mapped, "henyey-greenstein"),
}


@pytest.mark.parametrize("case", CASES)
def test_compiled_march_is_the_march(case):
    """RMSE as a share of the mean; measured 1e-5 to 3e-4 (uniform samples jump where depths are rounded)."""
    make, phase = CASES[case]
    mesh = hills(torch.float32)
    points = scattered_points(mesh, 1003, seed=8)  # the last vector is not full
    lights = [DirectionalLight(SUN, UNIT), PointLight([2.0, 6.0, -3.0], [1e-4, 2e-4, 3e-4])]
    args = (points, mesh, None, make(), lights, torch.tensor([4.0, 30.0, 12.0]))
    for method, samples, noise in (
        ("exact", 1, None),
        ("exact", 4, None),
        ("uniform", 9, None),
        ("uniform", 9, Noise(uv=0.01, start=0.5)),
    ):
        ours, plain = (
            march(*args, method=method, samples=samples, phase=phase, noise=noise, compiled=compiled)
            for compiled in (True, False)
        )
        assert not torch.equal(ours, plain)  # both would be the same code
        error = (ours - plain).square().mean().sqrt() / plain.mean()
        assert float(error) < (1e-4 if method == "exact" else 2e-3), (method, samples, float(error))


@pytest.mark.parametrize("deep", [20.0, 1e5])
def test_one_deep_place_does_not_coarsen_the_rest(deep):
    """Boundaries that vary by much get more bits, and none for what is too deep to be seen."""
    mesh, depth = hills(torch.float32), veins(dtype=torch.float32)
    depth[:4, :4, 1:] += deep
    points = scattered_points(mesh, 2000, seed=8)
    args = (points, mesh, None, from_depths(depth, fish()), [DirectionalLight(SUN, UNIT)])
    ours, plain = (march(*args, torch.tensor([4.0, 30.0, 12.0]), compiled=c) for c in (True, False))
    assert float((ours - plain).square().mean().sqrt() / plain.mean()) < 2e-4


@pytest.mark.parametrize("painted", [False, True])
def test_what_is_nearly_clear_does_not_space_the_steps(painted):
    """RMSE of 16 steps as a share of the mean, against 2000 down a finite layer of all its depth.

    Measured .0046 and .008; steps spaced by the least extinction anywhere have .035 and .09.
    """
    grain = 5 * torch.rand(64, 64, 3, generator=torch.Generator().manual_seed(1))
    clear, deep = Medium([0.005] * 3, [0.005] * 3, 0.0, 1.0), 400.0
    depth = veins(dtype=torch.float32)
    if painted:
        endless, truth = (from_stack(Stack([Layer(Medium(0.02, grain, 0.0, 1.0), d)])) for d in (None, 30.0))
    else:
        endless = from_depths(depth, [*fish(), clear])
        truth = from_depths(torch.cat([depth, depth[..., 2:] + deep], -1), [*fish(), clear])
    mesh, eye = hills(torch.float32), torch.tensor([14.0, 20.0, 12.0])
    args = (scattered_points(mesh, 500, seed=0), mesh, fit_planes(mesh, 2.0))
    few, many = (
        march(*args, layers, [DirectionalLight(SUN, UNIT)], eye, samples=n, compiled=True)
        for layers, n in ((endless, 16), (truth, 2000))
    )
    assert float((few - many).square().mean().sqrt() / many.mean()) < (0.012 if painted else 0.01)


def test_one_endless_layer_has_no_boundary():
    view = torch.nn.functional.normalize(torch.tensor([[0.5, 0.7, 0.2]])).expand(3, 3)
    args = (centre(3), square(), None, Stack([Layer(fish()[0])]), [DirectionalLight(SUN, UNIT)], view)
    torch.testing.assert_close(march(*args, compiled=True), march(*args), rtol=3e-6, atol=0)


@pytest.mark.parametrize(("boundaries", "wide"), [(1, False), (2, False), (3, False), (3, True), (5, False)])
def test_packed_thicknesses_are_within_half_a_unit(boundaries, wide):
    depth = torch.rand(8, 12, boundaries, generator=torch.Generator().manual_seed(2)).cumsum(-1)
    depth[..., 0] = 0.25  # one thickness stays exact
    words, coded = packed(depth, wide)
    assert words.shape[1:] == (8 + FRAME - 1, 12 + FRAME, 2)
    assert torch.equal(words[:, :-1, :, 1], words[:, 1:, :, 0])  # every texel with that below it
    per_word, bits = {1: (1, 24), 3: (2, 16) if wide else (3, 10)}.get(boundaries, (2, 16))
    unpacked = [
        (words[i // per_word, :8, :12, 0] >> (bits * (i % per_word))) & (2**bits - 1)
        for i in range(boundaries)
    ]
    least, unit = coded.split(boundaries)
    thickness = least + unit * torch.stack(unpacked, -1)
    assert bool((thickness[..., 0] == 0.25).all())
    away = (thickness - torch.diff(depth, dim=-1, prepend=torch.zeros(8, 12, 1))).abs()
    assert bool((away <= 0.501 * unit + 1e-6).all())


@pytest.mark.parametrize("depths", [(0.02, 8.0), (0.2, 1.1), (0.3, 1.2), (0.3, 8.0)])
def test_the_deepest_texel_stays_the_deepest(depths):
    """Where 24 bits are full, rounding up must not begin anew at the least thickness."""
    grey = torch.arange(256).reshape(16, 16, 1) / 255
    depth = depths[0] + (depths[1] - depths[0]) * grey
    words, coded = packed(depth)
    thickness = coded[0] + coded[1] * (words[0, :16, :16, 0] & (2**24 - 1))
    torch.testing.assert_close(thickness, depth[..., 0], rtol=1e-6, atol=0)


def test_a_march_that_gets_no_memory_ends_no_process():
    """Of more lights than there can be."""
    media = torch.ones(1, 3)
    loop = Fused(Interior(torch.ones(1, 1, 0), media, 2 * media, 0 * media, eta=1.0), "henyey-greenstein")
    numbers = [ctypes.c_int(-1), None, ctypes.c_int(1), ctypes.c_float(1.0), *[ctypes.c_int64(0)] * 3]
    assert loop._march(*[None] * 3, 1, 1, *[None] * 3, *numbers, None) is False
