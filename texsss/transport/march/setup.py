"""What the march needs to know of points, eye and lights, as a handful of scalars each.

Within the material everything is measured along the refracted view ray, M(t) = P - t ω_o, t in mm:
positions become texels of the maps, directions their products with the two normals.
"""

import math
from dataclasses import dataclass, replace

import torch

from texsss.light.emitters import LightSamples
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points, face_jacobian
from texsss.transport.march.interior import Interior
from texsss.transport.march.planes import EPSILON, Planes
from texsss.types import Bool, Float, Tensor, unit

LEAST_VIEW_COS = 1e-3  # of the view ray to the fitted plane: grazing rays end somewhere
PAINTED = 2.5  # times as far as the mean extinction of a painted last layer asks for: its clear places go on
BELOW = 3.0  # deepest boundaries: how far into an infinite layer
BEYOND = 1e-4  # of the deepest boundary: how much further rays go that cross it
THINNEST_MM = 1e-6
OPAQUE = 16.0  # optical depth beyond which float32 sees nothing
KNOT_RANGE = (0.05, 9.0)  # how strongly knots may crowd towards the surface


@dataclass(frozen=True, eq=False)
class Reach:
    """How far the march goes into an interior: `depth_mm` deep, never beyond `longest_mm` along a ray.

    `rate` [1/mm] is the mean extinction down there, which spaces the knots of exact steps.
    """

    depth_mm: float
    longest_mm: float
    rate: float


def reach(interior: Interior, across: bool = False) -> Reach:
    """The reach of an interior: its deepest boundary, or some mean free paths of an infinite layer.

    `across`: rays cross the deepest boundary, by more than rounding, so that gradients see that they do.
    """
    extinction = interior.sigma_t.detach().reshape(-1, interior.layers, interior.sigma_t.shape[-1])
    # painted extinctions count by their mean: one clear texel must not space the steps of all
    typical, least = extinction.mean(0).amin(-1), extinction.amin((0, 2))
    boundary = interior.depth.detach()
    known = thicknesses(boundary).mean((0, 1))
    deepest = float(boundary.amax()) if boundary.numel() else 0.0
    below = 0.0
    if interior.bottomless and float(typical[-1]) > 0:
        fades = -math.log(EPSILON)
        below = fades * PAINTED / float(typical[-1])
        if float(least[-1]) > 0:
            below = min(below, fades / float(least[-1]))
        if deepest > 0:
            # beneath all that varies the tail is exact
            below = min(below, BELOW * deepest)
    depth = deepest + below
    within = torch.cat([known, known.new_tensor([depth - float(known.sum())])])[: interior.layers]
    rate = float((typical * within).sum() / within.sum().clamp_min(1e-9))
    longest = OPAQUE / float(least.amin()) if float(least.amin()) > 0 else math.inf
    # a surface without anything beneath still needs a step that is not zero
    return Reach(max(depth * (1 + BEYOND if across else 1), 1e-9), longest, rate)


def thicknesses(depth: Float[Tensor, "H W B"]) -> Float[Tensor, "H W B"]:
    """Thickness of the layer above each boundary [mm]."""
    return torch.diff(depth, dim=-1, prepend=torch.zeros_like(depth[..., :1]))


def bounded(interior: Interior) -> Interior:
    """The interior with every layer only as thick as to be opaque in all channels.

    Nothing comes out of what lies deeper, but one deep place would space the steps everywhere.
    """
    if interior.depth.shape[-1] == 0:
        return interior
    extinction = interior.sigma_t.detach().movedim(-2, 0).flatten(1)[: interior.depth.shape[-1]]
    most, thickness = OPAQUE / extinction.amin(1).clamp_min(1e-30), thicknesses(interior.depth)
    if not bool((thickness.detach() > most).any()):
        return interior
    return replace(interior, depth=torch.minimum(thickness, most).cumsum(-1))


