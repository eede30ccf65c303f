"""What the user asks for: one schema for Python, JSON files, the command line and HTTP.

A `Scene` holds no tensors and reads no files; every field has a default and states its unit in its
name. `resolve.py` turns it into tensors.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from texsss.complaints import one_sentence
from texsss.errors import AssetError, DomainError
from texsss.lamps import EnvironmentSpec, LightSpec, StudioSpec
from texsss.material import MapValue, MaterialField, MaterialSpec, MediumSpec, Mix
from texsss.methods import MethodsSpec
from texsss.shots import CameraSpec, OutputSpec
from texsss.specs import AtlasSpec, Count, MapSpec, MeshField, MeshSpec, Model

SCHEMA_VERSION = 1

MIGRATIONS: dict[int, Callable[[dict], dict]] = {}
"""Version n → the function that turns a scene of version n into one of version n + 1."""

DEFAULT_OBJECT: dict[str, Any] = {
    "mesh": {"source": {"builtin": "axolotl/axolotl.obj"}, "unit_mm": 1.0},
    "maps": {"albedo": {"source": {"builtin": "axolotl/albedo.png"}, "space": "srgb"}},
    "material": {"layers": [{"medium": "skin1"}], "surface": {"albedo": "albedo", "roughness": 0.35}},
    "lights": [{"type": "studio", "intensity": 1.3}],
    "camera": {"direction": [0.62, 0.36, 0.7], "fov_y_deg": 18.0, "resolution": [1120, 630]},
    "atlas": {"size": 512},
    "methods": {"diffusion": "surface"},
    "output": {"tonemap": "aces"},
}
"""What stands in where a scene names no mesh."""


class _Told(type(Model)):
    """Scenes made by a call, `Scene(size=…)`, tell bad input in one sentence, as parsed ones do."""

    def __call__(cls, *given: Any, **fields: Any) -> Any:
        try:
            return super().__call__(*given, **fields)
        except ValidationError as error:
            raise DomainError(one_sentence(error, fields)) from None


GREATEST_ETA = {"layered-sp3": 1.6}  # by methods.profile; others take any
MOST_NAMES = 256  # maps or media of a scene
MOST_TOLD = 20  # of them in a message


class Scene(Model, metaclass=_Told):
    """Everything a bake depends on, as plain values. `Scene()` is the default scene.

    `summary`: what it shows, for people.
    A scene without a mesh takes our own, and with it those of its maps, atlas, material,
    lights, camera, methods and output that the scene does not state.
    """

    version: Literal[1] = SCHEMA_VERSION
    summary: Annotated[str, Field(max_length=500)] = ""
    mesh: MeshField = MeshSpec(**DEFAULT_OBJECT["mesh"])
    atlas: AtlasSpec = AtlasSpec()
    maps: Annotated[dict[str, MapSpec], Field(max_length=MOST_NAMES)] = Field(default_factory=dict)
    media: Annotated[dict[str, MediumSpec], Field(max_length=MOST_NAMES)] = Field(default_factory=dict)
    material: MaterialField = MaterialSpec()
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
        return _filled(data, DEFAULT_OBJECT)

    @model_validator(mode="after")
    def _model_knows_index(self) -> "Scene":
        most = GREATEST_ETA.get(self.methods.profile, math.inf)
        for layer in self.material.layers:
            names = layer.medium.mix if isinstance(layer.medium, Mix) else (layer.medium,)
            for name in names:
                if name in self.media and self.media[name].eta > most:
                    raise ValueError(
                        f"media.{name}.eta: expected at most {most:g}, which methods.profile "
                        f"{self.methods.profile!r} is fitted to, got {self.media[name].eta:g}; "
                        "choose 'layered-diffusion' for it"
                    )
        return self

    @model_validator(mode="after")
    def _names_exist(self) -> "Scene":
        for where, name in self.map_names():
            if name not in self.maps:
                known = sorted(self.maps)[:MOST_TOLD]
                more = ", …" if len(self.maps) > MOST_TOLD else ""
                listed = f"[{', '.join(map(repr, known))}{more}]" if known else "none"
                raise ValueError(f"{where}: no map is named {name!r}; maps has {listed}")
            if self.maps[name].channel == "rgba" and not where.startswith("material.depths"):
                raise ValueError(
                    f"{where}: expected a map of colours or of one channel, got {name!r} with channel "
                    "'rgba'; only material.depths reads all four"
                )
        return self

    def panoramas(self) -> set[str]:
        """Names of the maps that light the scene."""
        return {light.map for light in self.lights if isinstance(light, EnvironmentSpec) and light.map}

    def map_names(self) -> list[tuple[str, str]]:
        """(field, map name) of every map that something refers to."""
        surface = self.material.surface
        used = [
            (f"material.surface.{f}", getattr(surface, f))
            for f in ("albedo", "normal", "roughness", "specular")
        ]
        used += [(f"lights.{i}.map", getattr(light, "map", None)) for i, light in enumerate(self.lights)]
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
        depths = self.material.depths
        used += (
            [] if depths is None else [(f"material.depths.maps.{i}", n) for i, n in enumerate(depths.maps)]
        )
        used.append(("methods.march.noise_map", self.methods.march.noise_map))
        parallax = self.methods.parallax
        used.append(("methods.parallax.opacity", parallax.opacity))
        for i, layer in enumerate(parallax.layers):
            used += [(f"methods.parallax.layers.{i}.{f}", getattr(layer, f)) for f in ("base", "opacity")]
        return [(where, name) for where, name in used if isinstance(name, str)]

    @classmethod
    def parse(cls, data: dict) -> "Scene":
        """The scene that plain data (a parsed JSON object) describes, migrated if it is older.

        Raises DomainError: with the field, what was expected and what came.
        """
        try:
            return cls.model_validate(migrate(data))
        except ValidationError as error:
            raise DomainError(one_sentence(error, data)) from None

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


def _filled(value: Any, default: Any) -> Any:
    """`value` with the fields of `default` that it does not state, within its parts too, but for sources."""
    if not isinstance(value, dict) or not isinstance(default, dict):
        return value
    parts = {name: None if name == "source" else default.get(name) for name in value}
    stated = {name: _filled(item, parts[name]) for name, item in value.items()}
    return {**default, **stated}


FILE_FIELDS = ("path", "source", "mesh", "pose")  # a mesh, source or pose may be its file's path alone


def _anchored(value: Any, folder: Path) -> Any:
    """`value` with every relative path of a source made relative to `folder`."""
    if isinstance(value, dict):
        return {
            key: str(folder / item)
            if key in FILE_FIELDS and isinstance(item, str)
            else _anchored(item, folder)
            for key, item in value.items()
        }
    return [_anchored(item, folder) for item in value] if isinstance(value, list) else value
