"""How a baked surface looks: exitance, albedo, bumps and gloss joined into what a ray sees."""

from collections.abc import Callable, Sequence

from texsss.light.emitters import Light
from texsss.light.visibility import Occluder
from texsss.numerics.sampling import bilinear
from texsss.resolve import Images
from texsss.specs import SurfaceSpec
from texsss.surface.mesh import Mesh
from texsss.surface.normal_map import mapped_normals
from texsss.surface.points import Points
from texsss.types import Float, Tensor
from texsss.view.camera import Hits
from texsss.view.shade import Gloss, shade


def shader(
    surface: SurfaceSpec,
    images: Images,
    mesh: Mesh,
    atlas_uv: Float[Tensor, "F 3 2"],
    exitance: Float[Tensor, "H W 3"],
    lights: Sequence[Light],
    *,
    eta: float,
    occluder: Occluder,
    seed: int,
) -> Callable[[Hits], Tensor]:
    """The function from camera hits to radiance (P, 3) [W/(m² sr)] that `view.picture` asks for.

    `exitance` [W/m²]: an image over the atlas, before the albedo that applies after diffusion.
    `images`: the maps that `surface` names.
    """
    albedo = None
    if surface.albedo is not None and surface.albedo_mode != "pre":
        colour = images[surface.albedo].clamp(0, 1).expand(-1, -1, 3)
        albedo = colour.sqrt() if surface.albedo_mode == "both" else colour

    def seen(hits: Hits) -> Tensor:
        def grey(value: float | str) -> float | Tensor:
            return painted(images[value], hits.points, mesh).mean(-1) if isinstance(value, str) else value

        return shade(
            hits,
            mesh,
            atlas_uv,
            exitance,
            tuple(lights),
            eta=eta,
            gloss=Gloss(grey(surface.roughness), grey(surface.specular), surface.second_lobe),
            albedo=albedo,
            normals=bumped(surface, images, hits.points, mesh),
            occluder=occluder,
            seed=seed,
        )

    return seen


def painted(image: Float[Tensor, "H W C"], points: Points, mesh: Mesh) -> Float[Tensor, "P C"]:
    """A map of values 0..1 in the author's texture coordinates at points of the surface; it tiles."""
    assert mesh.source_uv is not None, "the pipeline asks for texture coordinates first"
    return bilinear(image, points.uv(mesh.source_uv), wrap="repeat").clamp(0, 1)


def bumped(surface: SurfaceSpec, images: Images, points: Points, mesh: Mesh) -> Float[Tensor, "P 3"] | None:
    """Shading normals bent by the surface's normal map; None without one."""
    if surface.normal is None:
        return None
    return mapped_normals(points, mesh, images[surface.normal][..., :3], y_up=surface.normal_y == "+y")


def map_names(surface: SurfaceSpec) -> list[str]:
    """Names of the maps that a surface refers to."""
    named = (surface.albedo, surface.normal, surface.roughness, surface.specular)
    return sorted({name for name in named if isinstance(name, str)})
