"""What the user asks for: one schema for Python, JSON files, the command line and HTTP.

A `Scene` holds no tensors and reads no files; every field has a default and states its unit in its
name. `resolve.py` turns it into tensors.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Union

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from texsss.errors import AssetError, DomainError

SCHEMA_VERSION = 1

MIGRATIONS: dict[int, Callable[[dict], dict]] = {}
"""Version n → the function that turns a scene of version n into one of version n + 1."""

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NonNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Unit = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]
Count = Annotated[int, Field(strict=True)]
Vector = tuple[Number, Number, Number]
Colour = tuple[NonNegative, NonNegative, NonNegative]


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


class MeshSpec(Model):
    """The mesh file, how long one of its units is [mm] (None: assumed, and said), and which way is up."""

    source: SourceField
    unit_mm: Positive | None = None
    up: Literal["y", "z"] = "y"


class AtlasSpec(Model):
    """The lightmap's texture coordinates: the author's where they qualify (`auto`), or made by xatlas."""

    uv: Literal["auto", "source", "xatlas"] = "auto"
    size: Annotated[Count, Field(ge=16, le=8192)] = 1024
    padding_texels: Annotated[Count, Field(ge=0, le=64)] = 5


class MapSpec(Model):
    """An image in the author's texture coordinates. `srgb` is decoded; data maps are `linear`."""

    source: SourceField
    space: Literal["srgb", "linear"] = "linear"
    channel: Literal["rgb", "r", "g", "b", "a", "luminance"] = "rgb"


class MapValue(Model):
    """A coefficient or thickness painted in a map: 0 and 1 of the map mean the ends of `range`."""

    map: str
    range: tuple[NonNegative, NonNegative] = (0.0, 1.0)
    invert: bool = False


class MediumSpec(Model):
    """A preset, or coefficients [1/mm]; a map as coefficient varies over the surface."""

    preset: str | None = None
    sigma_a_per_mm: NonNegative | Colour | MapValue | None = None
    sigma_s_per_mm: NonNegative | Colour | MapValue | None = None
    g: Number | Vector = 0.0
    eta: Annotated[Number, Field(ge=1, le=3)] = 1.3

    @model_validator(mode="after")
    def _preset_or_coefficients(self) -> "MediumSpec":
        given = [value is not None for value in (self.sigma_a_per_mm, self.sigma_s_per_mm)]
        if any(given) if self.preset is not None else not all(given):
            raise ValueError("expected either preset, or both sigma_a_per_mm and sigma_s_per_mm")
        return self


class Mix(Model):
    """Two media blended by a mask: 0 is the first, 1 the second."""

    mix: tuple[str, str]
    mask: str


class LayerSpec(Model):
    """A medium (a name in `media`, or a preset) and its thickness [mm]; None is infinite (the last only)."""

    medium: str | Mix = "skin1"
    thickness_mm: Positive | MapValue | None = None


class SurfaceSpec(Model):
    """What lies on top: albedo and normal maps by name in `maps`, microfacet roughness.

    `albedo_mode` says where the albedo applies: before diffusion, after it, or its root at both.
    With an albedo map, profiles are normalised to total 1 per channel, unless `normalise` says
    otherwise: else skin would darken twice.
    """

    albedo: str | None = None
    albedo_mode: Literal["pre", "post", "both"] = "post"
    normalise: bool | None = None
    normal: str | None = None
    normal_y: Literal["+y", "-y"] = "+y"
    roughness: Unit | str = 0.4
    specular: Unit | str = 1.0


class MaterialSpec(Model):
    """A stack of layers, outermost first, and the surface on it."""

    layers: Annotated[tuple[LayerSpec, ...], Field(min_length=1, max_length=64)] = (LayerSpec(),)
    surface: SurfaceSpec = SurfaceSpec()


def _as_material(value: Any) -> Any:
    return {"layers": [{"medium": value}]} if isinstance(value, str) else value


def _as_mesh(value: Any) -> Any:
    return {"source": value} if isinstance(value, str | Path) else value


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


