"""From a scene to tensors: files found and read, names looked up, layers stacked."""

from collections.abc import Callable
from functools import cache, lru_cache
from hashlib import blake2b
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import torch

from texsss.errors import AssetError, DomainError, ShapeError
from texsss.io.files import read_bytes
from texsss.io.images import MAX_PIXELS, read_image
from texsss.io.meshes import MeshNotes, read_mesh, read_positions
from texsss.io.sandbox import Sandbox
from texsss.material import DepthsSpec, MapValue, Mix
from texsss.media.depths import stack_from_depths
from texsss.media.medium import Medium, mix
from texsss.media.presets import PRESETS, preset
from texsss.media.stack import Layer, Stack
from texsss.numerics.sampling import resized
from texsss.scene import Scene
from texsss.specs import MapSpec, MeshSpec, Source
from texsss.surface.mesh import Mesh
from texsss.surface.topology import edges
from texsss.types import Float, Int, Tensor

LEAST_JOINED = (
    0.5  # of the edges of a pose's file that its mesh has, too: quads may be cut otherwise, 2 of 3 stay
)

Images = dict[str, Float[Tensor, "_ _ _"]]
"""Maps by their name in the scene, (H, W, C) of any size, linear."""

Assets = Callable[[str], Path]
"""The file of an uploaded asset by its sha256. Raises AssetError: when it isn't there."""


def locate(source: Source, assets: Assets | None = None) -> Path:
    """The file that a source names. Raises AssetError: when there is none."""
    if source.asset is not None:
        if assets is not None:
            return assets(source.asset)
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
    try:
        if not path.exists():
            raise AssetError(f"Source: expected a file, found none at {path}; check the path.")
        if not path.is_file():
            what = "a folder" if path.is_dir() else "something else"
            raise AssetError(f"Source: expected a file, got {what} at {path}; name a file.")
    except OSError as error:
        raise unreadable(path, error) from None
    return path


def unreadable(path: Path, error: OSError) -> AssetError:
    """The one sentence for a file that the system will not give."""
    return AssetError(f"Source: {path} cannot be read ({error.strerror or error}); check the path.")


@cache
def builtins() -> list[str]:
    """Names of the meshes, maps and scenes that texsss ships."""
    root = Path(str(files("texsss_assets").joinpath("")))
    return sorted(
        p.relative_to(root).as_posix() for p in root.rglob("*") if p.suffix in {".obj", ".png", ".json"}
    )


def digest(source: Source, assets: Assets | None = None) -> str:
    """A name for the content of a source's file."""
    path = locate(source, assets)
    if source.asset is not None:
        return source.asset  # which is named by its content
    try:
        status = path.stat()
        return _file_digest(str(path), status.st_mtime_ns, status.st_ctime_ns, status.st_size)
    except OSError as error:
        raise unreadable(path, error) from None


@lru_cache(maxsize=256)
def _file_digest(path: str, modified_ns: int, changed_ns: int, size: int) -> str:
    return blake2b(Path(path).read_bytes(), digest_size=16).hexdigest()


def load_mesh(
    spec: MeshSpec, assets: Assets | None = None, sandbox: Sandbox | None = None
) -> tuple[Mesh, MeshNotes]:
    """The mesh [mm] of a scene and what had to be assumed about it."""
    read = read_mesh if sandbox is None else sandbox.read_mesh
    return read(locate(spec.source, assets), unit_mm=spec.unit_mm, up=spec.up, v=spec.v)


def load_joined(
    spec: MeshSpec, assets: Assets | None = None, sandbox: Sandbox | None = None
) -> Int[Tensor, " E"]:
    """Pairs of vertices that the triangles of the mesh's file join, as it numbers them; see `_joined`."""
    read = read_positions if sandbox is None else sandbox.read_positions
    return _joined(*read(locate(spec.source, assets), unit_mm=1.0))


def load_pose(
    spec: MeshSpec,
    mesh: Mesh,
    notes: MeshNotes,
    joined: Int[Tensor, " E"],
    assets: Assets | None = None,
    sandbox: Sandbox | None = None,
) -> Float[Tensor, "V 3"]:
    """Where the vertices of the mesh's file stand in the scene's pose [mm].

    `joined`: what that file joins, from `load_joined`. Raises AssetError: when the pose's file is not of the
    same mesh.
    """
    assert spec.pose is not None
    path = locate(spec.pose.source, assets)
    read = read_positions if sandbox is None else sandbox.read_positions
    positions, faces = read(path, unit_mm=notes.unit_mm, up=spec.up)
    wanted = notes.vertices_in_file, notes.faces + notes.faces_dropped
    if (len(positions), len(faces)) != wanted:
        raise AssetError(
            f"Pose: expected the {wanted[0]:,} vertices and {wanted[1]:,} triangles of {mesh.name}, got "
            f"{len(positions):,} and {len(faces):,} in {path.name}; export both alike, in one order."
        )
    pairs = _joined(positions, faces)
    alike = int(torch.isin(pairs, joined).sum())
    if alike < LEAST_JOINED * len(pairs):
        raise AssetError(
            f"Pose: expected the triangles of {mesh.name}, got others in {path.name}, which share "
            f"{alike:,} of {len(pairs):,} edges with them; export both alike, in one order."
        )
    return torch.from_numpy(positions + notes.shift_mm)


