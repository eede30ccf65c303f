"""What the object is made of: maps of its surface, layers, and the weights of the Gaussians in them."""

from dataclasses import replace
from functools import cached_property

import torch

from texsss import resolve
from texsss.cache import Kept, content_key
from texsss.ground import Ground
from texsss.look import map_names, painted, share_of
from texsss.profiles.project import variance_ladder
from texsss.profiles.weights import weights_for
from texsss.types import Float, Tensor


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
        texels, image = self.texels.value, self.surface_maps[name]

        def make():
            return painted(image.value, texels.points, texels.mesh).expand(-1, 3)

        return self.stage("albedo", make, self.texels, image)

    @cached_property
    def stack(self) -> Kept:
        """The layers; not kept itself, but named by everything in it."""
        scene = self.scene
        used = {name: self.image(name) for name in resolve.material_maps(scene)}
        key = content_key("stack", scene.material.layers, scene.media, used)
        return Kept(resolve.stack(scene, {name: image.value for name, image in used.items()}), key)

    @cached_property
    def variances(self) -> Float[Tensor, " K"]:
        """The ladder [mm²]; the identity alone when nothing diffuses."""
        texels, methods = self.texels.value, self.scene.methods
        if methods.diffusion == "none":
            return torch.zeros(1)
        return variance_ladder(texels.texel_mm, texels.mesh.diagonal_mm, methods.terms)

    def profile(self, scattering: str) -> Kept:
        """Weights of the ladder at the texels, as the media have them."""
        texels, methods, stack = self.texels.value, self.scene.methods, self.stack.value
        model, incidence = methods.profile, methods.incidence

        def make():
            return weights_for(
                stack,
                self.variances,
                points_uv=texels.points.uv(self.source_uv) if stack.varies else None,
                points=len(texels),
                model=model,
                scattering=scattering,
                incidence=incidence,
                **self.hooks("weights"),
            )

        depends = self.stack, self.texels, self.variances, model, scattering, incidence
        return self.stage("weights", make, *depends)

    def weights(self, scattering: str) -> Kept:
        """Weights that pictures use: of total 1 where an albedo map says how much comes back."""
        made = self.profile(scattering)
        if not self.normalised:
            return made
        total = self.profile("total")
        table = made.value.table * share_of(total.value.table.sum(1, keepdim=True))
        return Kept(replace(made.value, table=table), f"{made.key} of {total.key}")

    @property
    def normalised(self) -> bool:
        """Whether profiles are scaled to total 1, since an albedo map says how much comes back."""
        asked = self.scene.material.surface.normalise
        return self.scene.material.surface.albedo is not None if asked is None else asked
