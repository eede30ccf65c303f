"""Projection, fitting and first hits."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import sphere, square

from texsss.errors import DomainError
from texsss.light.visibility import Occluder
from texsss.view.camera import Camera, fit_camera, pixel_centres, primary_hits

direction = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: sum(x * x for x in d) > 0.01)


@given(direction, st.floats(0.1, 2.5))
@settings(max_examples=50, deadline=None)
def test_projection_undoes_rays(towards, fov_y):
    camera = Camera(tuple(100 * x for x in towards), (3.0, 4.0, 5.0), fov_y=fov_y, resolution=(80, 60))
    xy = pixel_centres(camera)[::97]
    seen = camera.project(camera.position + 700.0 * camera.directions(xy))
    torch.testing.assert_close(seen[:, :2], xy, atol=1e-8, rtol=0)  # measured 4e-11
    torch.testing.assert_close(camera.axes @ camera.axes.T, torch.eye(3).double(), atol=1e-12, rtol=0)
    assert float(torch.linalg.det(camera.axes)) == pytest.approx(-1)  # right, up, ahead: left-handed


def test_the_picture_is_right_side_up():
    camera = Camera((0, 0, 100), (0, 0, 0), resolution=(80, 60))
    x, y, depth = camera.project(torch.tensor([[10.0, 20.0, 0.0]]))[0]
    assert x > 40 and y < 30 and depth == pytest.approx(100)
    assert torch.isnan(camera.project(torch.tensor([[0.0, 0.0, 200.0]]))[0, 0])


@given(direction, st.sampled_from([(80, 60), (30, 90), (100, 10)]), st.floats(0, 0.2))
@settings(max_examples=30, deadline=None)
def test_fit_touches_the_frame(towards, resolution, margin):
    """Everything is in view, and one pair of sides is reached on both sides alike."""
    mesh = sphere(40.0, 2, centre=(500, -20, 3)).to(torch.float64)
    mesh = mesh.moved(mesh.vertices * torch.tensor([1.0, 2.0, 0.5]))
    camera = fit_camera(mesh, direction=towards, resolution=resolution, margin=margin)
    xy = camera.project(mesh.vertices)[:, :2] / torch.tensor(resolution)
    low, high = xy.amin(0), xy.amax(0)
    assert float(low.min()) >= margin - 1e-6 and float(high.max()) <= 1 - margin + 1e-6
    reached = (low - margin).abs().clamp_min((1 - margin - high).abs())
    assert float(reached.min()) < 1e-6
    centre = camera.axes @ (mesh.vertices.mean(0) - camera.position)
    assert float(centre[2]) > 0


@pytest.mark.parametrize("towards", [(0, 1, 0), (0, -1, 0)])
def test_from_above_and_below(towards):
    camera = fit_camera(sphere(), direction=towards)
    assert torch.isfinite(camera.axes).all()
    assert float(torch.linalg.det(camera.axes)) == pytest.approx(-1)


def test_hits_lie_on_their_rays():
    mesh = sphere(50.0)
    camera = fit_camera(mesh, resolution=(64, 64))
    centres, pixels = pixel_centres(camera), torch.arange(64 * 64)
    hits = primary_hits(camera, Occluder(mesh), centres, pixels, torch.float64)
    seen = camera.project(hits.points.position(mesh.to(torch.float64)))
    torch.testing.assert_close(seen[:, :2], centres[hits.pixel], atol=1e-3, rtol=0)  # measured 5e-5 pixels
    # a disk of 92 % of the height, seen in perspective
    assert len(hits.pixel) == pytest.approx(math.pi / 4 * (0.92 * 64) ** 2, rel=0.02)


def test_flat_meshes_fit_too():
    camera = fit_camera(square(100.0), direction=(1, 0, 0))
    assert torch.isfinite(camera.position).all()


@pytest.mark.parametrize(
    "arguments",
    [
        {"target": (0, 0, 100)},
        {"fov_y": 0.0},
        {"fov_y": 3.2},
        {"resolution": (0, 10)},
        {"resolution": (100000, 10)},
        {"position": (math.nan, 0, 0)},
    ],
)
def test_bad_cameras_are_refused(arguments):
    with pytest.raises(DomainError, match="Camera"):
        Camera(**{"position": (0, 0, 100), "target": (0, 0, 0), **arguments})
