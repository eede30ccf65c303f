"""How a baked surface looks: exitance, albedo, bumps and gloss joined into what a ray sees."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch

from texsss.errors import ShapeError
from texsss.light.beneath import leaving
from texsss.light.emitters import Light
from texsss.light.sites import dot
from texsss.light.visibility import Occluder
from texsss.material import SurfaceSpec
from texsss.media.phase import schlick_k
from texsss.media.stack import Stack
from texsss.methods import MarchSpec
from texsss.numerics.sampling import Texture
from texsss.profiles.angular import Angular
from texsss.resolve import Images
from texsss.surface.curvature import curvature_at, shape_operators
from texsss.surface.mesh import Mesh
from texsss.surface.normal_map import mapped_normals
from texsss.surface.points import Points
from texsss.transport.march.gatherer import Phase
from texsss.transport.march.interior import from_stack
from texsss.transport.march.march import March
from texsss.transport.march.noise import Noise
from texsss.transport.march.planes import Planes
from texsss.types import Float, Tensor
from texsss.view.camera import Hits
from texsss.view.shade import Gloss, Sight, facing, sight

WORTH_COMPILING = 40_000  # steps of all pixels and lights; fewer are done before a loop is built


def averaged(surface: SurfaceSpec, images: Images) -> list[str]:
    """What to say of coloured maps whose mean counts."""
    named = {"roughness": surface.roughness, "specular": surface.specular}
    return [
        f"The {field} map {name} is coloured and the mean of its channels counts; name the one that holds "
        f'it: "channel" of maps.{name}, or --{field} FILE:g.'
        for field, name in named.items()
        if isinstance(name, str)
        and images[name].shape[-1] > 1
        and not bool((images[name] == images[name][..., :1]).all())
    ]


def seer(
    surface: SurfaceSpec,
    images: Images,
    mesh: Mesh,
    lights: Sequence[Light],
    *,
    eta: float,
    occluder: Occluder,
    seed: int,
) -> Callable[[Hits], Sight]:
    """The function from camera hits to all that is seen there but the scattered light.

    `images`: the maps that `surface` names.
    """
    albedo = None
    if surface.albedo is not None and surface.albedo_mode != "pre":
        colour = images[surface.albedo].expand(-1, -1, 3)
        least, most = colour.aminmax()
        colour = colour if least >= 0 and most <= 1 else colour.clamp(0, 1)
        albedo = Texture.of(colour.sqrt() if surface.albedo_mode == "both" else colour, "repeat")
    textures = {name: Texture.of(image, "repeat") for name, image in images.items()}

    def see(hits: Hits) -> Sight:
        def grey(value: float | str) -> float | Tensor:
            return painted(textures[value], hits.points, mesh).mean(-1) if isinstance(value, str) else value

        return sight(
            hits,
            mesh,
            tuple(lights),
            eta=eta,
            gloss=Gloss(grey(surface.roughness), grey(surface.specular), surface.second_lobe),
            albedo=albedo,
            normals=bumped(surface, textures, hits.points, mesh),
            occluder=occluder,
            seed=seed,
        )

    return see


def shower(
    exitance: Float[Tensor, "H W 3"] | Callable[[Hits], Tensor],
    atlas_uv: Float[Tensor, "F 3 2"],
    single: Callable[[Hits], Tensor] | None = None,
    by_angle: Angular | None = None,
    beside: Float[Tensor, "H W 3"] | None = None,
    bent: Callable[[Sight], Tensor] | None = None,
) -> Callable[[Sight], Tensor]:
    """The function from what is seen to radiance (P, 3) [W/(m² sr)], scattered light included.

    `exitance` [W/m²]: an image over the atlas, or a function of hits, before the albedo that applies after
    diffusion. `single`: radiance of light scattered once at hits, to be added. `by_angle`: how all other
    leaves; evenly when None. `beside`: an image of what leaves by its second mode [W/m²].
    `bent`: how much more leaves as the surface curves.
    """
    shown = Texture.of(exitance) if isinstance(exitance, Tensor) else exitance
    near = None if beside is None else Texture.of(beside)

    def show(seen: Sight) -> Tensor:
        hits = seen.hits
        scattered = shown.at(hits.points.uv(atlas_uv)) if isinstance(shown, Texture) else shown(hits)
        if by_angle is not None:
            scattered = scattered * by_angle.at(seen.cosine)
            if bent is not None:
                scattered = scattered * bent(seen)
            if near is not None:
                scattered = scattered + near.at(hits.points.uv(atlas_uv)) * by_angle.beside_at(seen.cosine)
        radiance = scattered * seen.gain + seen.gloss
        return radiance if single is None else radiance + single(hits)

    return show


def bent_away(mesh: Mesh, free: Float[Tensor, " C"]) -> Callable[[Sight], Tensor]:
    """The function from what is seen to how much more leaves as the surface curves, see `leaving`."""
    operators = shape_operators(mesh)

    def bent(seen: Sight) -> Tensor:
        points, view = seen.hits.points, seen.hits.view
        curvature = curvature_at(points, mesh, operators)
        return leaving(dot(points.normal(mesh), view), view, points.normal(mesh), curvature, free)

    return bent


def scattered_once(
    stack: Stack,
    mesh: Mesh,
    planes: Planes,
    lights: Sequence[Light],
    *,
    atlas_uv: Float[Tensor, "F 3 2"],
    bumps: Callable[[Points], Tensor | None],
    scale: Float[Tensor, "H W 3"] | None,
    thickness: Float[Tensor, "H W 1"] | None = None,
    how: MarchSpec,
    grain: Float[Tensor, "H W C"] | None = None,
    phase: Phase = "henyey-greenstein",
    entered: Sequence[Tensor | None] = (),
    pixels: int,
    samples: int,
    seed: int,
    **options: Any,
) -> Callable[[Hits], Tensor]:
    """The function from camera hits to the radiance (P, 3) of light scattered once [W/(m² sr)].

    `entered`: per light, an image alike of what enters of it [W/m²] where the march takes that from there.
    `bumps`: shading normals at points where they are not those of the mesh. `scale`: an image over the atlas
    that multiplies it, where profiles are normalised. `thickness`: of the object [mm], an image alike, where
    the profiles end with it. `grain`: the map of its noise. `phase`: of the media's mean cosines. `pixels`:
    of the picture; all its rays are marched by the loop in C++ if that is worth building. `options`: the
    method and occluder of `March`, and how often it samples lights. Every ray of a pixel draws numbers of
    its own from `seed`.
    """
    check_deepest(how, stack)
    interior = from_stack(stack)
    if how.deepest_mm is not None:
        interior = replace(
            interior, depth=torch.minimum(interior.depth, interior.depth.new_tensor(how.deepest_mm))
        )
    if phase == "schlick":
        interior = replace(interior, g=schlick_k(interior.g))
    noise = None
    if how.noise or how.noise_uv:
        noise = Noise(uv=how.noise_uv, start=how.noise, texture=None if grain is None else grain.mean(-1))
    lasting = None if scale is None else Texture.of(scale)
    thick = None if thickness is None else Texture.of(thickness)
    known = [None if light is None else Texture.of(light) for light in entered]
    march = March(
        mesh,
        planes,
        interior,
        lights,
        uv=mesh.source_uv,
        noise=noise,
        samples=samples,
        phase=phase,
        **options,
    )
    worth = pixels * samples * len(lights) >= WORTH_COMPILING

    def once(hits: Hits) -> Tensor:
        bent, uv = bumps(hits.points), hits.points.uv(atlas_uv)
        light = march(
            hits.points,
            hits.view,
            normals=None if bent is None else facing(bent, hits.view),
            thickness=None if thick is None else thick.at(uv)[:, 0],
            entered=[None if here is None else here.at(uv) for here in known] or None,
            compiled=worth,
            seed=hits.seed(seed),
        )
        return light if lasting is None else light * lasting.at(uv)

    return once


def check_deepest(how: MarchSpec, stack: Stack) -> None:
    """Raises ShapeError: when as many depths are given as the stack has no boundaries."""
    wanted = how.deepest_mm
    boundaries = len(stack.layers) - (stack.layers[-1].thickness is None)
    if isinstance(wanted, tuple) and len(wanted) != boundaries:
        raise ShapeError(
            f"methods.march.deepest_mm: expected one number, or one for each of {boundaries} "
            f"boundaries, got {len(wanted)}; add or drop some."
        )


def tinted(
    single: Callable[[Hits], Tensor], albedo: Float[Tensor, "H W C"], mesh: Mesh
) -> Callable[[Hits], Tensor]:
    """`single` times the albedo at the hits."""
    image = Texture.of(albedo, "repeat")
    return lambda hits: single(hits) * painted(image, hits.points, mesh)


def share_of(total: Float[Tensor, "*B C"]) -> Float[Tensor, "*B C"]:
    """1 / total, and 0 where nothing comes back."""
    some = total > 0
    return torch.where(some, 1 / torch.where(some, total, 1), 0)


def painted(image: Float[Tensor, "H W C"] | Texture, points: Points, mesh: Mesh) -> Float[Tensor, "P C"]:
    """A map of values 0..1 in the author's texture coordinates at points of the surface; it tiles."""
    assert mesh.source_uv is not None, "the pipeline asks for texture coordinates first"
    return Texture.of(image, "repeat").at(points.uv(mesh.source_uv)).clamp(0, 1)


def bumped(
    surface: SurfaceSpec, images: Mapping[str, Tensor | Texture], points: Points, mesh: Mesh
) -> Float[Tensor, "P 3"] | None:
    """Shading normals bent by the surface's normal map; None without one."""
    if surface.normal is None:
        return None
    return mapped_normals(points, mesh, images[surface.normal], y_up=surface.normal_y == "+y")


def map_names(surface: SurfaceSpec) -> list[str]:
    """Names of the maps that a surface refers to."""
    named = (surface.albedo, surface.normal, surface.roughness, surface.specular)
    return sorted({name for name in named if isinstance(name, str)})
