"""How a scene's picture is taken and shown; units are in the names."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from texsss.specs import Colour, Count, Model, Number, Vector


class CameraSpec(Model):
    """Where the picture is taken from. With `fit`, from `direction`, so that the object fills the frame."""

    fit: bool = True
    direction: Vector = (0.0, 0.0, 1.0)
    position_mm: Vector | None = None
    target_mm: Vector | None = None
    fov_y_deg: Annotated[Number, Field(ge=1, le=150)] = 35.0
    resolution: tuple[Annotated[Count, Field(ge=1, le=8192)], Annotated[Count, Field(ge=1, le=8192)]] = (
        800,
        600,
    )
    samples: Annotated[Count, Field(ge=1, le=64)] = 9

    @model_validator(mode="before")
    @classmethod
    def _place_given(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("position_mm") and data.get("target_mm"):
            return {"fit": False, **data}
        return data

    @model_validator(mode="after")
    def _placed(self) -> "CameraSpec":
        if not self.fit and (self.position_mm is None or self.target_mm is None):
            raise ValueError("expected position_mm and target_mm when fit is false")
        if not any(self.direction):
            raise ValueError("expected a direction other than zero")
        return self


class OutputSpec(Model):
    """How radiance becomes a picture."""

    exposure_ev: Annotated[Number, Field(ge=-30, le=30)] = 0.0
    tonemap: Literal["linear", "agx", "aces"] = "agx"
    background: Colour | None = None
