"""Hierarchical integration of a scene: irradiance at samples of the mesh, summed at texels or camera hits."""

from collections.abc import Callable
from functools import cached_property

import torch

from texsss.cache import Kept
from texsss.light.thickness import far_side
from texsss.lighting import Lighting
from texsss.look import painted
from texsss.numerics.sampling import bilinear
from texsss.profiles.through import straight
from texsss.surface.points import Points
from texsss.transport.octree.exitance import RESOLVED, Surface, emission
from texsss.transport.octree.samples import MOST_SAMPLES, affordable_spacing, surface_samples
from texsss.types import Float, Tensor
from texsss.view.camera import Hits


class Hierarchy(Lighting):
    """`diffusion: octree`; each property is a stage, made when first asked for."""

    @cached_property
    def sample_spacing(self) -> float:
        """Distance of the samples [mm]: as asked, or the shortest mean free path, if that many serve."""
        asked, (mesh, _) = self.scene.methods.octree.spacing_mm, self.rest.value
        if asked is not None:
            return asked
        stack, texels = self.stack.value, self.texels_at_rest.value
        some = texels.points[:: max(len(texels) // 1024, 1)]
        table = stack.at(some.uv(self.source_uv)) if stack.varies else stack.table()
        extinction = table.sigma_a + table.sigma_s * (1 - table.g)
        free = 1 / float(extinction.detach().amax().clamp_min(1e-6))
        return affordable_spacing(mesh, max(free, 1e-9 * mesh.diagonal_mm), MOST_SAMPLES // 3)

    @cached_property
    def samples(self) -> Kept:
        """(points, area [mm²]) of the samples; a pose moves them with its faces."""
        (rest, _), (mesh, _), spacing = self.rest.value, self.mesh.value, self.sample_spacing
        at_rest = self.stage("samples", lambda: surface_samples(rest, spacing), self.rest, spacing)
        if self.pose is None:
            return at_rest

        def make():
            points, area = at_rest.value
            grown = mesh.face_area / rest.face_area.clamp_min(1e-30)
            return points, area * grown[points.face.long()]

        return self.stage("samples", make, at_rest, self.mesh)

    @cached_property
    def sample_light(self) -> Kept:
        """Entered irradiance at the samples (P, 3) [W/m²]."""
        points, _ = self.samples.value

        def make():
            return self.entered(self.sites_of(points), "light")

        key = self.samples, self.bump, self.lights_key, self.stack.value.eta, self.scene.seed
        return self.stage("light", make, *key)

    def emission(self, scattering: str) -> Kept:
        """The octree of what the samples send."""
        (points, area), light, spacing = self.samples.value, self.sample_light, self.sample_spacing
        rule, normalise = self.scene.methods.rule, self.scene.methods.octree.normalise
        pre = self.scene.material.surface.albedo_mode in ("pre", "both")

        def make():
            entered = light.value * self.entry_albedo(points) if pre else light.value
            sends = self._surface_of(points, entered, scattering)
            return emission(sends, area, spacing, rule=rule, normalise=normalise)

        return self.stage("octree", make, light, self.matter_key(scattering), rule, normalise)

    def matter_key(self, scattering: str) -> tuple:
        """Everything that exitance depends on besides light and places."""
        scene = self.scene
        normalised = int(self.normalised), int(scene.methods.transmission)
        surface = scene.material.surface
        albedo = None if surface.albedo is None else self.surface_maps[surface.albedo]
        return self._profile_key(scattering), normalised, surface.albedo_mode, albedo

    def hierarchical(self, scattering: str) -> Kept:
        """Exitance at the texels (P, 3) [W/m²], but for the albedo that applies after diffusion."""
        emission, light, texels = self.emission(scattering), self.irradiance, self.texels.value
        epsilon = self.scene.methods.octree.epsilon

        def make():
            return self.exitance_at(texels.points, self.before(light.value), scattering, emission)

        return self.stage("octree", make, emission, light, epsilon)

    def before(self, light: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """Light at the texels, times the part of the albedo that applies before diffusion."""
        if self.scene.material.surface.albedo_mode == "post":
            return light
        return light * self.entry_albedo(self.texels.value.points)

    def exitance_at(
        self, points: Points, light: Float[Tensor, "P 3"], scattering: str, emission: Kept
    ) -> Float[Tensor, "P 3"]:
        """Exitance [W/m²] at points where `light` [W/m²] enters."""
        return emission.value.exitance(
            self._surface_of(points, light, scattering),
            epsilon=self.scene.methods.octree.epsilon,
            **self.hooks("octree"),
        )

    def exitance_of_hits(self, scattering: str) -> Callable[[Hits], Tensor]:
        """The function from camera hits to exitance (P, 3) [W/m²]; light enters there as the texels know."""
        emission, texels = self.emission(scattering), self.texels.value
        light = texels.to_image(self.before(self.irradiance.value))

        def at(hits: Hits) -> Tensor:
            here = bilinear(light, hits.points.uv(texels.atlas_uv))
            return self.exitance_at(hits.points, here, scattering, emission)

        return at

    def entry_albedo(self, points: Points) -> Float[Tensor, "P 3"]:
        """What of the albedo applies where light enters."""
        surface, (mesh, _) = self.scene.material.surface, self.mesh.value
        if surface.albedo is None:
            return torch.ones(len(points), 3)
        colour = painted(self.surface_maps[surface.albedo].value, points, mesh).expand(-1, 3)
        return colour if surface.albedo_mode == "pre" else colour.sqrt()

    def _surface_of(self, points: Points, light: Float[Tensor, "P 3"], scattering: str) -> Surface:
        (mesh, _) = self.mesh.value
        far = None
        if self.scene.methods.transmission:
            far = far_side(points, mesh, self.occluder.value, **self.hooks("thickness"))
        back, passed = self.weights_at(points, scattering, far)
        if passed is not None and far is not None:
            passed = straight(passed, far.thickness, RESOLVED * self.sample_spacing)
        return Surface(points.position(mesh), points.normal(mesh), light, back, passed)