def _joined(positions: np.ndarray, faces: np.ndarray) -> Int[Tensor, " E"]:
    """A number for each pair of vertices that an edge joins, in ascending order."""
    both = edges(torch.from_numpy(np.asarray(faces, np.int64))).reshape(-1, 2)
    return torch.unique(both.amin(-1) * len(positions) + both.amax(-1))


def load_map(
    spec: MapSpec, assets: Assets | None = None, sandbox: Sandbox | None = None
) -> Float[Tensor, "H W C"]:
    """A map, linear; its chosen channel alone where one is chosen."""
    path = locate(spec.source, assets)
    if sandbox is None:
        return read_image(path, spec.space, spec.channel)
    data = read_bytes(path)
    sandbox.examine_image(data, name=str(path), max_pixels=MAX_PIXELS)
    return read_image(data, spec.space, spec.channel, name=str(path))  # the bytes that were examined


def material_maps(scene: Scene) -> list[str]:
    """Names of the maps that a scene's layers use."""
    return sorted(
        {
            name
            for field, name in scene.map_names()
            if field.startswith(("material.layers", "material.depths", "media"))
        }
    )


def stack(scene: Scene, images: Images) -> Stack:
    """The layers of a scene's material.

    Raises DomainError: when a medium's name is unknown, or depths decrease. Raises ShapeError: when depth
    textures differ in size, or layers and their channels in number.
    """
    matters = []
    for spec in scene.material.layers:
        if isinstance(spec.medium, Mix):
            alike = _of_one_size(spec.medium, scene, images)
            first, second = (medium(scene, name, alike) for name in spec.medium.mix)
            matter = mix(first, second, _grey(alike[spec.medium.mask]))
        else:
            matter = medium(scene, spec.medium, images)
        matters.append(matter)
    depths = scene.material.depths
    if depths is not None:
        return _stack_of(depths, matters, images)
    thicknesses = [_value(spec.thickness_mm, images) for spec in scene.material.layers]
    return Stack([Layer(matter, d) for matter, d in zip(matters, thicknesses, strict=True)])


def _stack_of(depths: DepthsSpec, media: list[Medium], images: Images) -> Stack:
    """The layers that depth textures draw."""
    textures = [_opaque_dropped(images[name]) for name in depths.maps]
    channels = sum(texture.shape[-1] for texture in textures)
    if len(media) - channels not in (0, 1):
        named = ", ".join(depths.maps)
        raise ShapeError(
            f"Material: expected {channels} layers for the {channels} channels of {named}, or one more "
            f"without end, got {len(media)}; add or drop layers, or read other channels "
            "(rgba has four, where there is an alpha, rgb three)."
        )
    return stack_from_depths(
        textures,
        media,
        depths.range_mm,
        invert=depths.invert,
        infinite=len(media) > channels,
        sort=depths.sort,
        names=[f"{name} {c}" for name, t in zip(depths.maps, textures) for c in _letters(t.shape[-1])],
    )


def _letters(channels: int) -> str:
    return "rgba"[:channels] if channels > 1 else "·"


def _opaque_dropped(image: Float[Tensor, "H W C"]) -> Float[Tensor, "H W D"]:
    """The image without an alpha that says nothing."""
    return image[..., :3] if image.shape[-1] == 4 and bool((image[..., 3] == 1).all()) else image


def media_names(scene: Scene) -> list[str]:
    """Names of the media that a scene's layers use."""
    used = [spec.medium for spec in scene.material.layers]
    return sorted({n for m in used for n in (m.mix if isinstance(m, Mix) else (m,))})


def _of_one_size(spec: Mix, scene: Scene, images: Images) -> Images:
    """The mask of a mixture and the maps of its media, all as large as the largest."""
    media = [f"media.{name}." for name in spec.mix]
    used = {name for field, name in scene.map_names() if field.startswith(tuple(media))} | {spec.mask}
    height, width = (max(images[name].shape[axis] for name in used) for axis in (0, 1))
    return {name: resized(images[name], height, width) for name in used}


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
    sigma_a, sigma_s, g = (_value(x, images) for x in (spec.sigma_a_per_mm, spec.sigma_s_per_mm, spec.g))
    try:
        return Medium(sigma_a, sigma_s, g, spec.eta)
    except (DomainError, ShapeError) as error:
        raise type(error)(f"media.{name}: {error}") from None


def _value(value: Any, images: Images) -> Any:
    """A number as it is, a triple as a tensor, a painted value as its map scaled to its range."""
    if isinstance(value, MapValue):
        image = images[value.map]
        assert value.range is not None  # the scene checked
        low, high = value.range
        return low + (high - low) * (1 - image if value.invert else image)
    return torch.tensor(value) if isinstance(value, tuple) else value


def _grey(image: Float[Tensor, "H W C"]) -> Float[Tensor, "H W"]:
    return image.mean(-1)
