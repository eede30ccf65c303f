"""Shading normals from a tangent-space normal map."""

from texsss.errors import ShapeError
from texsss.numerics.sampling import Texture
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Float, Tensor, unit


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
    Differentiable in image. Raises ShapeError: when the mesh has no uv, or the image not three channels.
    """
    if mesh.source_uv is None:
        raise ShapeError(
            f"normal map: expected texture coordinates, got none in {mesh.name}; unwrap the mesh."
        )
    texture = Texture.of(image, "repeat")
    if texture.planes.shape[1] < 3:
        raise ShapeError(
            f"normal map: expected red, green and blue, got {texture.planes.shape[1]} channel; set its "
            "channel to rgb, and make a normal map of a height map first."
        )
    tangent, bitangent, normal = points.frame(mesh, mesh.source_uv).unbind(-2)
    x, y, z = (2 * texture.at(points.uv(mesh.source_uv))[:, :3] - 1).unbind(-1)
    # v runs down, so does the bitangent
    down = -y if y_up else y
    bent = (strength * x)[:, None] * tangent + (strength * down)[:, None] * bitangent
    return unit(bent + z.clamp_min(0.05)[:, None] * normal)
