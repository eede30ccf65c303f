"""A whole picture: rays, shading, edges refined, background."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import torch

from texsss.errors import DomainError
from texsss.light.visibility import Occluder
from texsss.numerics.threads import in_threads
from texsss.types import Bool, Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks
from texsss.view.camera import SEEDS_APART, Camera, Hits, pixel_centres, primary_hits

CHUNK = 1 << 15  # rays at a time
AT_ONCE = 8  # chunks between words of progress
TILE = 64  # pixels after which the places of rays repeat
CONTRAST = 0.04  # of compressed brightness, 0..1, between neighbours: more is an edge

Colour = tuple[float, float, float]
T = TypeVar("T")


def picture(
    camera: Camera,
    occluder: Occluder,
    shader: Callable[[Hits], Tensor],
    *,
    samples: int = 16,
    background: Colour | tuple[Colour, Colour] = (0.0, 0.0, 0.0),
    seed: int = 0,
    centres: Iterable[tuple[Int[Tensor, " P"], Float[Tensor, "P 3"]]] | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "h w 4"]:
    """Linear radiance over the background, and coverage 0..1 as the fourth channel.

    `shader` gives the radiance (P, 3) of hits, in several threads at once. Every pixel is looked at once;
    where neighbours differ (outlines, shadow edges, highlights), stratified rays take its place: a few, and
    all `samples` where those differ, too, rounded up to a square. Their mean, background included, weighs
    bright ones down, 1 / (1 + brightness / mean), lest a single highlight or a bright rim leave a jagged
    white edge.
    `background`: a linear colour, or two: top and bottom. `centres`: pixels and the radiance at their
    `centre_hits`, in parts, where it is known already. Without gradients.
    Raises DomainError: when samples is below 1. Raises Cancelled.
    """
    if samples < 1:
        raise DomainError(f"picture: expected at least 1 sample per pixel, got {samples}.")
    width, height = camera.resolution
    count = width * height
    behind = _background(background, height, width)
    colour, cover = behind.clone(), torch.zeros(count)
    if centres is None:
        centres = at_centres(camera, occluder, lambda hits: (hits.pixel, shader(hits)), cancel)
    for pixel, radiance in centres:
        check_cancelled(cancel)
        colour[pixel] = radiance.detach().float()
        cover[pixel] = 1.0
        if progress is not None:
            progress("view", 0.6 * float(pixel[-1] + 1) / count)
    if samples > 1:
        shown = (colour.mean(-1) * cover).sum() / cover.sum().clamp_min(1)
        # a background that outshines the object weighs as much at its outline
        key = float(torch.maximum(shown, colour.mean()).clamp_min(1e-30))
        film = _Film(key, colour, cover)
        edges = film.edges((height, width)).nonzero()[:, 0]
        _refine(camera, occluder, shader, edges, samples, seed, behind, film, progress, cancel)
    return torch.cat([colour, cover[:, None]], -1).reshape(height, width, 4)


def at_centres(
    camera: Camera, occluder: Occluder, look: Callable[[Hits], T], cancel: Cancel | None = None
) -> Iterator[T]:
    """`look` at what the rays through the centres of all pixels hit, some thousands at a time, in threads.

    In parts from the top of the picture down; without gradients. Raises Cancelled.
    """
    width, height = camera.resolution
    everywhere, centres = torch.arange(width * height), pixel_centres(camera)

    def seen(rows: slice) -> T | None:
        hits = primary_hits(camera, occluder, centres[rows], everywhere[rows], torch.float32)
        return look(hits) if len(hits.pixel) else None

    rows = chunks(width * height, CHUNK)
    for first in range(0, len(rows), AT_ONCE):
        group = in_threads(seen, rows[first : first + AT_ONCE], cancel)
        yield from (found for found in group if found is not None)


@dataclass(frozen=True, eq=False)
class _Film:
    """What the picture holds so far. `key`: mean brightness, to which others compare."""

    key: float
    colour: Float[Tensor, "N 3"]
    cover: Float[Tensor, " N"]

    def compressed(self, colour: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """Brightness as an eye compares it, 0..1; sums of signed Gaussians may fall a little below black."""
        light = colour.clamp_min(0)
        return torch.sqrt(light / (light + self.key))

    def edges(self, size: tuple[int, int]) -> Bool[Tensor, " N"]:
        """Pixels that differ visibly from a neighbour."""
        layers = torch.cat([self.compressed(self.colour), self.cover[:, None]], -1).reshape(*size, 4)
        high, low = layers, layers
        for axis in (0, 1):
            high, low = _extreme(high, axis, torch.maximum), _extreme(low, axis, torch.minimum)
        return (high - low).amax(-1).reshape(-1) > CONTRAST


def _extreme(image: Float[Tensor, "h w C"], axis: int, of: Callable[..., Tensor]) -> Float[Tensor, "h w C"]:
    """The largest or smallest of every pixel and its two neighbours along `axis`."""
    result, length = image.clone(), image.shape[axis]
    for shift in (-1, 1):
        here, there = (
            result.narrow(axis, max(shift, 0), length - 1),
            image.narrow(axis, max(-shift, 0), length - 1),
        )
        here.copy_(of(here, there))
    return result


def _refine(
    camera: Camera,
    occluder: Occluder,
    shader: Callable[[Hits], Tensor],
    pixels: Int[Tensor, " E"],
    samples: int,
    seed: int,
    behind: Float[Tensor, "N 3"],
    film: _Film,
    progress: Progress | None,
    cancel: Cancel | None,
) -> None:
    """Replaces `pixels` of the film by the mean of stratified samples."""
    side = math.ceil(math.sqrt(samples))
    # the first `side` strata have a row and a column each to themselves: enough to tell a flat pixel
    few = [(k, (2 * k + 1) % (side + 1 - side % 2)) for k in range(side)]
    cells = few + [cell for cell in itertools.product(range(side), repeat=2) if cell not in few]
    weighted, weights, hit = torch.zeros(len(pixels), 3), torch.zeros(len(pixels)), torch.zeros(len(pixels))
    low, high = torch.full((len(pixels),), torch.inf), torch.full((len(pixels),), -torch.inf)

    def look(sample: int, slot: Int[Tensor, " S"]) -> tuple[Float[Tensor, "S 3"], Float[Tensor, " S"]]:
        """Radiance and coverage along a ray through the stratum `sample` of each of these pixels."""
        pixel = pixels[slot]
        corner = torch.stack([pixel % camera.resolution[0], pixel // camera.resolution[0]], -1)
        # by its place: what is refined elsewhere moves no ray, so that still parts of a film are still
        generator = torch.Generator().manual_seed(seed + SEEDS_APART * sample)
        tile = torch.rand(TILE * TILE, 2, generator=generator, dtype=torch.float64)
        jitter = tile[corner[:, 1] % TILE * TILE + corner[:, 0] % TILE]
        xy = corner.double() + (torch.tensor(cells[sample], dtype=torch.float64) + jitter) / side
        hits = primary_hits(camera, occluder, xy, torch.arange(len(pixel)), torch.float32, sample=sample + 1)
        radiance, covered = behind[pixel], torch.zeros(len(pixel))
        if len(hits.pixel):
            radiance[hits.pixel] = shader(hits).float()
            covered[hits.pixel] = 1.0
        return radiance, covered

    slots = torch.arange(len(pixels))
    for first in range(0, len(cells), side):
        if first == len(few):
            slots = (high - low > CONTRAST).nonzero()[:, 0]
        strata = range(first, min(first + side, len(cells)))
        parts = [(sample, slots[part]) for sample in strata for part in chunks(len(slots), CHUNK)]
        few_rays = len(slots) * len(strata) <= CHUNK
        seen = in_threads(lambda part: look(*part), parts, cancel, alone=few_rays)
        for (_, slot), (radiance, covered) in zip(parts, seen, strict=True):
            weight = 1 / (1 + radiance.mean(-1) / film.key)
            weighted[slot] += radiance * weight[:, None]
            weights[slot] += weight
            hit[slot] += covered
            # outlines count however dark, before a background however bright: coverage tells them
            brightness = film.compressed(radiance).mean(-1) + 2 * covered
            low[slot] = torch.minimum(low[slot], brightness)
            high[slot] = torch.maximum(high[slot], brightness)
        if progress is not None:
            progress("view", 0.6 + 0.4 * (strata[-1] + 1) / len(cells))
    film.colour[pixels] = weighted / weights[:, None]
    counts = torch.full((len(pixels),), float(len(few)))
    counts[slots] = float(len(cells))
    film.cover[pixels] = hit / counts


def _background(colours: Colour | tuple[Colour, Colour], height: int, width: int) -> Float[Tensor, "N 3"]:
    """Linear background of every pixel, row-major."""
    pair = torch.tensor(colours, dtype=torch.float32).reshape(-1, 3)
    share = ((torch.arange(height) + 0.5) / height)[:, None]
    rows = torch.lerp(pair[0], pair[-1], share)
    return rows.repeat_interleave(width, 0)
