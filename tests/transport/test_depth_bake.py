"""Depths of nested meshes: spheres in a sphere, and slabs under a square."""

from dataclasses import replace

import pytest
import torch
from shapes import scatter, sphere

from texsss.errors import Cancelled, ShapeError
from texsss.transport.depth_bake import depths_from_meshes


def test_nested_spheres_lie_at_their_distance():
    """Radii 50, 45 and 30 mm: depths of 5 and 20 mm; facets of the spheres measured .25 mm."""
    outer = sphere(50.0)
    points = scatter(outer, 500, seed=0)
    depth = depths_from_meshes(points, outer, [sphere(45.0), sphere(30.0)])
    assert depth.shape == (500, 2)
    torch.testing.assert_close(depth, torch.tensor([5.0, 20.0]).expand(500, 2), rtol=0, atol=0.5)


def test_boundaries_never_cross_and_end_with_the_object():
    outer = sphere(50.0)
    points = scatter(outer, 200, seed=1)
    swapped = depths_from_meshes(points, outer, [sphere(30.0), sphere(45.0)])
    assert bool((swapped[:, 1] >= swapped[:, 0]).all())
    missed = depths_from_meshes(points, outer, [sphere(1.0).moved(sphere(1.0).vertices + 1000)])
    torch.testing.assert_close(missed, torch.full((200, 1), 100.0), rtol=0, atol=1.0)
    capped = depths_from_meshes(points, outer, [sphere(30.0)], greatest_mm=7.0)
    assert float(capped.max()) == 7.0


@pytest.mark.parametrize("wound", [[0, 1, 2], [0, 2, 1]])
def test_a_layer_that_sticks_out_lies_at_the_surface(wound):
    """Else its far side, up to 25 mm down, would be taken for its boundary."""
    outer, ball = sphere(50.0), sphere(20.0)
    ball = replace(ball.moved(ball.vertices + torch.tensor([45.0, 0, 0])), faces=ball.faces[:, wound])
    points = scatter(outer, 500, seed=0)
    depth = depths_from_meshes(points, outer, [ball])[:, 0]
    within = (points.position(outer) - torch.tensor([45.0, 0, 0])).norm(dim=-1) < 19
    assert int(within.sum()) > 5 and float(depth[within].max()) < 0.2
    assert float(depth[~within].median()) > 50


def test_depths_need_layers_and_stop_when_asked():
    outer = sphere(50.0)
    points = scatter(outer, 10, seed=2)
    with pytest.raises(ShapeError, match="at least one layer"):
        depths_from_meshes(points, outer, [])
    with pytest.raises(Cancelled):
        depths_from_meshes(points, outer, [sphere(45.0)], cancel=lambda: True)
