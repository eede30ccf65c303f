"""The compiled loop is the march that torch does."""

import pytest
import torch
from march_shapes import SUN, UNIT, centre, fish, hills, scattered_points, square, veins

from texsss.light.emitters import DirectionalLight, PointLight
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.numerics import native
from texsss.transport.march.fused import packed
from texsss.transport.march.interior import Interior, from_depths, from_stack
from texsss.transport.march.kernel import FRAME
from texsss.transport.march.march import march
from texsss.transport.march.noise import Noise

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


def test_one_endless_layer_has_no_boundary():
    view = torch.tensor([[0.5, 0.7, 0.2]]).expand(3, 3)
    args = (centre(3), square(), None, Stack([Layer(fish()[0])]), [DirectionalLight(SUN, UNIT)], view)
    torch.testing.assert_close(march(*args, compiled=True), march(*args), rtol=3e-6, atol=0)


@pytest.mark.parametrize("boundaries", [1, 2, 3, 5])
def test_packed_thicknesses_are_within_half_a_unit(boundaries):
    depth = torch.rand(8, 12, boundaries, generator=torch.Generator().manual_seed(2)).cumsum(-1)
    depth[..., 0] = 0.25  # one thickness stays exact
    words, coded = packed(depth)
    assert words.shape[1:] == (8 + FRAME, 12 + FRAME)
    per_word, bits = {1: (1, 24), 3: (3, 10)}.get(boundaries, (2, 16))
    unpacked = [
        (words[i // per_word, :8, :12] >> (bits * (i % per_word))) & (2**bits - 1) for i in range(boundaries)
    ]
    least, unit = coded.split(boundaries)
    thickness = least + unit * torch.stack(unpacked, -1)
    assert bool((thickness[..., 0] == 0.25).all())
    away = (thickness - torch.diff(depth, dim=-1, prepend=torch.zeros(8, 12, 1))).abs()
    assert bool((away <= 0.501 * unit + 1e-6).all())
