"""What the object is made of: maps of its surface, layers, and the weights of the Gaussians in them."""

import math
from dataclasses import replace
from functools import cached_property
from typing import Literal

import torch

from texsss import resolve
from texsss.cache import Kept, content_key
from texsss.errors import DomainError
from texsss.ground import Ground
from texsss.light.thickness import FarSide
from texsss.look import map_names, painted, share_of
from texsss.profiles.angular import angular
from texsss.profiles.gaussians import GaussianSum
from texsss.profiles.project import variance_ladder
from texsss.profiles.through import weights_through
from texsss.profiles.weights import Weights, weights_for
from texsss.surface.points import Points
from texsss.transport.march.interior import marches
from texsss.types import Float, Tensor

SOME = 1024  # texels at which a varying material is averaged


class Matter(Ground):
    """What light spreads in; each property is a stage, made when first asked for."""

    @cached_property
    def surface_maps(self) -> dict[str, Kept]:
        """The maps of the surface by name. Raises ShapeError: when the mesh has nothing to lay them on."""
        maps = {name: self.image(name) for name in map_names(self.scene.material.surface)}
        if maps:
            _ = self.source_uv
        return maps

    @cached_property
    def albedo(self) -> Kept | None:
        """Albedo at the texels (P, 3); None without a map."""
        name = self.scene.material.surface.albedo
        if name is None:
            return None
        texels, image = self.texels_at_rest.value, self.surface_maps[name]

        def make():
            return painted(image.value, texels.points, texels.mesh).expand(-1, 3)

        return self.stage("albedo", make, self.texels_at_rest, image)

    @cached_property
    def stack(self) -> Kept:
        """The layers; not kept itself, but named by everything in it that light which diffuses knows."""
        return self._stacked({name: self.image(name) for name in resolve.material_maps(self.scene)})

    @cached_property
    def marched_stack(self) -> Kept:
        """The layers as a march reads them: beside charts, where it looks from within them, maps go on."""
        names = resolve.material_maps(self.scene)
        return self._stacked({name: self.continued(name) for name in names}) if names else self.stack

    def _stacked(self, used: dict[str, Kept]) -> Kept:
        scene, names = self.scene, resolve.media_names(self.scene)
        # a phase is the march's alone, and what no layer names is nobody's
        plain = {"phase": "henyey-greenstein"}
        media = {n: scene.media[n].model_copy(update=plain) for n in names if n in scene.media}
        key = content_key("stack", scene.material.layers, scene.material.depths, media, used)
        layers = resolve.stack(scene, {name: image.value for name, image in used.items()})
        return Kept(layers, key, passing=any(image.passing for image in used.values()))

    @cached_property
    def ladder(self) -> Float[Tensor, " K"]:
        """Variances that serve every material on this object and atlas, in any pose [mm²]."""
        texels = self.texels_at_rest.value
        return variance_ladder(texels.texel_mm, texels.mesh.diagonal_mm, self.scene.methods.terms)

    @cached_property
    def variances(self) -> Float[Tensor, " K"]:
        """The ladder [mm²]; the identity alone when nothing diffuses, one width for a Poisson disc."""
        methods = self.scene.methods
        if methods.diffusion == "none":
            return torch.zeros(1)
        if methods.diffusion == "poisson":
            return torch.tensor([self._disc_variance()], dtype=torch.float64)
        return self.ladder

    def _disc_variance(self) -> float:
        """Variance of the Poisson blur [mm²]: as asked, or that within which half the light comes back."""
        asked, texels = self.scene.methods.poisson.radius_mm, self.texels_at_rest.value
        if asked is not None:
            return asked**2 / 4  # of a disc, per axis
        some = texels.points[:: max(len(texels) // SOME, 1)]
        mean = self._solved(some, self.ladder, "total").at().mean(0).double()
        half = GaussianSum(self.ladder, mean).radius(0.5).mean()
        return max(float(half) ** 2 / (2 * math.log(2)), texels.texel_mm**2)

    def profile(self, scattering: str) -> Kept:
        """Weights of the Gaussians at the texels, as the media have them."""
        texels = self.texels_at_rest.value
        make = lambda: self._solved(texels.points, self.variances, scattering)  # noqa: E731
        return self.stage("weights", make, *self._profile_key(scattering))

    def weights(self, scattering: str) -> Kept:
        """Weights that pictures use: of total 1 where an albedo map says how much comes back."""
        if self.scene.methods.transmission:
            both = self._both_sides(scattering)
            return both.turned(both.value[0], "back")
        made = self.profile(scattering)
        if not self.normalised:
            return made
        total = self.profile("total")
        table = made.value.table * share_of(total.value.table.sum(1, keepdim=True))
        return made.turned(replace(made.value, table=table), f"of {total.key}")

    @cached_property
    def passed(self) -> Kept | None:
        """Weights of light that comes through from the far side; None unless asked for."""
        if not self.scene.methods.transmission:
            return None
        both = self._both_sides("total")
        return both.turned(both.value[1], "passed")

    def _both_sides(self, scattering: str) -> Kept:
        texels, far = self.texels.value, self.far_side

        def make():
            return self.weights_at(texels.points, scattering, far.value)

        return self.stage("weights", make, *self._profile_key(scattering), far, int(self.normalised))

    def weights_at(
        self, points: Points, scattering: str, far: FarSide | None
    ) -> tuple[Weights, Weights | None]:
        """Weights at points of the surface, of what comes back and, given its far side, of what passes."""
        if far is None:
            back, passed = self._solved(points, self.variances, scattering), None
        else:
            methods, stack = self.scene.methods, self.stack.value
            back, passed = weights_through(
                stack,
                self.variances,
                far.thickness,
                points_uv=points.uv(self.source_uv) if stack.varies else None,
                model=methods.profile,
                scattering=scattering,
                incidence=methods.arriving,
                compiled=True,
                **self.hooks("weights"),
            )
        if not self.normalised:
            return back, passed
        total = self._solved(points, self.variances, "total")
        share = share_of(total.table.sum(1))
        return back.scaled(share, total.row), None if passed is None else passed.scaled(share, total.row)

    def _solved(self, points: Points, variances: Tensor, scattering: str) -> Weights:
        """Weights at points, as the media have them, however thick the object is."""
        methods, stack = self.scene.methods, self.stack.value
        return weights_for(
            stack,
            variances,
            points_uv=points.uv(self.source_uv) if stack.varies else None,
            points=len(points),
            model=methods.profile,
            scattering=scattering,
            incidence=methods.arriving,
            compiled=True,
            **self.hooks("weights"),
        )

    def _profile_key(self, scattering: str) -> tuple:
        methods = self.scene.methods
        return self.stack, self.texels_at_rest, self.variances, methods.profile, scattering, methods.arriving

    @cached_property
    def marching(self) -> Literal["none", "uniform", "exact"]:
        """How pictures march light that was scattered once; "none" where the profiles hold it."""
        methods = self.scene.methods
        if methods.single_scattering != "auto":
            return methods.single_scattering
        fits = methods.marches_unasked and marches(self.stack.value)
        return "exact" if fits and self.scene.lights else "none"

    @property
    def marches_what_entered(self) -> bool:
        """Whether the march takes from the texels what enters of lights that have an extent."""
        return self.scene.methods.single_scattering == "auto" and self.marching != "none"

    @property
    def phase(self) -> Literal["henyey-greenstein", "schlick"]:
        """The phase of all layers that deflect. Raises DomainError: if they differ."""
        specs = [self.scene.media.get(name) for name in resolve.media_names(self.scene)]
        shapes = {spec.phase for spec in specs if spec is not None and spec.preset is None and spec.g != 0.0}
        known = [
            resolve.medium(self.scene, n, {}) for n in resolve.media_names(self.scene) if self._preset(n)
        ]
        if any(bool((one.g != 0).any()) for one in known):
            shapes.add("henyey-greenstein")
        if len(shapes) > 1:
            raise DomainError(
                "Scene: expected one phase for all layers that are marched, got henyey-greenstein "
                "and schlick; give all media the same, or g 0, which has one shape."
            )
        return "schlick" if "schlick" in shapes else "henyey-greenstein"

    def _preset(self, name: str) -> bool:
        spec = self.scene.media.get(name)
        return spec is None or spec.preset is not None

    @property
    def grain(self) -> Kept | None:
        """The map that the march's noise comes from."""
        name = self.scene.methods.march.noise_map
        if name is None:
            return None
        _ = self.source_uv
        return self.image(name)

    @property
    def why_unmarched(self) -> list[str]:
        """What to know where pictures would march but for the material, in sentences."""
        methods = self.scene.methods
        if methods.single_scattering != "auto" or not methods.marches_unasked or marches(self.stack.value):
            return []
        return [
            "A layer's thickness differs between colours, so pictures march no light that scattered once: "
            'the light of textures holds it; choose one "channel" of the thickness map to have it marched.'
        ]

    @cached_property
    def angular(self) -> Kept | None:
        """How what is not marched enters and leaves by its angle, of mean maps; None unless asked for."""
        methods, scene = self.scene.methods, self.scene
        if not methods.angular or self.marching == "none":
            return None
        used = {name: self.image(name) for name in resolve.material_maps(scene)}

        def make():
            means = {name: image.value.mean((0, 1), keepdim=True) for name, image in used.items()}
            return angular(resolve.stack(scene, means), model=methods.profile)

        return self.stage("angular", make, self.stack, methods.profile)

    @property
    def normalised(self) -> bool:
        """Whether profiles are scaled to total 1, since an albedo map says how much comes back."""
        asked = self.scene.material.surface.normalise
        return self.scene.material.surface.albedo is not None if asked is None else asked
