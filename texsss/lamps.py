"""The lights of a scene."""

from typing import Annotated, Literal, Union

from pydantic import Field, model_validator

from texsss.specs import Colour, Count, Model, NonNegative, Number, Positive, Vector


class PointSpec(Model):
    """A point light: position [mm], intensity [W/sr]."""

    type: Literal["point"] = "point"
    position_mm: Vector
    intensity_w_per_sr: Colour = (1.0, 1.0, 1.0)


class DirectionalSpec(Model):
    """A distant light: direction towards it, irradiance on a plane that faces it [W/m²]."""

    type: Literal["directional"] = "directional"
    direction: Vector
    irradiance_w_per_m2: Colour = (3.0, 3.0, 3.0)


class SpotSpec(Model):
    """A point light in a cone around `direction`, the way it shines: full within `inner_deg`,
    none beyond `outer_deg`.
    """

    type: Literal["spot"] = "spot"
    position_mm: Vector
    direction: Vector
    intensity_w_per_sr: Colour = (1.0, 1.0, 1.0)
    inner_deg: Annotated[Number, Field(ge=0, lt=90)] = 20.0
    outer_deg: Annotated[Number, Field(gt=0, le=90)] = 25.0

    @model_validator(mode="after")
    def _inner_within_outer(self) -> "SpotSpec":
        if self.inner_deg > self.outer_deg:
            raise ValueError(
                f"expected inner_deg up to outer_deg, got {self.inner_deg:g} and {self.outer_deg:g}; "
                "raise outer_deg"
            )
        return self


class RectangleSpec(Model):
    """A panel around `position_mm` whose edges are two vectors [mm]; it shines towards width × height.

    `samples`: looks at it from every texel; with several panels and balls the most count for all.
    """

    type: Literal["rectangle"] = "rectangle"
    position_mm: Vector
    width_mm: Vector
    height_mm: Vector
    radiance: Colour = (1.0, 1.0, 1.0)
    samples: Annotated[Count, Field(ge=1, le=4096)] = 16


class SphereSpec(Model):
    """A glowing ball: centre and radius [mm], radiance [W/(m² sr)]; `samples` as of a panel."""

    type: Literal["sphere"] = "sphere"
    position_mm: Vector
    radius_mm: Positive
    radiance: Colour = (1.0, 1.0, 1.0)
    samples: Annotated[Count, Field(ge=1, le=4096)] = 16


class EnvironmentSpec(Model):
    """Light from everywhere: one radiance [W/(m² sr)], or a panorama (a name in `maps`) times it.

    The centre of the panorama lies towards -z, behind the object seen from the front; `rotation_deg` turns it
    counter-clockwise seen from above. `samples`: looks that stand for each texel; it takes every 16th of
    them itself, at least two, and shares its neighbours'. With several environments the most count for all.
    """

    type: Literal["environment"] = "environment"
    radiance: Colour = (1.0, 1.0, 1.0)
    map: str | None = None
    rotation_deg: Number = 0.0
    samples: Annotated[Count, Field(ge=1, le=65536)] = 64


class StudioSpec(Model):
    """Key, rim and fill placed around the object and scaled to it, as a photographer would."""

    type: Literal["studio"] = "studio"
    intensity: NonNegative = 1.0


LightSpec = Annotated[
    Union[  # noqa: UP007
        PointSpec, SpotSpec, DirectionalSpec, RectangleSpec, SphereSpec, EnvironmentSpec, StudioSpec
    ],
    Field(discriminator="type"),
]


LIGHTS = ("point", "spot", "directional", "rectangle", "sphere", "environment", "studio")
"""Types of lights."""