class EnvironmentSpec(Model):
    """Light from everywhere: one radiance [W/(m² sr)]."""

    type: Literal["environment"] = "environment"
    radiance: Colour = (1.0, 1.0, 1.0)


class StudioSpec(Model):
    """Key, rim and fill placed around the object and scaled to it, as a photographer would."""

    type: Literal["studio"] = "studio"
    intensity: NonNegative = 1.0


LightSpec = Annotated[
    Union[PointSpec, DirectionalSpec, EnvironmentSpec, StudioSpec],  # noqa: UP007
    Field(discriminator="type"),
]


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

    @model_validator(mode="after")
    def _placed(self) -> "CameraSpec":
        if not self.fit and (self.position_mm is None or self.target_mm is None):
            raise ValueError("expected position_mm and target_mm when fit is false")
        if not any(self.direction):
            raise ValueError("expected a direction other than zero")
        return self


class MethodsSpec(Model):
    """Which method computes each stage; all are named, so that they can be compared."""

    profile: Literal["dipole", "better-dipole", "multipole", "layered-diffusion", "layered-sp3"] = (
        "layered-sp3"
    )
    diffusion: Literal["none", "uv", "surface", "octree", "poisson", "parallax"] = "uv"
    rule: Literal["exit", "entry", "geometric-mean"] = "exit"
    terms: Annotated[Count, Field(ge=1, le=32)] = 8
    incidence: Literal["diffuse", "normal"] = "diffuse"
    single_scattering: Literal["none", "uniform", "exact"] = "none"
    transmission: bool = False


class OutputSpec(Model):
    """How radiance becomes a picture."""

    exposure_ev: Annotated[Number, Field(ge=-30, le=30)] = 0.0
    tonemap: Literal["linear", "agx", "aces"] = "agx"
    background: Colour | None = None


DEFAULT_OBJECT: dict[str, Any] = {
    "mesh": {"source": {"builtin": "axolotl/axolotl.obj"}, "unit_mm": 1.0},
    "maps": {"albedo": {"source": {"builtin": "axolotl/albedo.png"}, "space": "srgb"}},
    "material": {"layers": [{"medium": "skin1"}], "surface": {"albedo": "albedo", "roughness": 0.35}},
    "camera": {"direction": [0.6, 0.35, 1.0]},
}
"""What stands in where a scene names no mesh."""


