"""A whole picture: rays, shading, edges refined, background."""

import math
from collections.abc import Callable

import torch

from texsss.errors import DomainError
from texsss.light.visibility import Occluder
from texsss.types import Bool, Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks
from texsss.view.camera import Camera, Hits, pixel_centres, primary_hits

CHUNK = 1 << 16  # rays at a time
CONTRAST = 0.04  # of compressed brightness, 0..1, between neighbours: more is an edge

Colour = tuple[float, float, float]


def picture(
    camera: Camera,
    occluder: Occluder,
    shader: Callable[[Hits], Tensor],
    *,
    samples: int = 16,
    background: Colour | tuple[Colour, Colour] = (0.0, 0.0, 0.0),
    seed: int = 0,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "h w 4"]:
    """Linear radiance over the background, and coverage 0..1 as the fourth channel.

    `shader` gives the radiance (P, 3) of hits. Every pixel is looked at once; where neighbours differ
    (outlines, shadow edges, highlights), `samples` stratified rays take its place. Their mean weighs
    bright ones down, 1 / (1 + brightness / mean), lest a single highlight leave a jagged white edge.
    `background`: a linear colour, or two: top and bottom.
    Raises DomainError: when samples is below 1. Raises Cancelled.
    """
    if samples < 1:
        raise DomainError(f"picture: expected at least 1 sample per pixel, got {samples}.")
    width, height = camera.resolution
    count = width * height
    colour, cover = torch.zeros(count, 3), torch.zeros(count)
    everywhere = torch.arange(count)
    centres = pixel_centres(camera)
    for k, rows in enumerate(all_rows := chunks(count, CHUNK)):
        check_cancelled(cancel)
        hits = primary_hits(camera, occluder, centres[rows], everywhere[rows], torch.float32)
        if len(hits.pixel):
            colour[hits.pixel] = shader(hits).detach().float()
            cover[hits.pixel] = 1.0
        if progress is not None:
            progress("view", 0.6 * (k + 1) / len(all_rows))
    key = float((colour.mean(-1).sum() / cover.sum().clamp_min(1)).clamp_min(1e-30))
    if samples > 1:
        edges = _edges(colour, cover, key, (height, width)).nonzero()[:, 0]
        _refine(camera, occluder, shader, edges, samples, seed, key, colour, cover, progress, cancel)
    behind = _background(background, height, width)
    seen = cover[:, None] * colour + (1 - cover[:, None]) * behind
    return torch.cat([seen, cover[:, None]], -1).reshape(height, width, 4)


def _edges(
    colour: Float[Tensor, "N 3"], cover: Float[Tensor, " N"], key: float, size: tuple[int, int]
) -> Bool[Tensor, " N"]:
    """Pixels that differ visibly from a neighbour."""
    compressed = torch.sqrt(colour / (colour + key)).clamp(0, 1)
    layers = torch.cat([compressed, cover[:, None]], -1).reshape(1, *size, 4).permute(0, 3, 1, 2)
    high = torch.nn.functional.max_pool2d(layers, 3, 1, 1)
    low = -torch.nn.functional.max_pool2d(-layers, 3, 1, 1)
    return (high - low).amax(1).reshape(-1) > CONTRAST


def _refine(
    camera: Camera,
    occluder: Occluder,
    shader: Callable[[Hits], Tensor],
    pixels: Int[Tensor, " E"],
    samples: int,
    seed: int,
    key: float,
    colour: Float[Tensor, "N 3"],
    cover: Float[Tensor, " N"],
    progress: Progress | None,
    cancel: Cancel | None,
) -> None:
    """Replaces `pixels` of colour and cover by the mean of stratified samples."""
    generator = torch.Generator().manual_seed(seed)
    side = math.ceil(math.sqrt(samples))
    corner = torch.stack([pixels % camera.resolution[0], pixels // camera.resolution[0]], -1).double()
    weighted, weights, hit = torch.zeros(len(pixels), 3), torch.zeros(len(pixels)), torch.zeros(len(pixels))
    slot = torch.arange(len(pixels))
    for k in range(side * side):
        check_cancelled(cancel)
        cell = torch.tensor([k % side, k // side], dtype=torch.float64)
        jitter = torch.rand(len(pixels), 2, generator=generator, dtype=torch.float64)
        xy = corner + (cell + jitter) / side
        for rows in chunks(len(pixels), CHUNK):
            hits = primary_hits(camera, occluder, xy[rows], slot[rows], torch.float32)
            if not len(hits.pixel):
                continue
            radiance = shader(hits).detach().float()
            weight = 1 / (1 + radiance.mean(-1) / key)
            weighted.index_add_(0, hits.pixel, radiance * weight[:, None])
            weights.index_add_(0, hits.pixel, weight)
            hit.index_add_(0, hits.pixel, torch.ones_like(weight))
        if progress is not None:
            progress("view", 0.6 + 0.4 * (k + 1) / side**2)
    colour[pixels] = weighted / weights.clamp_min(1e-30)[:, None]
    cover[pixels] = hit / side**2


def _background(colours: Colour | tuple[Colour, Colour], height: int, width: int) -> Float[Tensor, "N 3"]:
    """Linear background of every pixel, row-major."""
    pair = torch.tensor(colours, dtype=torch.float32).reshape(-1, 3)
    share = ((torch.arange(height) + 0.5) / height)[:, None]
    rows = torch.lerp(pair[0], pair[-1], share)
    return rows.repeat_interleave(width, 0)
