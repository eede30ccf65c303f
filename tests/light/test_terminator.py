"""Coarse meshes against the smooth surfaces that they stand for, where light grazes."""

from collections.abc import Callable

import pytest
import torch
from shapes import scatter, sphere, square, together

from texsss.light.sites import dot, sites_at
from texsss.light.terminator import cut_by_faces
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh
from texsss.types import Tensor, unit


def saddle(x: Tensor, y: Tensor) -> Tensor:
    return (y * y - x * x) / 60


def waves(x: Tensor, y: Tensor) -> Tensor:
    return 3 * torch.sin(x / 4) * torch.cos(y / 5)


def relief(height: Callable[[Tensor, Tensor], Tensor], count: int) -> Mesh:
    """`count`² squares of two triangles each over 40 mm."""
    line = torch.linspace(-20, 20, count + 1)
    x, y = torch.meshgrid(line, line, indexing="ij")
    corner = torch.arange(count)[:, None] * (count + 1) + torch.arange(count)
    near, far = corner.reshape(-1), corner.reshape(-1) + count + 2
    faces = torch.cat([torch.stack([near, far - 1, far], -1), torch.stack([near, far, near + 1], -1)])
    return Mesh(torch.stack([x, y, height(x, y)], -1).reshape(-1, 3), faces)


@pytest.mark.parametrize(
    ("height", "count", "towards", "dark", "lit"),
    [
        (saddle, 10, (1.0, -1.0, 0.1), 3e-4, 0.0),  # without .0052; measured 1e-4, none can be lit wrongly
        (waves, 16, (1.0, -1.0, 0.1), 3e-3, 0.015),  # without .0121 and .0134; measured .0020 and .0134
        (waves, 10, (0.0, 1.0, 0.4), 3e-4, 0.05),  # without .0152 and .0192; measured 0 and .0444
    ],
)
def test_flat_faces_throw_no_teeth(height, count, towards, dark, lit):
    """Shares of the points that face the light which are wrongly dark and wrongly lit."""
    coarse, fine = relief(height, count), relief(height, 16 * count)
    occluder, points = Occluder(coarse), scatter(coarse, 20000)
    site, direction = sites_at(points, coarse), unit(torch.tensor([towards])).expand(len(points), 3)

    x, y = (site.position[:, k].double().requires_grad_() for k in (0, 1))
    z = height(x, y)
    slopes = torch.autograd.grad(z.sum(), (x, y))
    normal = unit(torch.stack([-slopes[0], -slopes[1], torch.ones_like(z)], -1)).float()
    above = torch.stack([x, y, z], -1).detach().float() + 0.02 * normal  # more than the fine faces are off

    facing = (dot(site.smooth, direction) > 0.02) & (dot(normal, direction) > 0)
    truly = Occluder(fine).occluded(above, direction, normals=normal)
    hidden = occluder.occluded(site.origin, direction, normals=site.face_normal)
    start = site.origin + occluder.offset_mm * site.face_normal
    hidden[hidden.clone()] = ~cut_by_faces(start[hidden], direction[hidden], None, coarse, occluder)
    assert float((hidden & ~truly)[facing].float().mean()) <= dark
    assert float((~hidden & truly)[facing].float().mean()) <= lit


def test_bodies_and_sheets_hide():
    """Behind a coarse ball and above a sheet without a back it is dark, however near."""
    ball = sphere(10.0, 1)
    mesh = together(square(40.0, z=-12.0), ball, square(40.0, z=30.0))
    occluder = Occluder(mesh)
    origins = torch.tensor([[0.0, 0.0, -11.9], [3.0, 0.0, -11.9], [18.0, 18.0, 0.0]])
    up = torch.tensor([[0.0, 0.0, 1.0]]).expand(3, 3)
    assert not cut_by_faces(origins, up, None, mesh, occluder).any()


def test_shadows_from_afar_have_no_holes():
    """A coarse ball's outline cuts corners, too, but its shadow is thrown as one."""
    floor, ball = square(60.0, z=-40.0), sphere(10.0, 1)
    mesh = together(floor, ball)
    occluder, points = Occluder(mesh), scatter(floor, 20000)
    aside = unit(torch.tensor([[0.3, 0.2, 1.0]])).expand(20000, 3)
    origins, up = points.position(floor), torch.tensor([[0.0, 0.0, 1.0]]).expand(20000, 3)
    held = occluder.occluded(origins, aside, normals=up)
    assert 1000 < int(held.sum()) < 3000
    start = origins[held] + occluder.offset_mm * up[held]
    assert not cut_by_faces(start, aside[held], None, mesh, occluder).any()
