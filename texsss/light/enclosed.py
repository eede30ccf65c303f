"""Lights that stand inside the object, where no surface faces them."""

import math
from collections.abc import Sequence

import torch

from texsss.light.emitters import Light
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Float, Tensor, unit

LOOKS = 128  # directions in which a light looks around
MOST_OPEN = 0.5  # of them may leave by holes: necks of busts are open


def enclosed(lights: Sequence[Light], mesh: Mesh, occluder: Occluder) -> list[str]:
    """What to know of lights inside the object, in sentences; none if there are none.

    Such a light sees the surface from behind alone, all around but for holes. It lights nothing: the surface
    is lit from outside, and no light is followed from within a medium. Of panels and balls the middle counts.
    """
    told = []
    for light in lights:
        place = getattr(light, "position", None)
        if place is None:
            continue
        at = torch.as_tensor(place, dtype=torch.float64)
        if _sees_the_back(at, mesh, occluder):
            where = ", ".join(f"{x:g}" for x in at.tolist())
            told.append(
                f"The light at ({where}) mm is inside the object and lights nothing: move it outside."
            )
    return told


def _sees_the_back(at: Float[Tensor, "3"], mesh: Mesh, occluder: Occluder) -> bool:
    """Whether every face seen from a place turns its back, in most directions."""
    directions = _around().to(mesh.vertices)
    face, bary, _ = occluder.closest(at.to(mesh.vertices).expand_as(directions), directions)
    met = face >= 0
    if not bool(met.float().mean() > 1 - MOST_OPEN):
        return False
    normal = Points(face[met].int(), bary[met]).face_normal(mesh)
    return bool(((normal * directions[met]).sum(-1) > 0).all())


def _around() -> Float[Tensor, "LOOKS 3"]:
    """Directions spread evenly over the sphere."""
    number = torch.arange(LOOKS, dtype=torch.float64) + 0.5
    height, turn = 1 - 2 * number / LOOKS, number * (math.pi * (3 - math.sqrt(5)))
    aside = torch.sqrt(1 - height**2)
    return unit(torch.stack([aside * torch.cos(turn), height, aside * torch.sin(turn)], -1))