class Scene(Model):
    """Everything a bake depends on, as plain values. `Scene()` is the default scene.

    A scene without a mesh takes our own, and with it those of its maps, material and camera that
    the scene does not state.
    """

    version: Literal[1] = SCHEMA_VERSION
    mesh: Annotated[MeshSpec, BeforeValidator(_as_mesh)] = MeshSpec(**DEFAULT_OBJECT["mesh"])
    atlas: AtlasSpec = AtlasSpec()
    maps: dict[str, MapSpec] = {}
    media: dict[str, MediumSpec] = {}
    material: Annotated[MaterialSpec, BeforeValidator(_as_material)] = MaterialSpec()
    lights: Annotated[tuple[LightSpec, ...], Field(max_length=64)] = (StudioSpec(),)
    camera: CameraSpec = CameraSpec()
    methods: MethodsSpec = MethodsSpec()
    output: OutputSpec = OutputSpec()
    seed: Annotated[Count, Field(ge=0, le=2**31 - 1)] = 0

    @model_validator(mode="before")
    @classmethod
    def _default_object(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "mesh" in data:
            return data
        if "maps" in data:  # the author's maps stand beside ours
            data = (
                data | {"maps": {**DEFAULT_OBJECT["maps"], **data["maps"]}}
                if isinstance(data["maps"], dict)
                else data
            )
        return DEFAULT_OBJECT | data

    @model_validator(mode="after")
    def _names_exist(self) -> "Scene":
        for where, name in self.map_names():
            if name not in self.maps:
                raise ValueError(f"{where}: no map is named {name!r}; maps has {sorted(self.maps) or 'none'}")
        return self

    def map_names(self) -> list[tuple[str, str]]:
        """(field, map name) of every map that something refers to."""
        surface = self.material.surface
        used = [
            (f"material.surface.{f}", getattr(surface, f))
            for f in ("albedo", "normal", "roughness", "specular")
        ]
        for i, layer in enumerate(self.material.layers):
            where = f"material.layers.{i}"
            if isinstance(layer.medium, Mix):
                used.append((f"{where}.medium.mask", layer.medium.mask))
            if isinstance(layer.thickness_mm, MapValue):
                used.append((f"{where}.thickness_mm.map", layer.thickness_mm.map))
        for name, medium in self.media.items():
            for field in ("sigma_a_per_mm", "sigma_s_per_mm"):
                value = getattr(medium, field)
                if isinstance(value, MapValue):
                    used.append((f"media.{name}.{field}.map", value.map))
        return [(where, name) for where, name in used if isinstance(name, str)]

    @classmethod
    def parse(cls, data: dict) -> "Scene":
        """The scene that plain data (a parsed JSON object) describes, migrated if it is older.

        Raises DomainError: with the field, what was expected and what came.
        """
        try:
            return cls.model_validate(migrate(data))
        except ValidationError as error:
            raise DomainError(_one_sentence(error)) from None

    @classmethod
    def load(cls, path: str | Path) -> "Scene":
        """The scene in a JSON file; paths in it are relative to the file.

        Raises AssetError: when the file is missing or not JSON. DomainError: as `parse`.
        """
        path = Path(path)
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise AssetError(f"Scene: expected a file, found none at {path}; check the path.") from None
        except (OSError, UnicodeDecodeError) as error:
            raise AssetError(
                f"Scene: {path} cannot be read ({type(error).__name__}); check the file."
            ) from None
        except (json.JSONDecodeError, RecursionError) as error:
            raise AssetError(
                f"Scene: {path} is not JSON ({error}); mend it or run `texsss scene init`."
            ) from None
        if not isinstance(data, dict):
            raise AssetError(f"Scene: expected a JSON object in {path}, got {type(data).__name__}.")
        try:
            return cls.parse(_anchored(data, path.parent))
        except DomainError as error:
            raise DomainError(f"{error} (in {path})") from None

    def save(self, path: str | Path) -> None:
        """Writes the scene as JSON."""
        Path(path).write_text(self.to_json(), encoding="utf-8")

    def to_json(self) -> str:
        """The scene as indented JSON text."""
        return json.dumps(self.model_dump(mode="json"), indent=2) + "\n"


def migrate(data: dict) -> dict:
    """`data` in today's schema version. Raises DomainError: when it is newer than this program."""
    version = data.get("version", SCHEMA_VERSION)
    if not isinstance(version, int) or isinstance(version, bool) or not version >= 1:
        raise DomainError(f"Scene: version: expected an integer from 1 to {SCHEMA_VERSION}, got {version!r}.")
    if version > SCHEMA_VERSION:
        raise DomainError(
            f"Scene: version: this texsss reads up to {SCHEMA_VERSION}, got {version}; update texsss."
        )
    for step in range(version, SCHEMA_VERSION):
        data = MIGRATIONS[step](data) | {"version": step + 1}
    return data


def _anchored(value: Any, folder: Path) -> Any:
    """`value` with every relative `path` of a source made relative to `folder`."""
    if isinstance(value, dict):
        return {
            key: str(folder / item) if key == "path" and isinstance(item, str) else _anchored(item, folder)
            for key, item in value.items()
        }
    return [_anchored(item, folder) for item in value] if isinstance(value, list) else value


def _one_sentence(error: ValidationError) -> str:
    """The first of pydantic's complaints, with its field; the rest are counted."""
    problems = error.errors(include_url=False)
    first = problems[0]
    field = ".".join(str(part) for part in first["loc"]) or "scene"
    message = first["msg"].removeprefix("Value error, ")
    got = first.get("input")
    shown = f", got {got!r}" if isinstance(got, str | int | float | None) and "got" not in message else ""
    more = f" ({len(problems) - 1} more)" if len(problems) > 1 else ""
    return f"Scene: {field}: {message[0].lower() + message[1:]}{shown}{more}."
