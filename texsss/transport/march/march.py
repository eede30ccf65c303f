"""Single scattering in layers of varying thickness, seen from an eye: at texels or at camera hits."""

from collections.abc import Sequence
from dataclasses import replace
from threading import Lock
from typing import Any

import torch

from texsss.errors import ShapeError
from texsss.light.emitters import Environment, Light, graded
from texsss.light.sites import smooth_origin
from texsss.light.visibility import Occluder
from texsss.media.stack import Stack
from texsss.numerics.threads import in_threads
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.transport.march.check import check_entered, check_method, check_planes, check_points, check_view
from texsss.transport.march.gatherer import Gatherer, Method, Phase
from texsss.transport.march.interior import Interior, check_uv, from_stack
from texsss.transport.march.looks import drawn, scaled_to
from texsss.transport.march.noise import Noise, draw
from texsss.transport.march.planes import (
    Planes,
    fit_planes,
    plane_radius,
    rounded_radius,
    tangent_planes,
)
from texsss.transport.march.setup import Sites, Surface, dot, light_scalars, view_rays
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled, chunks, unit

CHUNK = 1 << 15  # points that a thread takes at a time
TOGETHER = 8  # samples of lights that share one march


def march(
    points: Points,
    mesh: Mesh,
    planes: Planes | None,
    layers: Stack | Interior,
    lights: Sequence[Light],
    view: Float[Tensor, "P 3"] | Float[Tensor, "3"],
    *,
    compiled: bool = False,
    seed: int = 0,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
    **how: Any,
) -> Float[Tensor, "P 3"]:
    """`March` of one set of points: radiance that leaves towards the eye [W/(m² sr)], linear RGB.

    `how` and what comes before `view` but `points` are what it is made of; all else is as when it is called.
    Raises as that.
    """
    ready = March(mesh, planes, layers, lights, **how)
    return ready(points, view, compiled=compiled, seed=seed, progress=progress, cancel=cancel)


