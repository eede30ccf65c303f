"""What the doctor says of meshes whose ills are known."""

import pytest
import torch
from charted_shapes import sheet, sphere

from texsss.surface._uv_picture import COLOURS
from texsss.surface.doctor import examine
from texsss.surface.mesh import Mesh


def with_uv(mesh: Mesh, uv: torch.Tensor) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces, uv)


def test_a_sound_sheet():
    mesh = sheet(4)
    report, picture = examine(mesh, mesh.source_uv, (64, 64))
    assert report.atlas.serves
    assert (report.mirrored, report.flipped, report.flat, report.outside, report.overlapping) == (0,) * 5
    assert report.texel_mm.median == pytest.approx(10 / 64) and report.stretch.greatest == pytest.approx(1)
    assert report.covered == 1 and report.padding_texels is None
    assert (report.edges.open, report.edges.non_manifold, report.edges.inconsistent) == (16, 0, 0)
    assert picture.shape == (64, 64, 3)


def test_mirrors_are_told_from_flips():
    mesh = sheet(4)
    mirror = mesh.source_uv * torch.tensor([-1.0, 1]) + torch.tensor([1.0, 0])
    assert examine(mesh, mirror, (64, 64))[0].mirrored == 32
    folded = (mesh.source_uv - torch.tensor([0.5, 0])).abs() * torch.tensor([2.0, 1])
    report, picture = examine(mesh, folded, (64, 64))  # halves of one chart that lie on each other
    assert (report.mirrored, report.flipped, report.overlapping) == (16, 0, 16)
    red = torch.tensor(COLOURS["overlap"])
    assert float((picture - red).abs().amax(-1).lt(1e-6).float().mean()) > 0.95


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_corner_dragged_over_its_neighbours_is_a_fold(mirrored):
    """Of 128 faces that meet, six surround the corner; dragged by 1.5 cells, those behind it turn."""
    mesh = sheet(8)
    uv = mesh.source_uv.clone()
    uv[(uv - 0.5).abs().amax(-1) < 1e-6] += torch.tensor([1.5 / 8, 0.0])
    turned = torch.linalg.det(uv[:, 1:] - uv[:, :1]).sign()
    if mirrored:
        uv[..., 0] = 1 - uv[..., 0]
    report, _ = examine(mesh, uv, (64, 64))
    folds = min(int((turned > 0).sum()), int((turned < 0).sum()))
    assert 0 < folds < 6 and report.atlas.charts == 1
    assert (report.flipped, report.mirrored) == (folds, (128 - folds) * mirrored)


def shown(picture: torch.Tensor, name: str) -> float:
    """Share of a picture in a colour."""
    colour = picture.new_tensor(COLOURS[name])
    return float((picture - colour).abs().amax(-1).lt(1e-6).float().mean())


def test_what_leaves_the_square_or_has_no_area_is_shown():
    """One of two sheets on the square to the right, as UDIM has it; faces drawn together to a line."""
    mesh = sheet(4)
    uv = mesh.source_uv * torch.tensor([2.0, 1])
    uv[uv[..., 0].mean(1) > 1] += torch.tensor([5e-5, 0])
    report, picture = examine(mesh, uv, (64, 64))
    assert report.outside == 16 and picture.shape == (32, 64, 3)
    assert 0.3 < shown(picture, "outside") < 0.5 and 0.3 < shown(picture, "sound") < 0.5
    uv = mesh.source_uv.clone()
    uv[:2] = uv[:2] * torch.tensor([0.0, 1])
    report, picture = examine(mesh, uv, (64, 64))
    assert report.flat == 2 and 0.005 < shown(picture, "flat") < 0.05
    far = mesh.source_uv + 1e6
    assert examine(mesh, far, (64, 64))[0].outside == 32  # too far to be shown, not to be counted


def test_padding_between_two_charts():
    """Two halves moved 8 texels apart."""
    mesh = sheet(4)
    uv = mesh.source_uv * torch.tensor([1.0, 0.5])
    uv[16:] += torch.tensor([0.0, 8 / 64])
    report, _ = examine(with_uv(mesh, uv), uv, (64, 64))
    assert report.atlas.charts == 2 and report.padding_texels == 8


def test_topology_of_a_sphere_turned_inside_out():
    mesh = sphere(8, 12)
    assert examine(mesh, mesh.source_uv, (32, 32))[0].inside_out == 0
    inverted = Mesh(mesh.vertices, mesh.faces.flip(1), mesh.source_uv.flip(1))
    report, _ = examine(inverted, inverted.source_uv, (32, 32))
    assert (report.inside_out, report.parts, report.edges.open, report.edges.inconsistent) == (1, 1, 0, 0)


def test_three_faces_on_an_edge_are_counted():
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])
    mesh = Mesh(vertices, torch.tensor([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    report, _ = examine(mesh, torch.rand(3, 3, 2, generator=torch.Generator().manual_seed(0)), (16, 16))
    assert (report.edges.non_manifold, report.edges.open) == (1, 6)