class Surface:
    """A mesh, its planes and its texture coordinates, packed per face for one gather per point."""

    def __init__(self, mesh: Mesh, planes: Planes, uv: Float[Tensor, "F 3 2"]):
        home = mesh.vertices
        faces = mesh.faces.long()
        corner = [mesh.corners, mesh.corner_normals, planes.normal.to(home)[faces]]
        corner += [planes.offset.to(home)[faces][..., None], uv.to(home)]
        self.corner = torch.cat(corner, -1)  # (F, 3, 12)
        along_u, along_v = face_jacobian(mesh, uv.to(home)).unbind(-1)
        # uv per mm along the tangent frame: the inverse of the triangular factor of the Jacobian
        first = torch.linalg.vector_norm(along_u, dim=-1)
        sound = first > 1e-12
        safe = torch.where(sound, first, torch.ones_like(first))
        skew = (along_u * along_v).sum(-1) / safe
        across = torch.linalg.cross(mesh.face_normals, along_u / safe[:, None])
        second = (across * along_v).sum(-1)
        sound = sound & (second.abs() > 1e-12)
        second = torch.where(sound, second, torch.ones_like(second))
        per_mm = torch.stack([1 / safe, -skew / (safe * second), 1 / second], -1)
        per_mm = torch.where(sound[:, None], per_mm, torch.zeros_like(per_mm))
        self.face = torch.cat([along_u, mesh.face_normals, per_mm], -1)  # (F, 9)

    def at(self, points: Points) -> "Sites":
        """The surface at some points."""
        face = points.face.long()
        bary = points.bary.to(self.corner.dtype)
        corner, own = self.corner[face], self.face[face]
        blended = bary[:, :1] * corner[:, 0] + bary[:, 1:2] * corner[:, 1] + bary[:, 2:] * corner[:, 2]
        normal = unit(blended[:, 3:6])
        along_u = own[:, :3]
        tangent = along_u - normal * dot(along_u, normal)[:, None]
        lost = torch.linalg.vector_norm(tangent, dim=-1, keepdim=True) < 1e-12
        # where uv has no extent nothing is looked up along the tangent, so any will do
        tangent = unit(torch.where(lost, torch.ones_like(tangent), tangent))
        return Sites(
            position=blended[:, :3],
            normal=normal,
            face_normal=own[:, 3:6],
            plane_normal=unit(blended[:, 6:9]),
            offset=blended[:, 9],
            uv=blended[:, 10:12],
            tangent=tangent,
            bitangent=torch.linalg.cross(normal, tangent),
            per_mm=own[:, 6:9],
        )


@dataclass(frozen=True, eq=False)
class Sites:
    """The surface at P points; `uv_of` turns directions into texture coordinates per mm."""

    position: Float[Tensor, "P 3"]
    normal: Float[Tensor, "P 3"]
    face_normal: Float[Tensor, "P 3"]
    plane_normal: Float[Tensor, "P 3"]
    offset: Float[Tensor, " P"]
    uv: Float[Tensor, "P 2"]
    tangent: Float[Tensor, "P 3"]
    bitangent: Float[Tensor, "P 3"]
    per_mm: Float[Tensor, "P 3"]

    def uv_of(self, direction: Float[Tensor, "P 3"]) -> tuple[Float[Tensor, " P"], Float[Tensor, " P"]]:
        """Change of texture coordinates per mm along `direction`."""
        s, t = dot(direction, self.tangent), dot(direction, self.bitangent)
        return self.per_mm[:, 0] * s + self.per_mm[:, 1] * t, self.per_mm[:, 2] * t


@dataclass(frozen=True, eq=False)
class Rays:
    """View rays of P points inside the material.

    `direction` (P, 3): ω_o, towards the surface. `leaves` (P,): radiance outside per radiance at the
    surface inside; 0 where the eye is behind the surface. `scalars` (11, P): texel x, y of the point;
    texels per mm down the ray, x and y; length; ω_o·N_P; ω_o·NS; plane offset; N_P·NS; 1 / fraction
    of the ray at which entry visibility is that of its second sample; 1 where an infinite last layer goes
    on beyond the ray, 0 where the object ends.
    """

    direction: Float[Tensor, "P 3"]
    leaves: Float[Tensor, " P"]
    scalars: Float[Tensor, "11 P"]


def view_rays(
    sites: Sites,
    towards_eye: Float[Tensor, "P 3"],
    eta: float,
    far: Reach,
    size: tuple[int, int],
    shift: Float[Tensor, "P 2"] | None,
    thickness: Float[Tensor, " P"] | None = None,
) -> Rays:
    """Rays from the points down into the material; `shift` moves their texture coordinates [uv].

    They end where the object does, if it is no thicker than `thickness` [mm].
    """
    height, width = size
    facing = dot(towards_eye, sites.normal)
    seen = dot(towards_eye, sites.face_normal) > 0
    inner = refracted(towards_eye, sites.normal, facing, eta)
    leaves = fresnel.transmittance(facing.clamp_min(0), eta) / eta**2
    plane_cos = dot(inner, sites.plane_normal).clamp_min(LEAST_VIEW_COS)
    length = (far.depth_mm / plane_cos).clamp_max(far.longest_mm)
    goes_on = torch.ones_like(length)
    if thickness is not None:
        ends = thickness.clamp_min(THINNEST_MM) / plane_cos
        goes_on, length = (ends >= length).to(length), torch.minimum(length, ends)
    along_u, along_v = sites.uv_of(inner)
    uv = sites.uv if shift is None else sites.uv + shift
    nearer = (far.rate * length).clamp_min(1.0)
    scalars = [
        uv[:, 0] * width - 0.5,
        uv[:, 1] * height - 0.5,
        -along_u * width,
        -along_v * height,
        length,
        dot(inner, sites.normal),
        plane_cos,
        sites.offset,
        dot(sites.normal, sites.plane_normal),
        nearer,
        goes_on,
    ]
    return Rays(inner, torch.where(seen, leaves, torch.zeros_like(leaves)), torch.stack(scalars))


