"""Layered textures of a scene: what lies beneath the surface, seen from here."""

from collections.abc import Callable
from functools import cached_property, partial

import torch

from texsss.cache import Kept
from texsss.errors import DomainError
from texsss.hierarchy import Hierarchy
from texsss.look import bumped, painted
from texsss.material import SurfaceSpec
from texsss.numerics.sampling import Texture
from texsss.surface.points import Points
from texsss.transport.bank import diffusion
from texsss.transport.parallax import InnerLayer, opacity_from_photograph, shade_layers
from texsss.types import Float, Tensor
from texsss.view.camera import Hits


class Beneath(Hierarchy):
    """`diffusion: parallax`; each property is a stage, made when first asked for."""

    @property
    def layered_textures(self) -> bool:
        """Whether the scene shows textures beneath textures in the place of diffusion."""
        return self.scene.methods.diffusion == "parallax"

    @property
    def upper_surface(self) -> SurfaceSpec:
        """The surface that light leaves through; layered textures hold its albedo already."""
        surface = self.scene.material.surface
        return surface.model_copy(update={"albedo": None}) if self.layered_textures else surface

    @cached_property
    def beneath_maps(self) -> dict[str, Kept]:
        """The maps of the layers, by name. Raises DomainError: when there is nothing to see beneath."""
        spec = self.scene.methods.parallax
        if not spec.layers:
            raise DomainError(
                "Scene: methods.parallax.layers: expected a layer or more beneath the surface, got none; "
                'give one, as {"base": NAME OF A MAP, "depth_mm": 1}.'
            )
        _ = self.source_uv
        named = [spec.opacity, *(value for layer in spec.layers for value in (layer.base, layer.opacity))]
        return {name: self.continued(name) for name in sorted({n for n in named if isinstance(n, str)})}

    @cached_property
    def inner(self) -> Kept:
        """The layers beneath the surface, from the outermost down."""
        spec, maps = self.scene.methods.parallax, self.beneath_maps

        def opacity(value: float | str) -> Tensor:
            return (
                maps[value].value.mean(-1, keepdim=True).clamp(0, 1)
                if isinstance(value, str)
                else torch.full((1, 1, 1), value)
            )

        def make():
            return [
                InnerLayer(
                    maps[layer.base].value.clamp(0, 1).expand(-1, -1, 3),
                    layer.depth_mm,
                    opacity(layer.opacity) if depth < len(spec.layers) else None,
                    layer.spread,
                )
                for depth, layer in enumerate(spec.layers, 1)
            ]

        return self.stage("beneath", make, spec, maps)

    @cached_property
    def outer_opacity(self) -> Kept:
        """How little the surface lets see through: an image over the author's uv (H, W, 1)."""
        value = self.scene.methods.parallax.opacity
        albedo = self.scene.material.surface.albedo
        if isinstance(value, str):
            kept = self.beneath_maps[value]
            return kept.turned(kept.value.mean(-1, keepdim=True), "grey")
        if value is not None:
            return Kept(torch.full((1, 1, 1), value), f"opacity {value}")
        if albedo is None:
            raise DomainError(
                "Scene: methods.parallax.opacity: expected a number or a map, as there is no albedo map to "
                "take it from; 0.5 lets half through."
            )
        photograph, around = self.surface_maps[albedo], self.beyond(albedo)

        def make():
            image = photograph.value.expand(-1, -1, 3)
            if around is None:
                return opacity_from_photograph(image)
            go_on, blur = (
                partial(way, cancel=self.cancel) for way in (around.value.continued, around.value.smoothed)
            )
            return go_on(opacity_from_photograph(go_on(image), blur=blur))

        return self.stage("beneath", make, photograph, around)

    @cached_property
    def layer_light(self) -> Kept:
        """The light at the texels for the surface and every inner layer (1 + K, P, 3) [W/m²].

        Blurred by the depth of each; that of the surface by a texel, lest shadow edges show steps.
        """
        light, texels = self.irradiance, self.texels.value
        depths = torch.tensor([layer.depth_mm for layer in self.inner.value]).cumsum(0)
        widths = torch.cat([depths.new_tensor([self.texels_at_rest.value.texel_mm]), depths])
        blur = diffusion(texels, "uv", **self.hooks("bank"))
        return self.stage("bank", lambda: blur(light.value, widths**2), light, widths, "parallax")

    @property
    def seen_along_normals(self) -> Kept:
        """Exitance at the texels (P, 3) [W/m²], as seen from straight above each."""
        light, points = self.layer_light, self.texels.value.points

        def make():
            return self._layered(points, points.normal(self.mesh.value[0]), list(light.value))

        return self.stage("exitance", make, *self.beneath_key)

    def seen_from_camera(self) -> Callable[[Hits], Tensor]:
        """The function from camera hits to exitance (P, 3) [W/m²]."""
        texels = self.texels.value
        light = [Texture.of(texels.to_image(copy)) for copy in self.layer_light.value]

        def at(hits: Hits) -> Tensor:
            uv = hits.points.uv(texels.atlas_uv)
            return self._layered(hits.points, hits.view, [copy.at(uv) for copy in light])

        return at

    @property
    def beneath_key(self) -> tuple:
        """Everything that these layers are made from."""
        surface = self.scene.material.surface
        albedo = None if surface.albedo is None else self.surface_maps[surface.albedo]
        return self.layer_light, self.inner, self.outer_opacity, albedo, self.bump

    def normals_at(self, points: Points) -> Float[Tensor, "P 3"] | None:
        """Shading normals bent by the normal map; None without one."""
        images = {name: kept.value for name, kept in self.surface_maps.items()}
        return bumped(self.scene.material.surface, images, points, self.mesh.value[0])

    def _layered(
        self, points: Points, view: Float[Tensor, "P 3"], light: list[Tensor]
    ) -> Float[Tensor, "P 3"]:
        (mesh, _), surface = self.mesh.value, self.scene.material.surface
        frame, jacobian = points.frame(mesh, self.source_uv), points.jacobian(mesh, self.source_uv)
        bent, onward = self.normals_at(points), self.onward
        local = frame[:, 2] if bent is None else bent
        outer = torch.ones_like(light[0])
        if surface.albedo is not None:
            outer = painted(self.surface_maps[surface.albedo].value, points, mesh).expand(-1, 3)
        # mm along tangent and bitangent per unit of u and v, and back
        mm_per_uv = frame[:, :2] @ jacobian
        det = torch.linalg.det(mm_per_uv)
        sound = det.abs() > 1e-12
        a, b, c, d = mm_per_uv.flatten(1).unbind(-1)
        inverse = (
            torch.stack([d, -b, -c, a], -1).reshape(-1, 2, 2) / torch.where(sound, det, 1.0)[:, None, None]
        )
        return shade_layers(
            points.uv(self.source_uv),
            inverse * sound[:, None, None],
            (frame @ view[..., None])[..., 0],
            (frame @ local[..., None])[..., 0],
            outer,
            painted(self.outer_opacity.value, points, mesh),
            light[0],
            self.inner.value,
            light[1:],
            across=None if onward is None else partial(onward.value.at, points),
        )
