"""Lights inside the object are told, and no others."""

import pytest
import torch
import trimesh

from texsss.light.areas import SphereLight
from texsss.light.emitters import ConstantEnvironment, DirectionalLight, PointLight
from texsss.light.enclosed import enclosed
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh

POWER = [1.0, 1.0, 1.0]


def meshed(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(torch.from_numpy(shape.vertices).float(), torch.from_numpy(shape.faces).long())


@pytest.fixture(scope="module")
def torus() -> Mesh:
    return meshed(trimesh.creation.torus(40.0, 10.0))


@pytest.mark.parametrize(
    ("place", "inside"),
    [
        ((40.0, 0.0, 0.0), True),
        ((40.0, 0.0, 9.5), True),
        ((0.0, 0.0, 0.0), False),  # in its hole
        ((40.0, 0.0, 10.5), False),
        ((-300.0, 0.0, 0.0), False),
    ],
)
def test_lights_inside_a_torus_are_told(torus, place, inside):
    for light in (PointLight(list(place), POWER), SphereLight(list(place), 0.1, POWER)):
        told = enclosed([light], torus, Occluder(torus))
        assert len(told) == inside
        assert not inside or f"({place[0]:g}, 0, {place[2]:g}) mm is inside" in told[0]


def test_an_open_neck_does_not_let_a_light_out():
    """A bust whose floor is missing; and a room seen from within is no object with a light inside."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=50.0)
    whole = meshed(ball)
    bust = Mesh(whole.vertices, whole.faces[ball.triangles_center[:, 1] > -30])
    inside = PointLight([0.0, 0.0, 0.0], POWER)
    assert len(enclosed([inside], bust, Occluder(bust))) == 1
    ball.invert()
    room = meshed(ball)
    assert enclosed([inside], room, Occluder(room)) == []


def test_suns_and_skies_are_nowhere(torus):
    assert (
        enclosed(
            [DirectionalLight([0.0, 1.0, 0.0], POWER), ConstantEnvironment(POWER)], torus, Occluder(torus)
        )
        == []
    )
