"""Depth textures as files: baked from nested meshes or taken from a stack, read by `material.depths`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from texsss.errors import DomainError, ShapeError
from texsss.io.exr import write_exr
from texsss.io.images import write_png
from texsss.io.meshes import Up, read_mesh
from texsss.media.depths import boundaries, check_real, in_order, scaled
from texsss.media.medium import Medium, expect
from texsss.media.stack import Layer, Stack
from texsss.surface.atlas import make_atlas
from texsss.surface.raster import rasterise
from texsss.transport.depth_bake import depths_from_meshes
from texsss.types import Cancel, Float, Progress, Tensor

READ = {1: ("r",), 2: ("r", "g"), 3: ("rgb",), 4: ("rgba",)}  # how a scene reads so many channels


def bake_depths(
    mesh: str | Path,
    layers: Sequence[str | Path],
    *,
    unit_mm: float | int | None = None,
    up: Up = "y",
    size: int | tuple[int, int] = 1024,
    greatest_mm: float | int | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "H W L"]:
    """Depth [mm] of every layer's lower boundary beneath the surface of `mesh`, over its texture coordinates.

    `layers`: files of closed meshes within each other, from the outermost; in the unit of `mesh`, which is
    as `read_mesh` says unless stated. Rays go along the inward normal; a boundary that they miss is as deep
    as the object. `greatest_mm` caps all. What no face covers has the depth of the nearest place. Where
    texture coordinates overlap, the first face is looked from.
    Raises AssetError: for files that are no meshes; DomainError: without texture coordinates of use;
    ShapeError: without layers; Cancelled.
    """
    outer, notes = read_mesh(mesh, unit_mm=unit_mm, up=up)
    if outer.source_uv is None:
        raise DomainError(
            f"bake_depths: expected texture coordinates, but {outer.name} has none; unwrap it first, as "
            "depth textures are laid on by them."
        )
    inner = [read_mesh(layer, unit_mm=notes.unit_mm, up=up)[0] for layer in layers]
    shape = (size, size) if isinstance(size, int) else size
    texels = rasterise(outer, make_atlas(outer, "source", size=shape, cancel=cancel).uv, shape, cancel=cancel)
    cap = None if greatest_mm is None else float(greatest_mm)
    depth = depths_from_meshes(texels.points, outer, inner, greatest_mm=cap, progress=progress, cancel=cancel)
    image = texels.to_image(depth)
    return image.flatten(0, 1)[texels.nearest.flatten()].reshape(image.shape)


def save_depths(
    path: str | Path,
    layers: Stack | Layer | Medium | Tensor,
    range_mm: tuple[float | int, float | int] | None = None,
    *,
    invert: bool = False,
) -> dict[str, Any]:
    """Writes depth textures, .png (16 bits) or .exr, and tells how a scene reads them.

    `layers`: a stack or layer, or depths of lower boundaries (H, W, L) [mm], as `bake_depths` gives them.
    `range_mm`: what black and white mean, exchanged by `invert`; 0 to the deepest unless told; beyond it
    depths are clamped. Four layers share a file; further files are named path-1, path-2 …
    What comes back is {"maps": …, "depths": …}, for a scene's `maps` and `material.depths`.
    Raises DomainError: for another kind of file, a range that is none, and depths that are negative, not
    finite, or decrease from layer to layer; ShapeError: without a finite layer.
    """
    path = Path(path)
    if path.suffix.lower() not in (".png", ".exr"):
        raise DomainError(f"save_depths: expected a .png or .exr, got {path.name!r}; depths need the bits.")
    expect("save_depths", layers, (Stack, Layer, Medium, Tensor), "a stack, or depths (H, W, L) as a tensor")
    layers = Stack(layers) if isinstance(layers, Layer | Medium) else layers
    depth = boundaries(layers) if isinstance(layers, Stack) else layers
    if depth.ndim != 3 or 0 in depth.shape:
        raise ShapeError(f"save_depths: expected depths (H, W, L) [mm], got shape {tuple(depth.shape)}.")
    check_real(depth)
    least, most = (float(x) for x in depth.detach().aminmax())
    if not (least >= 0 and most < float("inf")):
        raise DomainError(
            f"save_depths: expected finite depths >= 0 [mm], got {least:g}..{most:g}; they count downwards."
        )
    depth = in_order(depth.detach(), remedy="sort them by depths.sort(-1).values")
    span = range_mm or (0.0, most or 1.0)
    maps: dict[str, Any] = {}
    for k, values in enumerate(scaled(depth, span, invert).split(4, -1)):
        file = path.with_stem(f"{path.stem}-{k}") if k else path
        count = values.shape[-1]
        padded = values if count != 2 else torch.cat([values, values[..., -1:]], -1)
        if path.suffix.lower() == ".png":
            write_png(file, padded, bits=16)
        else:
            write_exr(file, padded)
        # an alpha of 1 everywhere would be taken for none
        opaque = count == 4 and bool((values[..., 3] > 1 - 2**-16).all())
        for channel in ("rgb", "a") if opaque else READ[count]:
            maps[f"{file.stem}-{channel}"] = {"source": {"path": str(file.absolute())}, "channel": channel}
    low, high = span
    return {"maps": maps, "depths": {"maps": [*maps], "range_mm": [low, high], "invert": invert}}
