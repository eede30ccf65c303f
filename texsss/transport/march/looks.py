"""Looks at lights: where the march samples them, and how much each look is worth."""

import math
from collections.abc import Iterator
from dataclasses import replace

import torch
from torch.quasirandom import SobolEngine

from texsss.light.emitters import Environment, Light, LightSamples, basis
from texsss.light.environment import ImageEnvironment
from texsss.media import fresnel
from texsss.numerics.quadrature import gauss_legendre
from texsss.transport.march.setup import Sites, dot
from texsss.types import Float, Tensor

SPOTS = (True,)  # kinds of looks that surroundings take which are spots alone
FEWEST = 4  # directions up and around: fewer see how a sky scatters too roughly


def drawn(
    light: Light, count: int, sites: Sites, seed: int, generator: torch.Generator
) -> Iterator[LightSamples]:
    """`count` looks at a light, one good set for all points, shifted from point to point."""
    for square in _squares(light, count, len(sites.position), seed, generator):
        yield light.sample(sites.position, sites.normal, square.to(sites.position))


def scaled_to(
    entered: Float[Tensor, "P 3"], light: Light, count: int, sites: Sites, eta: float
) -> list[LightSamples]:
    """Looks at a light whose mean enters as `entered` says [W/m²], none from below the horizon.

    All points look at the same places of the light's square, `count` of them. Spots of surroundings, which
    such places might miss, are all of their light from as many directions at most; other surroundings are
    seen from the nodes of a quadrature, of which there are about as many, but never fewer than 16.
    """
    if isinstance(light, ImageEnvironment) and light.looks == SPOTS:
        looks = _at_spots(light, count, sites)
    elif isinstance(light, Environment):
        looks = _all_around(light, count, sites)
    else:
        looks = [
            light.sample(sites.position, sites.normal, square.to(sites.position))
            for square in _squares(light, count, len(sites.position))
        ]
    lit, total = [], torch.zeros_like(entered)
    for seen in looks:
        cosine = dot(seen.direction, sites.normal)
        above = (cosine > 0)[:, None]
        lit.append(replace(seen, irradiance=seen.irradiance * above))
        share = fresnel.transmittance(cosine.clamp_min(0), eta) * cosine.clamp_min(0)
        total = total + lit[-1].irradiance * (share / len(looks))[:, None]
    some = total > 0
    scale = torch.where(some, entered / torch.where(some, total, 1), 0)
    return [replace(seen, irradiance=seen.irradiance * scale) for seen in lit]


def _all_around(sky: Environment, count: int, sites: Sites) -> list[LightSamples]:
    """Looks at surroundings: Gauss-Legendre in the cosine, evenly spaced around, odd rows half a step on.

    What leaves is smooth in both, but most where the cosine is small, where samples by the cosine are few.
    """
    rows = max(FEWEST, math.isqrt(count))
    columns = max(FEWEST, count // rows)
    cosines, weights = gauss_legendre(rows)
    tangent, bitangent = basis(sites.normal)
    distance = sites.position.new_full(sites.position.shape[:1], math.inf)
    looks = []
    for row, (cosine, weight) in enumerate(zip(cosines.tolist(), weights.tolist(), strict=True)):
        sine = math.sqrt(1 - cosine * cosine)
        worth = 2 * math.pi * rows * weight
        for column in range(columns):
            angle = 2 * math.pi * (column + row % 2 / 2) / columns
            flat = math.cos(angle) * tangent + math.sin(angle) * bitangent
            direction = sine * flat + cosine * sites.normal
            looks.append(LightSamples(direction, distance, worth * sky.radiance_from(direction)))
    return looks


def _at_spots(spots: ImageEnvironment, count: int, sites: Sites) -> list[LightSamples]:
    """Looks at every spot: a faint lamp lights alone what turns away from a bright one."""
    home = sites.position
    distance = home.new_full(home.shape[:1], math.inf)
    directions, brought = (part.to(home) for part in spots.mean_looks(count))
    return [
        LightSamples(towards.expand_as(home), distance, (len(brought) * light).expand_as(home))
        for towards, light in zip(directions, brought, strict=True)
    ]


def _squares(
    light: Light, count: int, points: int, seed: int = 0, generator: torch.Generator | None = None
) -> Iterator[Tensor]:
    """`count` samples of a light per point in the unit square, one good set for all.

    It is shifted from point to point where there is a generator.
    """
    if light.is_delta:
        yield torch.full((points, 2), 0.5)
        return
    if generator is None:
        yield from (look.expand(points, 2) for look in SobolEngine(2).draw(count + 1)[1:])
        return
    shift = torch.rand(points, 2, generator=generator)
    if count == 1:
        yield shift
        return
    for common in SobolEngine(2, scramble=True, seed=seed).draw(count):
        yield torch.frac(common + shift)
