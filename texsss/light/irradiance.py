"""Light that enters the surface at points: every light, with shadows and Fresnel."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch.quasirandom import SobolEngine

from texsss.errors import DomainError
from texsss.light.beneath import BEYOND, DEPTH, FARTHEST, enters_freely
from texsss.light.emitters import Environment, Light, graded
from texsss.light.sites import Sites, dot, sites_at
from texsss.light.sky import open_shares
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.numerics.threads import in_threads
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Bool, Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks

SHARING = 16  # sites that take each other's looks at the surroundings
AREA_SAMPLES = 16
RAYS = 1 << 15  # sites that a thread takes at a time


@dataclass(frozen=True, eq=False)
class Weighing:
    """How light counts by its direction, in the place of its cosine.

    `weight` (R, 3): of irradiance on a plane that faces the light, from the numbers of sites, cosines and the
    directions towards it. `free_mm`: lights without extent count beyond the terminator, too, where they enter
    within some of that; 0 leaves it dark.
    """

    weight: Callable[[Int[Tensor, " R"], Float[Tensor, " R"], Float[Tensor, "R 3"]], Float[Tensor, "R 3"]]
    free_mm: float = 0.0

    def of(self, first: int) -> "Weighing":
        """That of sites numbered from `first`."""
        return replace(self, weight=lambda rows, *beam: self.weight(rows + first, *beam))


def irradiance(
    points: Points,
    mesh: Mesh,
    lights: Sequence[Light],
    *,
    normals: Float[Tensor, "P 3"] | None = None,
    **look: Any,
) -> Float[Tensor, "P 3"]:
    """Irradiance that enters the surface at `points` [W/m²]: `irradiance_at` their sites.

    `normals` (P, 3) take the place of the mesh's shading normals (bump); light from below the horizon
    of the latter stays out. `look`: the options of `irradiance_at`. Differentiable as that, and in vertices.
    """
    return irradiance_at(sites_at(points, mesh, normals), lights, **look)


def irradiance_at(sites: Sites, lights: Sequence[Light], **look: Any) -> Float[Tensor, "P 3"]:
    """Irradiance that enters the surface [W/m²]: Σ L cos F_t(cos, eta) V, the sum of `irradiance_apart`.

    `look`: the options of that. Differentiable and raises as that.
    """
    (total,) = _lit(sites, lights, apart=False, **look)
    return total


def irradiance_apart(sites: Sites, lights: Sequence[Light], **look: Any) -> list[Float[Tensor, "P 3"]]:
    """Irradiance that enters the surface [W/m²] of lights as `grouped`: the first together, all others alone.

    Added up one after the other they are `irradiance_at`, to the last bit. `eta`: inside / outside, 1 unless
    given. `occluder` casts the shadows; without one there are none. Lights that are not points are sampled
    `environment_samples` or `area_samples` times, in an order of their own at every site; the same
    `seed` gives the same numbers. Of environments, each site traces only every `sharing`-th sample and
    takes the share of light that is not hidden from its `sharing` nearest neighbours, too (a blur of
    a few texels; 1 traces all). `by_angle` weighs light by its direction, but that of
    environments, which comes from everywhere. Differentiable in lights and sites, not in visibility,
    nor in an environment's image.
    Raises DomainError: when a number of samples is below 1. Raises Cancelled.
    """
    return _lit(sites, lights, apart=True, **look)


def grouped(lights: Sequence[Light]) -> tuple[list[Light], list[Light], list[Environment]]:
    """Lights without extent, those that have one, and surroundings in parts of about one brightness each."""
    nearby = [light for light in lights if not isinstance(light, Environment)]
    return (
        [light for light in nearby if light.is_delta],
        [light for light in nearby if not light.is_delta],
        [part for light in lights if isinstance(light, Environment) for part in light.parts],
    )


def _lit(
    sites: Sites,
    lights: Sequence[Light],
    *,
    apart: bool,
    eta: float = 1.0,
    occluder: Occluder | None = None,
    environment_samples: int = 64,
    area_samples: int = AREA_SAMPLES,
    sharing: int = SHARING,
    seed: int = 0,
    by_angle: Weighing | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> list[Float[Tensor, "P 3"]]:
    """What `irradiance_apart` says, or its sum alone."""
    if min(environment_samples, area_samples, sharing) < 1:
        raise DomainError(
            f"irradiance: expected at least 1 of environment_samples, area_samples and sharing, got "
            f"{environment_samples}, {area_samples} and {sharing}."
        )
    points, areas, surroundings = grouped(lights)
    rows, ended = chunks(len(sites), RAYS), []

    def lit(row: slice) -> list[Float[Tensor, "rows 3"]]:
        site = sites[row]
        each = [torch.zeros_like(site.position)]
        own = None if by_angle is None else by_angle.of(row.start)
        generator = torch.Generator().manual_seed(seed + row.start)
        middle = [site.position.new_zeros(len(site), 2)]
        for light in points:
            each[0] = each[0] + _sampled(light, site, eta, occluder, middle, own, cancel)
        for number, light in enumerate(areas):
            squares = _squares(area_samples, len(each[0]), seed + number, generator)
            found = _sampled(light, site, eta, occluder, squares, own, cancel)
            each = [*each, found] if apart else [each[0] + found]
        ended.append(row)
        if progress is not None and not surroundings:
            progress("light", len(ended) / len(rows))
        return each

    wanted = sites.position.requires_grad or sites.normal.requires_grad or graded([*points, *areas])
    parts = in_threads(lit, rows, cancel, graded=wanted)
    if parts:
        each = [torch.cat(found) for found in zip(*parts, strict=True)]
    else:
        each = [torch.zeros_like(sites.position) for _ in range(1 + apart * len(areas))]
    if surroundings:
        shares = open_shares(
            sites, surroundings, eta=eta, occluder=occluder, samples=environment_samples,
            sharing=sharing, seed=seed, progress=progress, cancel=cancel,
        )  # fmt: skip
        for light, share in zip(surroundings, shares, strict=True):
            found = light.unoccluded(eta)(sites.normal) * share
            each = [*each, found] if apart else [each[0] + found]
    return each


def _sampled(
    light: Light,
    site: Sites,
    eta: float,
    occluder: Occluder | None,
    squares: Iterable[Tensor],
    by_angle: Weighing | None,
    cancel: Cancel | None,
) -> Float[Tensor, "P 3"]:
    """Entered irradiance of one light, the mean over `squares` (P, 2) in 0..1².

    Only sites that face the light are computed, and traced.
    """
    count = 0
    total = torch.zeros_like(site.position)
    for square in squares:
        check_cancelled(cancel)
        count += 1
        seen = light.sample(site.position, site.normal, square.to(site.position))
        cosine = dot(site.normal, seen.direction)
        free = by_angle.free_mm if by_angle is not None and light.is_delta else 0.0
        rows = (cosine > (BEYOND if free else 0)).nonzero()[:, 0]
        if not len(rows):
            continue
        cosine, direction = cosine[rows], seen.direction[rows]
        share = cosine[:, None] if by_angle is None else by_angle.weight(rows, cosine, direction)
        entering = seen.irradiance[rows] * share * fresnel.transmittance(cosine.clamp_min(0), eta)[:, None]
        hidden = _hidden(occluder, site, rows, direction, seen.distance[rows])
        if free and occluder is not None:
            beyond = ((cosine <= 0) & (entering.detach() > 0).any(-1)).nonzero()[:, 0]
            deep = site.position[rows[beyond]] - DEPTH * free * site.face_normal[rows[beyond]]
            beams = direction[beyond], seen.distance[rows[beyond]]
            hidden[beyond] = ~enters_freely(occluder, deep, *beams, FARTHEST * free)
        total = total.index_add(0, rows, entering * (~hidden)[:, None])
    return total if count == 1 else total / count


def _hidden(
    occluder: Occluder | None,
    site: Sites,
    rows: Int[Tensor, " R"],
    direction: Float[Tensor, "R 3"],
    distance: Float[Tensor, " R"],
) -> Bool[Tensor, " R"]:
    """Whether the light at `direction` [unit] and `distance` [mm] fails to reach these rows of `site`."""
    if occluder is None:
        hidden = torch.zeros(len(rows), dtype=torch.bool, device=rows.device)
    else:
        hidden = occluder.occluded(site.origin[rows], direction, distance, normals=site.face_normal[rows])
    if site.normal is site.smooth:
        return hidden
    return hidden | (dot(site.smooth[rows], direction) <= 0)  # bumps must not lift the horizon


def _squares(count: int, points: int, seed: int, generator: torch.Generator) -> Iterator[Tensor]:
    """`count` samples per point, well spread in the unit square: (P, 2) each.

    One good set for all points, shifted at random from point to point (Cranley & Patterson 1976).
    """
    if count == 1:
        yield torch.rand(points, 2, generator=generator)
        return
    shift = torch.rand(points, 2, generator=generator)
    for common in SobolEngine(2, scramble=True, seed=seed).draw(count):
        yield torch.frac(common + shift)