class March:
    """Light scattered once in one interior under some lights, seen from anywhere.

    Maps and surface are packed when first asked for, once for all calls, which may come from several threads;
    what asks for gradients is made anew for every step of descent.
    `planes`: what the surface looks like from within; fitted here when None. `layers`: a stack, or depth
    textures made into an `Interior`. `uv`: texture coordinates of the maps, the mesh's own when None.
    `method`: `exact` integrates straight pieces of layers over `samples` steps; `uniform` adds up
    `samples` points. `phase`: for Schlick's, the media's g is his k. `occluder` shadows the point and
    the place where light enters. Lights that are not points are sampled `environment_samples` or
    `area_samples` times.
    Raises ShapeError, DomainError: when inputs do not fit.
    Source: François et al. 2006 with the corrections of Norberg 2010; exact segments are ours.
    """

    def __init__(
        self,
        mesh: Mesh,
        planes: Planes | None,
        layers: Stack | Interior,
        lights: Sequence[Light],
        *,
        uv: Float[Tensor, "F 3 2"] | None = None,
        method: Method = "exact",
        samples: int = 4,
        phase: Phase = "henyey-greenstein",
        occluder: Occluder | None = None,
        noise: Noise | None = None,
        environment_samples: int = 16,
        area_samples: int = 4,
    ):
        check_method(method, samples, phase, environment_samples, area_samples)
        interior = layers if isinstance(layers, Interior) else from_stack(layers)
        channels = interior.sigma_t.shape[-1]
        if channels not in (1, 3):
            raise ShapeError(f"march: expected media of 1 or 3 channels, as lights have, got {channels}.")
        self.mesh, self.lights, self.occluder, self.noise = mesh, tuple(lights), occluder, noise
        self.interior = interior.to(mesh.vertices)
        self._how = method, samples, phase
        self._counts = environment_samples, area_samples
        check_planes(mesh, planes)
        self._uv, self._planes = uv, planes
        self._surface: tuple[Surface, Tensor] | None = None
        self._gatherers: dict[bool, Gatherer] = {}
        self._making = Lock()

    def __call__(
        self,
        points: Points,
        view: Float[Tensor, "P 3"] | Float[Tensor, "3"],
        *,
        thickness: Float[Tensor, " P"] | None = None,
        normals: Float[Tensor, "P 3"] | None = None,
        entered: Sequence[Float[Tensor, "P 3"] | None] | None = None,
        compiled: bool = False,
        seed: int = 0,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
    ) -> Float[Tensor, "P 3"]:
        """Radiance that leaves towards the eye after one scattering [W/(m² sr)], linear RGB.

        `points`: texels or camera hits, alike. `view`: unit directions from the points to the eye (P, 3), or
        the position of one eye (3,) [mm]; what faces away from it gets 0. `compiled`: by a loop in C++,
        where there is a compiler, in float32 and without gradients; the first call on a machine builds it,
        which takes seconds. `thickness` (P,) [mm]: of the object along the normal; nothing scatters
        beyond it, however deep the last layer is. `normals` (P, 3): shading normals, bumps included, in
        place of the mesh's; they are to face the eye.
        `entered`: what enters here of each light, shadows included [W/m²], where it is known. Such a light is
        asked for its directions alone, at the same places of its square for all points (surroundings but
        for their spots: at nodes of a quadrature about the normal, 16 at least), and no shadow rays are cast:
        what the march makes of it unshadowed is scaled to what entered, which leaves no grain.
        Rays bend at the surface by the outermost eta, after which the light's direction is the refracted
        one at the point. Differentiable, uncompiled, in depths, coefficients, lights and vertices.
        Raises ShapeError, DomainError: when the view, thickness, normals or what entered do not fit. Raises
        Cancelled.
        """
        check_view(len(points), view)
        check_points(len(points), thickness, normals)
        check_entered(len(points), len(self.lights), entered)
        mesh, home = self.mesh, self.mesh.vertices
        if len(points) == 0:
            return home.new_zeros(0, 3)
        view = view.to(home)
        surface, coordinates, gather = self._made(compiled)
        rows, ended = chunks(len(points), CHUNK), []
        _ = mesh.corner_normals  # by all threads, before they part

        def part(row: slice) -> Float[Tensor, "rows 3"]:
            here = points[row]
            generator = torch.Generator().manual_seed(seed + row.start)
            towards = unit(view - here.position(mesh)) if view.ndim == 1 else view[row]
            jitter = None if self.noise is None else draw(self.noise, here.uv(coordinates), generator)
            result = torch.zeros_like(towards)
            # what faces away is dark
            facing = (dot(towards.detach(), here.face_normal(mesh).detach()) > 0).nonzero()[:, 0]
            if len(facing):
                jitter = None if jitter is None else jitter[facing]
                thick = None if thickness is None else thickness[row][facing].to(home)
                sites = surface.at(here[facing])
                if normals is not None:
                    sites = replace(sites, normal=normals[row][facing].to(home))
                known = [None if e is None else e[row][facing].to(home) for e in entered or []]
                left = self._gathered(
                    sites,
                    gather,
                    here[facing],
                    towards[facing],
                    thick,
                    jitter,
                    known,
                    seed,
                    generator,
                    cancel,
                )
                result = result.index_put((facing,), left)
            ended.append(row)
            if progress is not None:
                progress("march", len(ended) / len(rows))
            return result

        return torch.cat(in_threads(part, rows, cancel, graded=self._graded(surface)))

    def _graded(self, surface: Surface) -> bool:
        return surface.corner.requires_grad or self.interior.requires_grad or graded(self.lights)

    def _made(self, compiled: bool) -> tuple[Surface, Float[Tensor, "F 3 2"], Gatherer]:
        """The surface, its texture coordinates, and what gathers light beneath it."""
        with self._making:
            if self._surface is None:
                coordinates = check_uv(self.mesh, self._uv, self.interior)
                planes = self._planes or fitted_planes(self.mesh, planes_radius(self.interior))
                self._surface = Surface(self.mesh, planes, coordinates), coordinates
            compiled = compiled and not self._graded(self._surface[0])
            if compiled not in self._gatherers:
                self._gatherers[compiled] = Gatherer(self.interior, *self._how, compiled)
            return *self._surface, self._gatherers[compiled]

    def _gathered(
        self,
        sites: Sites,
        gather: Gatherer,
        here: Points,
        towards: Float[Tensor, "P 3"],
        thickness: Float[Tensor, " P"] | None,
        jitter: Float[Tensor, "P 3"] | None,
        entered: Sequence[Float[Tensor, "P 3"] | None],
        seed: int,
        generator: torch.Generator,
        cancel: Cancel | None,
    ) -> Float[Tensor, "P 3"]:
        """Radiance of all lights that leaves towards the eye."""
        eta, occluder = gather.interior.eta, self.occluder
        moved = None if jitter is None else jitter[:, :2]
        rays = view_rays(sites, towards, eta, gather.far, gather.size, moved, thickness)
        origin = None if occluder is None else smooth_origin(here, self.mesh)
        shift = None if jitter is None else jitter[:, 2]
        total = torch.zeros_like(sites.position)
        waiting: list[Tensor] = []
        for number, light in enumerate(self.lights):
            count = 1 if light.is_delta else self._counts[not isinstance(light, Environment)]
            known = entered[number] if entered else None
            if known is None:
                looks = drawn(light, count, sites, seed + number, generator)
            else:
                looks = scaled_to(known, light, count, sites, eta)
                count = len(looks)
            for seen in looks:
                check_cancelled(cancel)
                shadows = occluder if known is None else None
                waiting.append(light_scalars(sites, rays, seen, eta, gather.size, shadows, origin, 1 / count))
                if len(waiting) == TOGETHER:
                    total = total + gather(rays.scalars, torch.stack(waiting), shift)
                    waiting = []
        if waiting:
            total = total + gather(rays.scalars, torch.stack(waiting), shift)
        return total * rays.leaves[:, None]


def planes_radius(interior: Interior) -> float:
    """The radius that planes ask of the first layer [mm], rounded; 0 where it is clear."""
    least = float(interior.sigma_t.detach()[..., 0, :].amin())
    return rounded_radius(plane_radius(least)) if least > 0 else 0.0


def fitted_planes(mesh: Mesh, radius_mm: float) -> Planes:
    """Planes through what lies within a radius; tangent planes where that is 0."""
    return fit_planes(mesh, radius_mm) if radius_mm > 0 else tangent_planes(mesh)
