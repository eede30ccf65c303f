"""The parts of a scene, each with its defaults; units are in the names."""

from pathlib import Path
from typing import Annotated, Any, Literal, Union

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


class MapValue(Model):
    """A coefficient or thickness painted in a map: 0 and 1 of the map mean the ends of `range`.

    Nothing stands in for a range that is left out: a map alone says nothing of millimetres.
    """

    map: str
    range: tuple[NonNegative, NonNegative] | None = None
    invert: bool = False


class MediumSpec(Model):
    """A preset, or coefficients [1/mm]; a map as coefficient varies over the surface.

    `eta` beyond 1.6 wants `methods.profile` layered-diffusion. `g`: mean cosine of scattering. `phase`: the
    shape around it of light that pictures march; diffusion has Henyey and Greenstein's.
    """

    preset: str | None = None
    sigma_a_per_mm: NonNegative | Colour | MapValue | None = None
    sigma_s_per_mm: NonNegative | Colour | MapValue | None = None
    g: Cosine | tuple[Cosine, Cosine, Cosine] = 0.0
    eta: Annotated[Number, Field(ge=1, le=3)] = 1.3
    phase: Literal["henyey-greenstein", "schlick"] = "henyey-greenstein"

    @model_validator(mode="after")
    def _preset_or_coefficients(self) -> "MediumSpec":
        given = [value is not None for value in (self.sigma_a_per_mm, self.sigma_s_per_mm)]
        if any(given) if self.preset is not None else not all(given):
            raise ValueError("expected either preset, or both sigma_a_per_mm and sigma_s_per_mm")
        plain = (0.0, 1.3, "henyey-greenstein")
        if self.preset is not None and (self.g, self.eta, self.phase) != plain:
            raise ValueError(
                "expected a preset alone, got g, eta or phase beside it; give coefficients to change them"
            )
        _check_range("sigma_a_per_mm", self.sigma_a_per_mm, "1/mm")
        _check_range("sigma_s_per_mm", self.sigma_s_per_mm, "1/mm")
        return self


def _check_range(field: str, value: Any, unit: str) -> None:
    if isinstance(value, MapValue) and value.range is None:
        raise ValueError(
            f"expected a range beside the map {value.map!r} of {field}, got none; "
            f'say what its 0 and 1 mean [{unit}], as in "range": [0.1, 2]'
        )


class Mix(Model):
    """Two media blended by a mask: 0 is the first, 1 the second."""

    mix: tuple[str, str]
    mask: str


class LayerSpec(Model):
    """A medium (a name in `media`, or a preset) and its thickness [mm]; None is infinite (the last only)."""

    medium: str | Mix = "skin1"
    thickness_mm: Positive | MapValue | None = None

    @model_validator(mode="after")
    def _map_means_millimetres(self) -> "LayerSpec":
        _check_range("thickness_mm", self.thickness_mm, "mm")
        return self


class SurfaceSpec(Model):
    """What lies on top: albedo and normal maps by name in `maps`, microfacet roughness.

    `albedo_mode` says where the albedo applies: before diffusion, after it, or its root at both.
    With an albedo map, profiles are normalised to total 1 per channel, unless `normalise` says
    otherwise: else skin would darken twice. `normal_y`: whether green leans up (OpenGL) or down
    (DirectX) in the normal map. `roughness` and `specular` are numbers or names of grey maps;
    `second_lobe` is the share of a second, coarser highlight, which skin has.
    """

    albedo: str | None = None
    albedo_mode: Literal["pre", "post", "both"] = "post"
    normalise: bool | None = None
    normal: str | None = None
    normal_y: Literal["+y", "-y"] = "+y"
    roughness: Unit | str = 0.4
    specular: Unit | str = 1.0
    second_lobe: Unit = 0.0


class DepthsSpec(Model):
    """Depth textures: their channels, in order, are the depths of the layers' lower boundaries.

    `maps`: names of maps, whose channels follow each other; "channel": "rgba" reads four of each (an
    alpha of 1 everywhere is none). `range_mm`: what 0 and 1 mean [mm], exchanged by `invert`. A channel
    that lies above the one before it is refused, unless `sort` puts them in order.
    """

    maps: Annotated[tuple[str, ...], Field(min_length=1, max_length=16)]
    range_mm: tuple[NonNegative, NonNegative]
    invert: bool = False
    sort: bool = False

    @model_validator(mode="after")
    def _rises(self) -> "DepthsSpec":
        low, high = self.range_mm
        if low > high:
            raise ValueError(
                f"expected range_mm to rise, got {low:g} to {high:g}; exchange them and set invert to true"
            )
        return self


class MaterialSpec(Model):
    """A stack of layers, outermost first, and the surface on it.

    With `depths` the layers are as thick as these textures say: one layer for every channel, or one more
    that has no end.
    """

    layers: Annotated[tuple[LayerSpec, ...], Field(min_length=1, max_length=64)] = (LayerSpec(),)
    depths: DepthsSpec | None = None
    surface: SurfaceSpec = SurfaceSpec()

    @model_validator(mode="after")
    def _one_thickness(self) -> "MaterialSpec":
        if self.depths is not None:
            for number, layer in enumerate(self.layers):
                if layer.thickness_mm is not None:
                    raise ValueError(
                        f"expected no thickness_mm beside depths, got one in layers.{number}; leave it out, "
                        "as the depths say where layers end"
                    )
        return self


def _as_material(value: Any) -> Any:
    return {"layers": [{"medium": value}]} if isinstance(value, str) else value


MaterialField = Annotated[MaterialSpec, BeforeValidator(_as_material)]
"""A material, or the name of its only medium."""


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
