"""The parts of a scene, each with its defaults: files, the atlas, and what all parts are made of.

Units are in the names.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NonNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Unit = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]
Cosine = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=-1, lt=1)]
Count = Annotated[int, Field(strict=True)]
Vector = tuple[Number, Number, Number]
Colour = tuple[NonNegative, NonNegative, NonNegative]

INTERMEDIATES = (
    "irradiance|diffused|exitance|radiance|single|coverage|albedo|position|normal|texel-mm|metric"
    "|through-mm|seam-jump"
    "|(gaussian|weight)-([1-9]|[12][0-9]|3[0-2])|thickness-([1-9]|[1-5][0-9]|6[0-4])"
)
"""Names of what lies between the stages, as a regular expression; Gaussians count from the narrowest, 1,
layers from the outermost, 1."""


class Model(BaseModel):
    """Frozen, and closed to unknown fields."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


class Source(Model):
    """Where bytes come from: exactly one of a file, an uploaded asset (sha256) or a builtin asset."""

    path: str | None = None
    asset: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    builtin: str | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> "Source":
        given = [name for name in ("path", "asset", "builtin") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"expected exactly one of path, asset, builtin, got {given or 'none'}")
        return self


def _as_source(value: Any) -> Any:
    return {"path": str(value)} if isinstance(value, str | Path) else value


SourceField = Annotated[Source, BeforeValidator(_as_source)]


class PoseSpec(Model):
    """A file of the same mesh whose vertices stand elsewhere, in the unit and upright as the mesh.

    `operators`: whether what carries light over the surface stays that of the rest pose, or is made anew.
    """

    source: SourceField
    operators: Literal["rest", "pose"] = "rest"


def _by_source(value: Any) -> Any:
    return {"source": value} if isinstance(value, str | Path) else value


class MeshSpec(Model):
    """The mesh file, how long one of its units is [mm] (None: assumed, and said), and which way is up.

    `v`: which way v of its texture coordinates runs; `auto` as its format prescribes. `pose`: where its
    vertices stand, if elsewhere; lights and cameras that are placed around the mesh stay where they are.
    """

    source: SourceField
    unit_mm: Positive | None = None
    up: Literal["y", "z", "x", "-y", "-z", "-x"] = "y"
    v: Literal["auto", "up", "down"] = "auto"
    pose: Annotated[PoseSpec, BeforeValidator(_by_source)] | None = None


MeshField = Annotated[MeshSpec, BeforeValidator(_by_source)]
"""A mesh, or the path of its file alone."""


class AtlasSpec(Model):
    """The lightmap's texture coordinates: the author's where they qualify (`auto`), or made by xatlas.

    `source` insists on the author's, `xatlas` on an unwrap; `fallback` projects along the axes, quickly.

    `raster`: edge of the lightmap that is computed on the same coordinates [texels], for drafts;
    None is `size`.
    """

    uv: Literal["auto", "source", "xatlas", "fallback"] = "auto"
    size: Annotated[Count, Field(ge=16, le=8192)] = 1024
    padding_texels: Annotated[Count, Field(ge=0, le=64)] = 5
    raster: Annotated[Count, Field(ge=16, le=8192)] | None = None

    @property
    def texels(self) -> int:
        """Edge of the lightmap that is computed [texels]."""
        return self.size if self.raster is None else self.raster


class MapSpec(Model):
    """An image in the author's texture coordinates. `srgb` is decoded; data maps are `linear`.

    `rgba` is for `material.depths` alone.
    """

    source: SourceField
    space: Literal["srgb", "linear"] = "linear"
    channel: Literal["rgb", "rgba", "r", "g", "b", "a", "luminance"] = "rgb"
