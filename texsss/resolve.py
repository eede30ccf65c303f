"""From a scene to tensors: files found and read, names looked up, lights and camera placed."""

import math
from functools import lru_cache
from hashlib import blake2b
from importlib.resources import files
from pathlib import Path
from typing import Any

import torch

from texsss.errors import AssetError, DomainError
from texsss.io.images import read_image
from texsss.io.meshes import MeshNotes, read_mesh
from texsss.light.emitters import ConstantEnvironment, DirectionalLight, Light, PointLight
from texsss.media.medium import Medium, mix
from texsss.media.presets import PRESETS, preset
from texsss.media.stack import Layer, Stack
from texsss.scene import Scene
from texsss.specs import (
    CameraSpec,
    DirectionalSpec,
    EnvironmentSpec,
    MapSpec,
    MapValue,
    MeshSpec,
    Mix,
    PointSpec,
    Source,
    StudioSpec,
)
from texsss.surface.mesh import Mesh
from texsss.types import Float, Tensor
from texsss.view.camera import Camera, fit_camera

BACKDROP = ((0.020, 0.024, 0.030), (0.075, 0.082, 0.092))

Images = dict[str, Float[Tensor, "H W C"]]


def locate(source: Source) -> Path:
    """The file that a source names. Raises AssetError: when there is none."""
    if source.asset is not None:
        raise AssetError(
            f"Source: asset {source.asset[:12]}… is known to the service only; give a path instead."
        )
    if source.builtin is not None:
        if source.builtin not in builtins():
            raise AssetError(
                f"Source: no builtin is named {source.builtin!r}; choose from {', '.join(builtins())}."
            )
        return Path(str(files("texsss_assets").joinpath(source.builtin)))
    path = Path(source.path or "")
    if not path.exists():
        raise AssetError(f"Source: expected a file, found none at {path}; check the path.")
    if not path.is_file():
        raise AssetError(f"Source: expected a file, got a folder at {path}; name a file in it.")
    return path


def builtins() -> list[str]:
    """Names of the meshes, maps and scenes that texsss ships."""
    root = Path(str(files("texsss_assets").joinpath("")))
    return sorted(
        p.relative_to(root).as_posix() for p in root.rglob("*") if p.suffix in {".obj", ".png", ".json"}
    )


def digest(source: Source) -> str:
    """A name for the content of a source's file."""
    path = locate(source)
    status = path.stat()
    return _file_digest(str(path), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=256)
def _file_digest(path: str, modified_ns: int, size: int) -> str:
    return blake2b(Path(path).read_bytes(), digest_size=16).hexdigest()


def load_mesh(spec: MeshSpec) -> tuple[Mesh, MeshNotes]:
    """The mesh [mm] of a scene and what had to be assumed about it."""
    return read_mesh(locate(spec.source), unit_mm=spec.unit_mm, up=spec.up)


def load_map(spec: MapSpec) -> Float[Tensor, "H W C"]:
    """A map, linear; its chosen channel alone where one is chosen."""
    return read_image(locate(spec.source), spec.space, spec.channel)


def material_maps(scene: Scene) -> list[str]:
    """Names of the maps that a scene's layers use."""
    return sorted({name for field, name in scene.map_names() if not field.startswith("material.surface")})


def background(scene: Scene) -> tuple:
    """Linear background of the picture: the scene's colour, or a dark studio backdrop from top to bottom."""
    colour = scene.output.background
    return BACKDROP if colour is None else colour


def stack(scene: Scene, images: Images) -> Stack:
    """The layers of a scene's material. Raises DomainError: when a medium's name is unknown."""
    layers = []
    for spec in scene.material.layers:
        if isinstance(spec.medium, Mix):
            first, second = (medium(scene, name, images) for name in spec.medium.mix)
            matter = mix(first, second, _grey(images[spec.medium.mask]))
        else:
            matter = medium(scene, spec.medium, images)
        layers.append(Layer(matter, _value(spec.thickness_mm, images)))
    return Stack(layers)


def medium(scene: Scene, name: str, images: Images) -> Medium:
    """A medium by its name in the scene, or else among the presets."""
    spec = scene.media.get(name)
    if spec is None:
        if scene.media and name not in PRESETS:
            choices = ", ".join([*sorted(scene.media), *sorted(PRESETS)])
            raise DomainError(f"Material: no medium is named {name!r}; choose from {choices}.")
        return preset(name)
    if spec.preset is not None:
        return preset(spec.preset)
    return Medium(
        _value(spec.sigma_a_per_mm, images),
        _value(spec.sigma_s_per_mm, images),
        _value(spec.g, images),
        spec.eta,
    )


def _value(value: Any, images: Images) -> Any:
    """A number as it is, a triple as a tensor, a painted value as its map scaled to its range."""
    if isinstance(value, MapValue):
        image = images[value.map]
        low, high = value.range
        return low + (high - low) * (1 - image if value.invert else image)
    return torch.tensor(value) if isinstance(value, tuple) else value


def _grey(image: Float[Tensor, "H W C"]) -> Float[Tensor, "H W"]:
    return image.mean(-1)


def lights(scene: Scene, mesh: Mesh) -> list[Light]:
    """The emitters of a scene; a studio is placed around the mesh."""
    placed: list[Light] = []
    for spec in scene.lights:
        match spec:
            case PointSpec():
                placed.append(
                    PointLight(torch.tensor(spec.position_mm), torch.tensor(spec.intensity_w_per_sr))
                )
            case DirectionalSpec():
                placed.append(
                    DirectionalLight(torch.tensor(spec.direction), torch.tensor(spec.irradiance_w_per_m2))
                )
            case EnvironmentSpec():
                placed.append(ConstantEnvironment(torch.tensor(spec.radiance)))
            case StudioSpec():
                placed += studio(mesh, spec.intensity)
    return placed


def studio(mesh: Mesh, intensity: float = 1.0) -> list[Light]:
    """Key, rim and fill around a mesh, at distances that scale with it.

    The key gives π W/m² at the centre when it faces it, so that a white diffuse surface shows 1;
    the rim from behind is as strong, and shines through what is thin; the fill is dim and cool.
    """
    centre = (mesh.vertices.amax(0) + mesh.vertices.amin(0)).detach() / 2
    distance = 2.0 * mesh.diagonal_mm
    per_unit = intensity * math.pi * (distance / 1000) ** 2  # W/sr for π W/m² at the centre

    def lamp(direction: list[float], colour: list[float], strength: float) -> PointLight:
        aim = torch.tensor(direction)
        position = centre + aim / torch.linalg.vector_norm(aim) * distance
        return PointLight(position, strength * per_unit * torch.tensor(colour))

    return [
        lamp([0.75, 0.6, 0.9], [1.0, 0.96, 0.9], 1.0),
        lamp([-0.8, 0.5, -0.9], [0.9, 0.95, 1.0], 1.0),
        lamp([-0.8, 0.1, 1.0], [0.85, 0.93, 1.0], 0.12),
    ]


def camera(spec: CameraSpec, mesh: Mesh) -> Camera:
    """The camera of a scene; fitted around the mesh unless placed."""
    fov_y = math.radians(spec.fov_y_deg)
    if spec.fit or spec.position_mm is None or spec.target_mm is None:
        return fit_camera(
            mesh, direction=torch.tensor(spec.direction), fov_y=fov_y, resolution=spec.resolution
        )
    position, target = torch.tensor(spec.position_mm), torch.tensor(spec.target_mm)
    return Camera(position, target, torch.tensor([0.0, 1.0, 0.0]), fov_y, spec.resolution)
