"""Texel sizes and stretch in closed form; filling of empty texels against brute force."""

import jaxtyping
import pytest
import torch
from charted_shapes import sheet, soup, sphere

from texsss.errors import ShapeError
from texsss.surface.dilate import dilate, nearest_filled
from texsss.surface.mesh import Mesh
from texsss.surface.metric import anisotropies, face_stretch, spread, texel_mm_per_axis, texel_sizes
from texsss.surface.raster import rasterise


def test_texels_of_a_stretched_sheet():
    """30 by 10 mm over 64 by 32 texels: 30/64 along u, 10/32 along v."""
    mesh = sheet(3, width=30, height=10)
    maps = rasterise(mesh, mesh.source_uv, (32, 64))
    expected = torch.tensor([30 / 64, 10 / 32]).expand(len(maps), 2)
    torch.testing.assert_close(texel_mm_per_axis(maps), expected)
    sizes = texel_sizes(mesh, mesh.source_uv, (32, 64))
    assert sizes.median == pytest.approx((30 / 64 * 10 / 32) ** 0.5, rel=1e-5)
    ratio = anisotropies(mesh, mesh.source_uv, (32, 64))
    assert (ratio.least, ratio.greatest) == pytest.approx((1.5, 1.5), rel=1e-4)


def test_stretch_does_not_see_rotations_of_uv():
    """Sheared, turned and mirrored uv: singular values agree with torch's."""
    mesh = sphere(8, 12)
    uv = mesh.source_uv @ torch.tensor([[0.6, 0.3], [0.5, -0.9]])
    found = face_stretch(mesh, uv, (100, 200))
    from texsss.surface.points import face_jacobian

    jacobian = face_jacobian(mesh, uv).double() / torch.tensor([200.0, 100.0]).double()
    torch.testing.assert_close(found, torch.linalg.svdvals(jacobian), rtol=1e-5, atol=1e-9)


def test_flat_faces_have_no_size():
    mesh = sheet(2)
    flat = Mesh(mesh.vertices, mesh.faces, mesh.source_uv * 0)
    assert face_stretch(flat, flat.source_uv, (8, 8)).abs().max() == 0
    assert texel_sizes(flat, flat.source_uv, (8, 8)).median == 0


def test_median_is_by_area():
    found = spread(torch.tensor([1.0, 2, 3, 0]), torch.tensor([1.0, 1, 10, 5]))
    assert (found.least, found.median, found.greatest) == (1, 3, 3)


def test_dilation_takes_the_nearest_and_keeps_what_there_is():
    mesh = soup(2, 9, size=0.3)
    maps = rasterise(mesh, mesh.source_uv, (30, 40))
    filled = maps.to_image(torch.ones(len(maps), 1))[..., 0] > 0
    image = maps.to_image(torch.rand(len(maps), 3, generator=torch.Generator().manual_seed(0)))
    full = dilate(image, filled)
    assert torch.equal(full[filled], image[filled])
    rows, columns = torch.nonzero(filled).unbind(-1)
    i, j = torch.meshgrid(torch.arange(30), torch.arange(40), indexing="ij")
    squares = (i[..., None] - rows) ** 2 + (j[..., None] - columns) ** 2
    nearest = nearest_filled(filled)
    found = (i - nearest // 40) ** 2 + (j - nearest % 40) ** 2
    assert torch.equal(found, squares.min(-1).values)


def test_dilation_of_nothing_and_of_everything_is_the_image():
    image = torch.rand(4, 5, 3, generator=torch.Generator().manual_seed(0))
    for value in (True, False):
        assert torch.equal(dilate(image, torch.full((4, 5), value)), image)
    # under pytest the annotations speak first
    with pytest.raises((ShapeError, TypeError, jaxtyping.TypeCheckError)):
        dilate(image, torch.ones(5, 4, dtype=torch.bool))


def test_dilation_is_differentiable():
    filled = torch.tensor([[True, False], [False, False]])
    image = torch.zeros(2, 2, 1, dtype=torch.float64, requires_grad=True)
    dilate(image, filled).sum().backward()
    assert image.grad is not None and image.grad[0, 0, 0] == 4
