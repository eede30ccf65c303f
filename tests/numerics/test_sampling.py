"""Bilinear look-ups against an image that is tiled by hand."""

import pytest
import torch
from torch.nn.functional import grid_sample, pad

from texsss.numerics.sampling import Texture, bilinear


@pytest.mark.parametrize("size", [(5, 7), (1, 6), (1, 1)])
def test_tiles_meet_without_a_seam(size):
    """The same as in an image with a texel of the opposite edges around it, tile after tile."""
    height, width = size
    generator = torch.Generator().manual_seed(1)
    image = torch.rand(height, width, 3, generator=generator, dtype=torch.float64)
    uv = torch.rand(4000, 2, generator=generator, dtype=torch.float64) * 6 - 3
    uv = torch.cat([uv, torch.tensor([[0.0, 0.0], [1, 1], [-1e-18, 0.5], [0.5, 1 - 1e-12]]).double()])
    planes = pad(image.permute(2, 0, 1)[None], (1, 1, 1, 1), mode="circular")
    scale = uv.new_tensor([width / (width + 2), height / (height + 2)])
    place = (2 * (uv - uv.floor()) - 1) * scale
    expected = grid_sample(planes, place[None, None], padding_mode="border", align_corners=False)
    found = bilinear(image, uv, "repeat")
    torch.testing.assert_close(found, expected[0, :, 0].T, rtol=0, atol=1e-12)  # measured 2e-15
    single = bilinear(image.float(), uv.float(), "repeat").double()
    torch.testing.assert_close(single, found, rtol=0, atol=2e-5)  # measured 3e-6: uv of 3 in float32


def test_nothing_is_copied_and_gradients_flow():
    image = torch.rand(4, 3, 2, dtype=torch.float64, requires_grad=True)
    uv = (torch.rand(9, 2, dtype=torch.float64) * 3 - 1).requires_grad_()
    assert Texture.of(image, "repeat").planes.data_ptr() == image.data_ptr()
    assert torch.autograd.gradcheck(lambda i, x: bilinear(i, x, "repeat"), (image, uv))
