"""Light that enters the surface at points: every light, with shadows and Fresnel."""

from collections.abc import Iterable, Iterator

import torch
from torch.quasirandom import SobolEngine

from texsss.errors import DomainError
from texsss.light.emitters import Environment, Light
from texsss.light.smoothing import neighbours_mean
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Bool, Cancel, Float, Progress, Tensor, check_cancelled, chunks, unit

CHUNK = 1 << 15  # points at a time: what the cache of a core holds


def irradiance(
    points: Points,
    mesh: Mesh,
    lights: list[Light] | tuple[Light, ...],
    *,
    eta: float = 1.0,
    occluder: Occluder | None = None,
    normals: Float[Tensor, "P 3"] | None = None,
    environment_samples: int = 64,
    area_samples: int = 16,
    sharing: int = 16,
    seed: int = 0,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "P 3"]:
    """Irradiance that enters the surface at `points` [W/m²]: Σ L cos F_t(cos, eta) V.

    `occluder` casts the shadows; without one there are none. `normals` (P, 3) take the place of the
    mesh's shading normals (bump); light from below the horizon of the latter stays out. Gutter
    points see what the nearest point of their face sees. Lights that are not points are sampled
    `environment_samples` or `area_samples` times, in an order of their own at every point; the same
    seed gives the same numbers. Of environments, each point traces only every `sharing`-th sample and
    takes the share of light that is not hidden from its `sharing` nearest neighbours, too (a blur of
    a few texels; 1 traces all). Differentiable in lights, vertices and `normals`, not in visibility,
    nor in an environment's image.
    Raises DomainError: when a number of samples is below 1. Raises Cancelled.
    """
    if min(environment_samples, area_samples, sharing) < 1:
        raise DomainError(
            f"irradiance: expected at least 1 of environment_samples, area_samples and sharing, got "
            f"{environment_samples}, {area_samples} and {sharing}."
        )
    generator = torch.Generator().manual_seed(seed)
    surroundings = [light for light in lights if isinstance(light, Environment)]
    nearby = [light for light in lights if not isinstance(light, Environment)]
    traced = -(-environment_samples // sharing)
    parts, shares = [], []  # light of the others; of each environment, with and without shadows
    rows = chunks(len(points), CHUNK)
    for k, row in enumerate(rows):
        site = _Site(points[row], mesh, None if normals is None else normals[row])
        total = torch.zeros_like(site.position)
        for number, light in enumerate(nearby):
            if light.is_delta:
                squares = [total.new_zeros(len(total), 2)]
            else:
                squares = _squares(area_samples, len(total), seed + number, generator)
            total = total + _sampled(light, site, eta, occluder, squares, cancel)[0]
        parts.append(total)
        free = [total.new_zeros(len(total), 0)]
        for number, light in enumerate(surroundings):
            squares = _squares(traced, len(total), seed + number, generator)
            seen, whole = _sampled(light, site, eta, occluder, squares, cancel)
            free += [seen, whole]
        shares.append(torch.cat(free, 1))
        if progress is not None:
            progress("light", (k + 1) / len(rows))
    if not parts:
        return mesh.vertices.new_zeros(0, 3)
    total = torch.cat(parts)
    if surroundings:
        normal = points.normal(mesh) if normals is None else normals
        free = torch.cat(shares)
        if sharing > 1 and occluder is not None:
            free = neighbours_mean(points.position(mesh), points.normal(mesh), free, sharing)
        for number, light in enumerate(surroundings):
            seen, whole = free[:, 6 * number : 6 * number + 3], free[:, 6 * number + 3 : 6 * number + 6]
            # both are the same samples: where nothing is hidden their ratio is exactly 1
            share = torch.where(whole > 0, seen / torch.where(whole > 0, whole, 1.0), 1.0)
            total = total + light.unoccluded(eta)(normal) * share
    return total


class _Site:
    """What a chunk of points needs to know about its place."""

    def __init__(self, points: Points, mesh: Mesh, normals: Float[Tensor, "P 3"] | None):
        face, bary = points.face.long(), points.bary.to(mesh.vertices.dtype)
        corners, corner_normals = mesh.corners[face], mesh.corner_normals[face]
        self.position = _blend(bary, corners)
        self.smooth = unit(_blend(bary, corner_normals))
        self.normal = self.smooth if normals is None else normals
        self.bumped = normals is not None
        self.face_normal = mesh.face_normals[face].detach()
        self.origin = _lifted(bary.detach(), corners.detach(), corner_normals.detach())


def smooth_origin(points: Points, mesh: Mesh) -> Float[Tensor, "P 3"]:
    """Where shadow rays start: the points, lifted onto the curved surface that the normals imply [mm].

    A flat face lies below that surface where it is convex, and its neighbours would shadow it in
    steps along the terminator. Each corner's tangent plane lifts the point by its distance below it;
    the lifts are blended by the barycentrics. Concave parts stay. Gutter points go to the nearest
    point of their face first. Without gradients. Source: Hanika 2021 (Ray Tracing Gems II, ch. 4).
    """
    face, bary = points.face.long(), points.bary.detach().to(mesh.vertices.dtype)
    return _lifted(bary, mesh.corners.detach()[face], mesh.corner_normals.detach()[face])


def _lifted(
    bary: Float[Tensor, "P 3"], corners: Float[Tensor, "P 3 3"], normals: Float[Tensor, "P 3 3"]
) -> Float[Tensor, "P 3"]:
    """See `smooth_origin`."""
    inside = bary.clamp_min(0)
    inside = inside / inside.sum(-1, keepdim=True)
    position = _blend(inside, corners)
    origin = position
    for k in range(3):
        below = _dot(position - corners[:, k], normals[:, k]).clamp_max(0)
        origin = origin - (inside[:, k] * below)[:, None] * normals[:, k]
    return origin


def _blend(bary: Float[Tensor, "P 3"], corners: Float[Tensor, "P 3 3"]) -> Float[Tensor, "P 3"]:
    """Σ bary × corner, written out: four times as fast as einsum on matrices this small."""
    return bary[:, :1] * corners[:, 0] + bary[:, 1:2] * corners[:, 1] + bary[:, 2:] * corners[:, 2]


def _dot(a: Float[Tensor, "P 3"], b: Float[Tensor, "P 3"]) -> Float[Tensor, " P"]:
    """Scalar products, written out for the same reason."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _sampled(
    light: Light,
    site: _Site,
    eta: float,
    occluder: Occluder | None,
    squares: Iterable[Tensor],
    cancel: Cancel | None,
) -> tuple[Float[Tensor, "P 3"], Float[Tensor, "P 3"]]:
    """Entered irradiance of one light with and without shadows, means over `squares` (P, 2) in 0..1²."""
    count = 0
    total, unshadowed = torch.zeros_like(site.position), torch.zeros_like(site.position)
    for square in squares:
        check_cancelled(cancel)
        count += 1
        seen = light.sample(site.position, site.normal, square.to(site.position))
        cosine = _dot(site.normal, seen.direction)
        lit = cosine > 0
        horizon = (_dot(site.smooth, seen.direction) > 0) & lit if site.bumped else lit
        cosine = cosine.clamp_min(0)
        entering = seen.irradiance * (cosine * fresnel.transmittance(cosine, eta))[:, None]
        unshadowed = unshadowed + entering
        free = _visible(occluder, site, seen.direction, seen.distance, horizon)
        total = total + entering * free[:, None]
    return total / count, unshadowed / count


def _visible(
    occluder: Occluder | None,
    site: _Site,
    direction: Float[Tensor, "P 3"],
    distance: Float[Tensor, " P"],
    lit: Bool[Tensor, " P"],
) -> Bool[Tensor, " P"]:
    """Whether light arrives; rays are traced only for points that are `lit`."""
    if occluder is None:
        return lit
    rows = lit.nonzero()[:, 0]
    hidden = occluder.occluded(
        site.origin[rows], direction[rows], distance[rows], normals=site.face_normal[rows]
    )
    return lit.index_put((rows,), ~hidden)


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
