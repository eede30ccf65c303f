"""Lights with a size: their shadows have soft edges."""

import math
from dataclasses import dataclass

import torch

from texsss.errors import DomainError
from texsss.light.emitters import LightSamples, Triple, basis, like, triple
from texsss.light.panel_angle import LEAST_SR, towards
from texsss.types import Float, Tensor, unit


@dataclass(frozen=True, eq=False)
class RectangleLight:
    """A panel of constant `radiance` (3,) [W/(m² sr)].

    `position` (3,): its centre [mm]; `width`, `height` (3,): its edges as vectors [mm], which need not
    be perpendicular. It shines to the side of width × height only. Its intensity along that normal is
    radiance × area.
    Raises ShapeError, DomainError: when these are not triples of finite numbers, the panel has no
    area, or radiance is negative.
    """

    position: Triple
    width: Triple
    height: Triple
    radiance: Triple
    is_delta = False

    def __post_init__(self):
        triple(self, "position")
        across = torch.linalg.cross(triple(self, "width"), triple(self, "height"))
        triple(self, "radiance", least=0.0)
        if not float(torch.linalg.vector_norm(across.detach())) > 0:
            raise DomainError(
                "RectangleLight: expected a width and a height that span an area, got none; give both a "
                "length and turn one against the other."
            )

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """See `Light.sample`; directions are uniform within the solid angle of the panel.

        So no sample is brighter than the panel seen whole, however near or large that is.
        """
        width, height = like(self.width, position), like(self.height, position)
        centre = like(self.position, position) - position
        direction, angle = towards(centre - 0.5 * (width + height), width, height, square)
        direction, angle = direction.to(position), angle.to(position)
        across = torch.linalg.cross(width, height)  # the normal, times the area
        towards_plane = (centre * across).sum(-1)
        # far away it is a point: dω = cos dA / d²; mm² cancel
        squared = (centre * centre).sum(-1).clamp_min(1e-6)
        small = angle < LEAST_SR
        direction = torch.where(small[:, None], unit(centre), direction)
        angle = torch.where(small, towards_plane.abs() / squared**1.5, angle)
        along = (direction * across).sum(-1)
        distance = towards_plane / torch.where(along == 0, 1.0, along)
        irradiance = like(self.radiance, position) * (angle * (towards_plane < 0))[:, None]
        return LightSamples(direction, distance.clamp_min(0), irradiance)


@dataclass(frozen=True, eq=False)
class SphereLight:
    """A ball of constant `radiance` (3,) [W/(m² sr)], centred at `position` (3,) [mm], `radius` [mm].

    Its intensity is π radius² × radiance. Points within are lit as from just outside.
    Raises ShapeError, DomainError: when position or radiance are not triples of finite numbers,
    radiance is negative or radius not above 0.
    """

    position: Triple
    radius: float
    radiance: Triple
    is_delta = False

    def __post_init__(self):
        triple(self, "position")
        triple(self, "radiance", least=0.0)
        if not (self.radius > 0 and math.isfinite(self.radius)):
            raise DomainError(f"SphereLight: expected a radius above 0 mm, got {self.radius}.")

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """See `Light.sample`; directions are uniform within the cone that the ball subtends."""
        offset = like(self.position, position) - position
        away = torch.sqrt((offset * offset).sum(-1)).clamp_min(self.radius * (1 + 1e-4))
        sine2 = (self.radius / away) ** 2
        # 1 - cos of the cone, which would cancel for a small ball
        opening = sine2 / (1 + torch.sqrt(1 - sine2))
        drop = square[:, 0] * opening  # 1 - cos of the sample
        cosine, sine = 1 - drop, torch.sqrt((drop * (2 - drop)).clamp_min(0))
        axis = unit(offset)
        tangent, bitangent = basis(axis)
        angle = 2 * math.pi * square[:, 1]
        direction = (
            (sine * torch.cos(angle))[:, None] * tangent
            + (sine * torch.sin(angle))[:, None] * bitangent
            + cosine[:, None] * axis
        )
        depth = torch.sqrt((self.radius**2 - (away * sine) ** 2).clamp_min(0))
        irradiance = like(self.radiance, position) * (2 * math.pi * opening)[:, None]
        return LightSamples(direction, away * cosine - depth, irradiance)
