"""Shading normals from a tangent-space normal map."""

from texsss.errors import DomainError, ShapeError
from texsss.numerics.sampling import Texture
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Float, Tensor, unit

UNDERSHOOT = 0.02  # below 0, which resampling leaves behind
PROBES = 64  # along an edge, that tell colours from grey before all are looked at


def mapped_normals(
    points: Points,
    mesh: Mesh,
    image: Float[Tensor, "H W C"] | Texture,
    *,
    y_up: bool = True,
    strength: float = 1.0,
) -> Float[Tensor, "P 3"]:
    """Unit shading normals at `points`, bent by a normal map.

    `image`: values 0..1 as stored (read as linear data), over the author's uv, tiled; .5 .5 1 is
    straight. `y_up`: green leans upwards in the texture (+Y, OpenGL), else downwards (-Y, DirectX).
    `strength` scales the slope. Tangents follow the author's uv per face, mirrored charts included.
    Differentiable in image. Raises ShapeError: when the mesh has no uv, or the image is grey.
    Raises DomainError: when values at the points are negative.
    """
    if mesh.source_uv is None:
        raise ShapeError(
            f"normal map: expected texture coordinates, got none in {mesh.name}; unwrap the mesh."
        )
    texture = Texture.of(image, "repeat")
    if texture.planes.shape[1] < 3 or _grey(texture.planes[0]):
        raise ShapeError(
            "normal map: expected red, green and blue that differ, got grey; set its channel to rgb, and "
            "make a normal map of a height map first."
        )
    values = texture.at(points.uv(mesh.source_uv))[:, :3]
    if len(values) and float(values.detach().min()) < -UNDERSHOOT:
        raise DomainError(
            "normal map: expected values 0..1, got negative ones, as renderers store normals of the world; "
            "bake the normals in tangent space, where straight is .5 .5 1."
        )
    tangent, bitangent, normal = points.frame(mesh, mesh.source_uv).unbind(-2)
    x, y, z = (2 * values - 1).unbind(-1)
    # v runs down, so does the bitangent
    down = -y if y_up else y
    bent = (strength * x)[:, None] * tangent + (strength * down)[:, None] * bitangent
    return unit(bent + z.clamp_min(0.05)[:, None] * normal)


def _grey(planes: Float[Tensor, "C h w"]) -> bool:
    """Whether all channels agree everywhere, which no directions do: heights saved in three channels."""
    step = max(1, max(planes.shape[1:]) // PROBES)
    return all(bool((p[1:3] == p[:1]).all()) for p in (planes[:, ::step, ::step].detach(), planes.detach()))
