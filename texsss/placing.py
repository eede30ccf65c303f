"""Lights, camera and backdrop of a scene, placed in its world [mm]."""

import math
from pathlib import Path

import torch

from texsss.lamps import (
    DirectionalSpec,
    EnvironmentSpec,
    LightSpec,
    PointSpec,
    RectangleSpec,
    SphereSpec,
    SpotSpec,
    StudioSpec,
)
from texsss.light.areas import RectangleLight, SphereLight
from texsss.light.emitters import ConstantEnvironment, DirectionalLight, Light, PointLight, SpotLight
from texsss.light.environment import ImageEnvironment
from texsss.resolve import Images
from texsss.scene import Scene
from texsss.shots import CameraSpec
from texsss.surface.mesh import Mesh
from texsss.view.camera import Camera, fit_camera

BACKDROP = ((0.020, 0.024, 0.030), (0.075, 0.082, 0.092))


def lights(scene: Scene, mesh: Mesh, images: Images) -> list[Light]:
    """The emitters of a scene; a studio is placed around the mesh. `images`: its panoramas by name."""
    return [light for spec in scene.lights for light in _placed(scene, spec, mesh, images)]


def stretched(panoramas: Images) -> list[str]:
    """What to say of panoramas that are not twice as wide as high."""
    sizes = {name: (image.shape[1], image.shape[0]) for name, image in panoramas.items()}
    return [
        f"Panorama {name} is {width} × {height} and was stretched around everything: an equirectangular "
        "one is twice as wide as high; convert cube maps and light probes first."
        for name, (width, height) in sizes.items()
        if abs(width / height - 2) > 0.05
    ]


def environment_samples(scene: Scene) -> int:
    """How often environments are looked at from every texel."""
    return max((spec.samples for spec in scene.lights if isinstance(spec, EnvironmentSpec)), default=1)


def area_samples(scene: Scene) -> int:
    """How often panels and balls are looked at from every texel."""
    return max(
        (spec.samples for spec in scene.lights if isinstance(spec, RectangleSpec | SphereSpec)), default=1
    )


def _placed(scene: Scene, spec: LightSpec, mesh: Mesh, images: Images) -> list[Light]:
    match spec:
        case PointSpec():
            return [PointLight(spec.position_mm, spec.intensity_w_per_sr)]
        case SpotSpec():
            inner, outer = math.radians(spec.inner_deg), math.radians(spec.outer_deg)
            return [SpotLight(spec.position_mm, spec.intensity_w_per_sr, spec.direction, inner, outer)]
        case DirectionalSpec():
            return [DirectionalLight(spec.direction, spec.irradiance_w_per_m2)]
        case RectangleSpec():
            return [RectangleLight(spec.position_mm, spec.width_mm, spec.height_mm, spec.radiance)]
        case SphereSpec():
            return [SphereLight(spec.position_mm, spec.radius_mm, spec.radiance)]
        case EnvironmentSpec(map=None):
            return [ConstantEnvironment(spec.radiance)]
        case EnvironmentSpec():
            image = images[spec.map or ""].expand(-1, -1, 3)
            # a large panorama is not to be held twice for nothing
            tinted = image if set(spec.radiance) == {1.0} else image * image.new_tensor(spec.radiance)
            source = scene.maps[spec.map or ""].source
            file = source.path or source.builtin
            name = f"Panorama {spec.map}" + (f" ({Path(file).name})" if file else "")
            return [ImageEnvironment(tinted, math.radians(spec.rotation_deg), name=name)]
        case StudioSpec():
            return studio(mesh, spec.intensity)


def studio(mesh: Mesh, intensity: float = 1.0) -> list[Light]:
    """Key, rim and fill around a mesh, at distances that scale with it.

    The key gives π W/m² at the centre when it faces it, so that a white diffuse surface shows 1;
    the rim from behind is half as strong; the fill, from below on the other side, is dim and cool.
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
        lamp([-0.8, 0.5, -0.9], [0.9, 0.95, 1.0], 0.5),
        lamp([-0.8, -0.3, 1.0], [0.85, 0.93, 1.0], 0.15),
    ]


def camera(spec: CameraSpec, mesh: Mesh) -> Camera:
    """The camera of a scene; fitted around the mesh unless placed."""
    fov_y = math.radians(spec.fov_y_deg)
    if spec.fit or spec.position_mm is None or spec.target_mm is None:
        return fit_camera(mesh, direction=spec.direction, fov_y=fov_y, resolution=spec.resolution)
    return Camera(spec.position_mm, spec.target_mm, fov_y=fov_y, resolution=spec.resolution)


def background(scene: Scene) -> tuple:
    """Linear background of the picture: the scene's colour, or a dark studio backdrop from top to bottom."""
    colour = scene.output.background
    return BACKDROP if colour is None else colour
