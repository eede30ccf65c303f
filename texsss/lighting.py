"""What lights the object: emitters placed, and the light that enters at points of the surface."""

from collections.abc import Sequence
from functools import cached_property, reduce
from typing import Any

import torch

from texsss import placing
from texsss.cache import Kept
from texsss.light.beneath import arriving
from texsss.light.emitters import Environment, Light
from texsss.light.irradiance import Weighing, grouped, irradiance_apart, irradiance_at
from texsss.light.sites import Sites, sites_at
from texsss.look import bumped
from texsss.matter import Matter
from texsss.surface.curvature import curvature_at, shape_operators
from texsss.surface.points import Points
from texsss.types import Float, Tensor


class Lighting(Matter):
    """Where light comes from and enters; each property is a stage, made when first asked for."""

    @cached_property
    def panoramas(self) -> dict[str, Kept]:
        """Images that light the scene, by name."""
        return {name: self.image(name) for name in sorted(self.scene.panoramas())}

    @cached_property
    def lights(self) -> list[Light]:
        images = {name: kept.value for name, kept in self.panoramas.items()}
        return placing.lights(self.scene, self.rest.value[0], images)

    @property
    def lights_key(self) -> tuple:
        """Everything that the lights are made from."""
        return self.scene.lights, self.panoramas

    def sites_of(self, points: Points) -> Sites:
        """Where light arrives at points of the surface, bumps included."""
        (mesh, _), surface = self.mesh.value, self.scene.material.surface
        images = {} if surface.normal is None else {surface.normal: self.surface_maps[surface.normal].value}
        return sites_at(points, mesh, bumped(surface, images, points, mesh))

    @cached_property
    def parts(self) -> list[Light]:
        """The lights, those without extent first, surroundings in parts of about one brightness each."""
        points, areas, surroundings = grouped(self.lights)
        return [*points, *areas, *surroundings]

    def entered(
        self,
        sites: Sites,
        stage: str,
        by_angle: Weighing | None = None,
        lights: Sequence[Light] | None = None,
    ) -> Float[Tensor, "P 3"]:
        """Entered irradiance at sites [W/m²], of all lights or those named; by its angle where told how."""
        asked = self.lights if lights is None else lights
        return irradiance_at(sites, asked, by_angle=by_angle, **self._looks, **self.hooks(stage))

    @property
    def _looks(self) -> dict[str, Any]:
        return {
            "eta": self.stack.value.eta,
            "occluder": self.occluder.value,
            "environment_samples": placing.environment_samples(self.scene),
            "area_samples": placing.area_samples(self.scene),
            "seed": self.scene.seed,
        }

    @property
    def bump(self) -> tuple:
        """Everything that bumps are made from."""
        surface = self.scene.material.surface
        return (None if surface.normal is None else self.surface_maps[surface.normal]), surface.normal_y

    @cached_property
    def sites(self) -> Kept:
        """Where light arrives at the texels."""
        texels = self.texels.value
        return self.stage("sites", lambda: self.sites_of(texels.points), self.texels, self.bump)

    @cached_property
    def irradiance(self) -> Kept:
        """Entered irradiance at the texels (P, 3) [W/m²]."""
        sites, eta, seed = self.sites, self.stack.value.eta, self.scene.seed
        each = self._each if self.marches_what_entered else None

        def make() -> Tensor:
            return self.entered(sites.value, "light") if each is None else reduce(torch.add, each.value)

        return self.stage("light", make, sites, self.lights_key, eta, seed)

    @cached_property
    def _each(self) -> Kept | None:
        """What enters at the texels of lights without extent, and of each other of `parts`, looked for once.

        None where that is all one, or nothing has an extent.
        """
        if len(self.parts) == 1 or all(part.is_delta for part in self.parts):
            return None
        sites, eta, seed = self.sites, self.stack.value.eta, self.scene.seed
        make = lambda: irradiance_apart(sites.value, self.lights, **self._looks, **self.hooks("light"))  # noqa: E731
        return self.stage("light", make, sites, self.lights_key, eta, seed, "apart")

    @cached_property
    def curvature(self) -> Kept:
        """How the surface curves at the texels (P, 3, 3) [1/mm]."""
        texels = self.texels.value

        def make():
            return curvature_at(texels.points, texels.mesh, shape_operators(texels.mesh))

        return self.stage("curvature", make, self.texels)

    @property
    def entered_apart(self) -> list[Kept | None]:
        """Entered irradiance at the texels (P, 3) [W/m²] of each of `parts` alone that has an extent."""
        points = sum(part.is_delta for part in self.parts)
        each = self._each
        if each is None:
            return [None] * points + [self.irradiance] * (len(self.parts) - points)
        alone = [each.turned(light, f"part {number}") for number, light in enumerate(each.value[1:])]
        return [None] * points + alone

    @property
    def irradiance_by_angle(self) -> Kept:
        """Entered irradiance at the texels, as much as comes back of its angle per that of diffuse light.

        It lies where it scatters first, beside where it entered.
        """
        how = self.angular
        if how is None:
            return self.irradiance
        sites, eta, seed, bent = self.sites, self.stack.value.eta, self.scene.seed, self.curvature

        def weight(rows: Tensor, cosine: Tensor, direction: Tensor) -> Tensor:
            normal = sites.value.normal[rows]
            beneath = arriving(cosine, direction, normal, bent.value[rows], how.value.free, eta)
            return how.value.at(cosine) * beneath

        # grazing light that refracts does not reach beyond the terminator
        weighing = Weighing(weight, float(how.value.free.mean()) if eta == 1 else 0.0)
        make = lambda: self.entered(sites.value, "light", weighing)  # noqa: E731
        return self.stage("light", make, sites, self.lights_key, eta, seed, how, bent)

    @property
    def irradiance_beside(self) -> Kept | None:
        """Irradiance at the texels of light that leaves where it entered by both angles; None unless known.

        That of surroundings, which comes from everywhere, is none.
        """
        how = self.angular
        if how is None or how.value.beside is None:
            return None
        sites, eta, seed = self.sites, self.stack.value.eta, self.scene.seed
        nearby = [light for light in self.lights if not isinstance(light, Environment)]

        def weight(rows: Tensor, cosine: Tensor, direction: Tensor) -> Tensor:
            return how.value.beside_at(cosine) * cosine[:, None]

        make = lambda: self.entered(sites.value, "light", Weighing(weight), nearby)  # noqa: E731
        return self.stage("light", make, sites, self.lights_key, eta, seed, how, "beside")
