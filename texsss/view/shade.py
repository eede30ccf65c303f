"""What the camera sees at its hits: scattered light on its way out, and highlights."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch.quasirandom import SobolEngine

from texsss.errors import DomainError
from texsss.light.emitters import Environment, Light
from texsss.light.sites import dot, smooth_origin
from texsss.light.terminator import cut_by_faces
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.numerics.sampling import Texture
from texsss.surface.mesh import Mesh
from texsss.types import Bool, Float, Int, Tensor, unit
from texsss.view import ggx
from texsss.view.camera import Hits

GRAZING = 0.02  # the least cosine of a visible point: normals that turn away are bent back to it


@dataclass(frozen=True, eq=False)
class Gloss:
    """How the surface mirrors light.

    `roughness` 0..1 (perceptual; the microfacet width is its square) and `strength` ≥ 0, which scales
    the highlight: numbers, or a value per hit (P,). `second`: share 0..1 of a second lobe, whose
    roughness is `second_ratio` × the first: skin is oil on a coarser surface, and one lobe cannot have
    both its sharp core and its wide foot.
    Raises DomainError: when roughness or second is outside 0..1, strength or ratio negative.
    """

    roughness: float | Tensor = 0.4
    strength: float | Tensor = 1.0
    second: float | Tensor = 0.0
    second_ratio: float = 1.6

    @property
    def lobes(self) -> list[tuple[float | Tensor, float | Tensor]]:
        """Share and roughness of each lobe."""
        if isinstance(self.second, float) and self.second == 0:
            return [(1.0, self.roughness)]
        coarse = torch.as_tensor(self.roughness * self.second_ratio).clamp(0, 1)
        return [(1 - self.second, self.roughness), (self.second, coarse)]

    def __post_init__(self):
        limits = (("roughness", 1.0), ("strength", math.inf), ("second", 1.0), ("second_ratio", math.inf))
        for name, most in limits:
            low, high = (float(x) for x in torch.as_tensor(getattr(self, name)).detach().aminmax())
            if not (low >= 0 and high <= most):
                raise DomainError(f"Gloss: expected {name} from 0 to {most:g}, got {low:g} to {high:g}.")


@dataclass(frozen=True, eq=False)
class Sight:
    """What the camera sees at `hits` but for the scattered light: that of exitance M is gain M + gloss.

    `gain` [1/sr]: how much of it leaves towards the camera, the albedo included; `gloss` [W/(m² sr)]: the
    highlights; `cosine`: of the shading normal. None knows the material beneath: an edit of it leaves them
    as they are.
    """

    hits: Hits
    cosine: Float[Tensor, " P"]
    gain: Float[Tensor, "P 3"]
    gloss: Float[Tensor, "P 3"]


def shade(
    hits: Hits,
    mesh: Mesh,
    atlas_uv: Float[Tensor, "F 3 2"],
    exitance: Float[Tensor, "H W 3"] | Texture,
    lights: list[Light] | tuple[Light, ...],
    **look: Any,
) -> Float[Tensor, "P 3"]:
    """Radiance towards the camera [W/(m² sr)].

    `exitance`: scattered light M [W/m²], an image over `atlas_uv` without empty texels at the seams.
    `look`: the options of `sight`. Differentiable as that, and in exitance.
    """
    seen = sight(hits, mesh, lights, **look)
    return Texture.of(exitance).at(hits.points.uv(atlas_uv)) * seen.gain + seen.gloss


def sight(
    hits: Hits,
    mesh: Mesh,
    lights: list[Light] | tuple[Light, ...],
    *,
    eta: float = 1.4,
    gloss: Gloss | None = None,
    albedo: Float[Tensor, "H2 W2 3"] | Texture | None = None,
    normals: Float[Tensor, "P 3"] | None = None,
    occluder: Occluder | None = None,
    environment_samples: int = 8,
    area_samples: int = 8,
    seed: int = 0,
) -> Sight:
    """How scattered light leaves at hits, and their highlights.

    Scattered light leaves as F_t(ω) M / (π F_dt), times `albedo` (an image over the author's uv, tiled)
    where given. `gloss` adds the highlights of every light, shadowed by `occluder`; None leaves
    them out. `normals` (P, 3) take the place of the mesh's shading normals. Lights that are not points are
    sampled with `seed`. Differentiable in albedo, lights, gloss and normals.
    """
    normal = facing(hits.points.normal(mesh) if normals is None else normals, hits.view)
    cosine = dot(normal, hits.view)
    gain = (fresnel.transmittance(cosine, eta) / (math.pi * fresnel.F_dt(eta)))[:, None].expand(-1, 3)
    if albedo is not None and mesh.source_uv is not None:
        gain = gain * Texture.of(albedo, "repeat").at(hits.points.uv(mesh.source_uv))
    mirrored = torch.zeros_like(gain)
    if gloss is None or not lights:
        return Sight(hits, cosine, gain, mirrored)
    site = _Site(hits, mesh, normal, occluder)
    seed = hits.seed(seed)
    generator = torch.Generator().manual_seed(seed)
    for number, light in enumerate(lights):
        if isinstance(light, Environment):
            squares = _squares(environment_samples, len(cosine), seed + number, generator)
            bright = []
            if light.spots is not None:
                bright = _squares(-(-environment_samples // 2), len(cosine), seed + number, generator)
            mirrored = mirrored + _mirrored(light, site, gloss, eta, squares, bright)
        else:
            squares = [torch.zeros(len(cosine), 2)]
            if not light.is_delta:
                squares = _squares(area_samples, len(cosine), seed + number, generator)
            mirrored = mirrored + _highlight(light, site, gloss, eta, squares)
    return Sight(hits, cosine, gain, mirrored * _per_hit(gloss.strength, site)[:, None])


def facing(normal: Float[Tensor, "P 3"], view: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
    """Shading normals, those that turn away from the viewer bent back until they graze."""
    cosine = (normal * view).sum(-1, keepdim=True)
    across = unit(normal - cosine * view)
    bent = GRAZING * view + math.sqrt(1 - GRAZING**2) * across
    return torch.where(cosine < GRAZING, bent, normal)


class _Site:
    """What highlights need to know about a list of hits."""

    def __init__(self, hits: Hits, mesh: Mesh, normal: Float[Tensor, "P 3"], occluder: Occluder | None):
        self.position = hits.points.position(mesh)
        self.normal = normal
        self.view = hits.view
        self.face_normal = hits.points.face_normal(mesh)
        self.origin = smooth_origin(hits.points, mesh)
        self.mesh, self.occluder = mesh, occluder

    def free(
        self,
        rows: Int[Tensor, " L"],
        direction: Float[Tensor, "L 3"],
        distance: Float[Tensor, " L"] | None,
    ) -> Bool[Tensor, " L"]:
        """Whether nothing stands between these hits and what lies along `direction`."""
        if self.occluder is None:
            return torch.ones_like(rows, dtype=torch.bool)
        origin, normal = self.origin[rows], self.face_normal[rows]
        hidden = self.occluder.occluded(origin, direction, distance, normals=normal)
        # teeth along the terminator, which highlights show most: they are brightest where light grazes
        held = hidden.nonzero()[:, 0]
        start = origin[held] + self.occluder.offset_mm * normal[held]
        reach = None if distance is None else distance[held]
        hidden[held] = ~cut_by_faces(start, direction[held], reach, self.mesh, self.occluder)
        return ~hidden


def _highlight(
    light: Light, site: _Site, gloss: Gloss, eta: float, squares: list[Tensor]
) -> Float[Tensor, "P 3"]:
    """Mirrored radiance of a light that is sampled by itself."""
    total = torch.zeros_like(site.position)
    for square in squares:
        seen = light.sample(site.position, site.normal, square.to(site.position))
        # half of the hits or more face away from any one light
        rows = (dot(site.normal, seen.direction).detach() > 0).nonzero()[:, 0]
        normal, view, direction = (x[rows] for x in (site.normal, site.view, seen.direction))
        carried = site.free(rows, direction, seen.distance[rows]).to(normal)
        mirrored = torch.zeros_like(carried)
        for share, roughness in gloss.lobes:
            lobe = ggx.reflection(normal, view, direction, _per_hit(roughness, site, rows), eta)
            mirrored = mirrored + _per_hit(share, site, rows) * lobe
        total = total.index_add(0, rows, seen.irradiance[rows] * (carried * mirrored)[:, None])
    return total / len(squares)


def _mirrored(
    light: Environment, site: _Site, gloss: Gloss, eta: float, squares: list[Tensor], bright: list[Tensor]
) -> Float[Tensor, "P 3"]:
    """Mirrored radiance of surroundings: looked up where the surface mirrors to, and in their spots.

    Light of the spots is weighed by how likely either way finds it (balance heuristic): few directions of a
    rough lobe meet a sun, and those would glare. Source: Veach & Guibas 1995.
    """
    total = torch.zeros_like(site.position)
    spots, looks = light.spots, len(squares)
    for square in squares:
        for share, roughness in gloss.lobes:
            direction, weight = ggx.sample_reflection(
                site.normal, site.view, _per_hit(roughness, site), eta, square.to(site.position)
            )
            rows = (weight.detach() > 0).nonzero()[:, 0]
            direction = direction[rows]
            radiance = light.radiance_from(direction)
            if spots is not None:
                above, spotted = spots.above(direction, radiance)
                rough = _per_hit(roughness, site, rows)
                found = looks * ggx.density(site.normal[rows], site.view[rows], direction, rough)
                missed = len(bright) * spotted
                radiance = radiance - above * (missed / (found + missed).clamp_min(1e-30))[:, None]
            carried = _per_hit(share, site, rows) * weight[rows] * site.free(rows, direction, None)
            total = total.index_add(0, rows, radiance * (carried / looks)[:, None])
    for square in bright:
        assert spots is not None, "only spots are looked for"
        direction = spots.drawn(square.to(site.position))
        rows = (dot(site.normal, direction).detach() > 0).nonzero()[:, 0]
        normal, view, direction = site.normal[rows], site.view[rows], direction[rows]
        above, spotted = spots.above(direction, light.radiance_from(direction))
        carried = torch.zeros_like(spotted)
        for share, roughness in gloss.lobes:
            rough = _per_hit(roughness, site, rows)
            either = looks * ggx.density(normal, view, direction, rough) + len(bright) * spotted
            lobe = ggx.reflection(normal, view, direction, rough, eta)
            carried = carried + _per_hit(share, site, rows) * lobe / either.clamp_min(1e-30)
        carried = carried * site.free(rows, direction, None)
        total = total.index_add(0, rows, above * carried[:, None])
    return total


def _per_hit(value: float | Tensor, site: _Site, rows: Tensor | None = None) -> Float[Tensor, " L"]:
    """A number or a value per hit as a value for each of these `rows`, or of all."""
    like = site.position[:, 0] if rows is None else site.position[rows, 0]
    given = torch.as_tensor(value, dtype=like.dtype, device=like.device)
    return given.expand_as(like) if rows is None or given.dim() == 0 else given[rows]


def _squares(count: int, points: int, seed: int, generator: torch.Generator) -> list[Tensor]:
    """`count` well-spread samples of the unit square for each point, shifted from point to point."""
    shift = torch.rand(points, 2, generator=generator)
    return [torch.frac(s + shift) for s in SobolEngine(2, scramble=True, seed=seed).draw(count)]