def light_scalars(
    sites: Sites,
    rays: Rays,
    light: LightSamples,
    eta: float,
    size: tuple[int, int],
    occluder: Occluder | None = None,
    origin: Float[Tensor, "P 3"] | None = None,
    weight: float = 1.0,
) -> Float[Tensor, "11 P"]:
    """One light sample as seen from inside.

    Its refracted direction dotted with N_P and NS; texels per mm along it, x and y; its product with
    ω_o; 1 / distance; visibility at P and at the entry point of light scattered one mean free path
    down; irradiance (3) facing the refracted direction. `origin` is where shadow rays start, at P or
    just above it. `weight`: of the sample among those of its light.
    """
    height, width = size
    facing = dot(light.direction, sites.normal)
    inner = refracted(light.direction, sites.normal, facing, eta)
    nearness = 1 / light.distance / eta  # refraction makes near lights look farther away
    entering = light.irradiance
    if eta != 1:
        # flux through the surface is kept: E μ F_t = E' μ'
        share = fresnel.transmittance(facing.clamp_min(0), eta) * facing.clamp_min(0)
        entering = entering * (share / dot(inner, sites.normal).clamp_min(1e-6))[:, None]
    along_u, along_v = sites.uv_of(inner)
    scalars = [
        dot(inner, sites.normal),
        dot(inner, sites.plane_normal),
        along_u * width,
        along_v * height,
        dot(inner, rays.direction),
        nearness,
        *_visibility(sites, rays, light, inner, occluder, origin),
        *(entering * weight).unbind(1),
    ]
    return torch.stack(scalars)


def knots(length: Float[Tensor, " P"], count: int, rate: float) -> Float[Tensor, "N P"]:
    """Fractions of the ray at which its `count` exact steps meet, (count + 1, P): dense where light is."""
    beta = (length * rate).clamp(*KNOT_RANGE)
    share = torch.arange(count + 1, dtype=length.dtype, device=length.device)[:, None] / count
    inner = -torch.log1p(-share[:-1] * -torch.expm1(-beta)) / beta
    return torch.cat([inner, torch.ones_like(inner[:1])])


def refracted(
    direction: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], facing: Float[Tensor, " P"], eta: float
) -> Float[Tensor, "P 3"]:
    """What `direction`, outside and away from the surface, bends to inside; `facing` is its cosine."""
    if eta == 1:
        return direction
    cosine = facing.clamp_min(0)
    within = torch.sqrt(1 - (1 - cosine * cosine) / eta**2)
    # light from below the horizon does not enter; it is bent as if from the horizon
    below = (facing < 0)[:, None]
    flat = direction - normal * facing[:, None]
    along = torch.where(below, unit(torch.where(below, flat, direction)), flat)
    return along / eta + normal * within[:, None]


def dot(a: Float[Tensor, "P 3"], b: Float[Tensor, "P 3"]) -> Float[Tensor, " P"]:
    """Scalar products, written out: several times faster than a sum over three."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _visibility(
    sites: Sites,
    rays: Rays,
    light: LightSamples,
    inner: Float[Tensor, "P 3"],
    occluder: Occluder | None,
    origin: Float[Tensor, "P 3"] | None,
) -> tuple[Float[Tensor, " P"], Float[Tensor, " P"]]:
    """Whether light arrives at P and at the entry point of light scattered one mean free path down."""
    whole = torch.ones_like(sites.offset)
    if occluder is None:
        return whole, whole
    start = sites.position if origin is None else origin
    first = _free(occluder, sites, start, sites.face_normal, light, dot(light.direction, sites.normal) > 0)
    length, nearer = rays.scalars[4], rays.scalars[9]
    cosine = dot(inner, sites.plane_normal)
    # K' - P for a flat surface: down the view ray, up along the light
    depth = length / nearer
    up = depth * rays.scalars[6] / cosine.clamp_min(0.03)
    aside = inner * up[:, None] - rays.direction * depth[:, None]
    apart = torch.linalg.vector_norm(aside, dim=-1, keepdim=True)
    # the real surface may lie above the plane by a share of the distance
    lifted = start + aside + 0.5 * apart * sites.plane_normal
    second = _free(occluder, sites, lifted, sites.plane_normal, light, cosine > 0)
    return first, second


def _free(
    occluder: Occluder,
    sites: Sites,
    origin: Float[Tensor, "P 3"],
    normal: Float[Tensor, "P 3"],
    light: LightSamples,
    lit: Bool[Tensor, " P"],
) -> Float[Tensor, " P"]:
    """1 where the light reaches `origin`, else 0; rays are traced only where it is `lit`."""
    rows = lit.nonzero()[:, 0]
    gap = origin[rows] - sites.position[rows]
    # the light's distance is known from P
    distance = light.distance[rows] - dot(gap, light.direction[rows])
    hidden = occluder.occluded(
        origin[rows], light.direction[rows], distance.clamp_min(0), normals=normal[rows]
    )
    return torch.zeros_like(sites.offset).index_put((rows,), (~hidden).to(sites.offset.dtype))
