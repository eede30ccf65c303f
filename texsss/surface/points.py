"""Points on a mesh as flat lists: texels of an atlas and camera hits are the same type."""

from dataclasses import dataclass, replace
from functools import cached_property

import torch

from texsss.errors import ShapeError
from texsss.surface.dilate import nearest_filled
from texsss.surface.mesh import Mesh
from texsss.types import Bool, Float, Int, Tensor, unit


@dataclass(frozen=True, eq=False)
class Points:
    """P points on the faces of a mesh.

    `face` (P,): index of the face. `bary` (P, 3): barycentric weights of its corners; a gutter point
    lies outside its face and has a negative one. `texel` (P,): row-major index i·W + j of the texel
    of an atlas, None for camera hits. Everything else is derived from the mesh, so that deforming
    geometry leaves the list as it is.
    """

    face: Int[Tensor, " P"]
    bary: Float[Tensor, "P 3"]
    texel: Int[Tensor, " P"] | None = None

    def __post_init__(self):
        if self.face.shape[0] != self.bary.shape[0]:
            raise ShapeError(
                f"Points: expected as many faces as barycentrics, got {self.face.shape[0]} and "
                f"{self.bary.shape[0]}; build both from one list."
            )

    def __len__(self) -> int:
        return self.face.shape[0]

    def __getitem__(self, rows: slice | Tensor) -> "Points":
        texel = None if self.texel is None else self.texel[rows]
        return replace(self, face=self.face[rows], bary=self.bary[rows], texel=texel)

    def interpolate(self, corners: Float[Tensor, "F 3 D"]) -> Float[Tensor, "P D"]:
        """Values given per face corner, at the points. Differentiable in `corners`."""
        # face is int32 to save memory; indexing wants int64
        return torch.einsum("pc,pcd->pd", self.bary.to(corners.dtype), corners[self.face.long()])

    def position(self, mesh: Mesh) -> Float[Tensor, "P 3"]:
        """Positions [mm]."""
        return self.interpolate(mesh.corners)

    def normal(self, mesh: Mesh) -> Float[Tensor, "P 3"]:
        """Unit shading normals, interpolated over the face; beyond it, as on its rim."""
        inside = self.bary.clamp_min(0)
        inside = replace(self, bary=inside / inside.sum(-1, keepdim=True))
        return unit(inside.interpolate(mesh.corner_normals))

    def face_normal(self, mesh: Mesh) -> Float[Tensor, "P 3"]:
        """Unit normals of the faces."""
        return mesh.face_normals[self.face.long()]

    def uv(self, uv: Float[Tensor, "F 3 2"]) -> Float[Tensor, "P 2"]:
        """Texture coordinates in the set `uv` (an atlas' or the author's)."""
        return self.interpolate(uv)

    def jacobian(self, mesh: Mesh, uv: Float[Tensor, "F 3 2"]) -> Float[Tensor, "P 3 2"]:
        """∂position/∂uv of the face [mm per unit of uv]; 0 where the face has no area in uv."""
        return face_jacobian(mesh, uv)[self.face.long()]

    def frame(self, mesh: Mesh, uv: Float[Tensor, "F 3 2"]) -> Float[Tensor, "P 3 3"]:
        """Orthonormal rows T (along u), B (along v), N (shading normal).

        They follow uv: in mirrored charts the frame is left-handed, as normal maps expect. Where uv
        has no area, T is any direction in the surface. v runs down, so B does too.
        """
        normal = self.normal(mesh)
        jacobian = self.jacobian(mesh, uv)
        along_u, along_v = jacobian[..., 0], jacobian[..., 1]
        along_u = unit(along_u)
        tangent = along_u - normal * (along_u * normal).sum(-1, keepdim=True)
        lost = torch.linalg.vector_norm(tangent, dim=-1, keepdim=True) < 1e-4
        tangent = unit(torch.where(lost, _perpendicular(normal), tangent))
        bitangent = torch.linalg.cross(normal, tangent)
        side = (bitangent * along_v).sum(-1, keepdim=True)
        bitangent = torch.where(side < 0, -bitangent, bitangent)
        return torch.stack([tangent, bitangent, normal], -2)

    def metric(self, mesh: Mesh, uv: Float[Tensor, "F 3 2"]) -> Float[Tensor, "P 2 2"]:
        """First fundamental form of the parametrisation [mm² per unit of uv²]."""
        jacobian = self.jacobian(mesh, uv)
        return jacobian.transpose(-1, -2) @ jacobian


@dataclass(frozen=True, eq=False)
class TexelMaps:
    """The texels of an atlas that a mesh covers, then its gutter, as one flat list.

    `points` (P): covered texels in row-major order, then gutter texels, which are evaluated so that
    bilinear look-ups never see an empty texel, but have no area. `atlas_uv` (F, 3, 2): unique
    texture coordinates in the unit square, v down. `size` is (H, W).
    """

    mesh: Mesh
    atlas_uv: Float[Tensor, "F 3 2"]
    points: Points
    covered: Bool[Tensor, " P"]
    size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def index(self) -> Int[Tensor, " P"]:
        """Row-major index i·W + j of every texel, int64."""
        assert self.points.texel is not None, "texels of an atlas know their place"
        return self.points.texel.long()

    @property
    def covered_count(self) -> int:
        """How many of the points are covered texels; they come first."""
        return int(self.covered.sum())

    @cached_property
    def area(self) -> Float[Tensor, " P"]:
        """Surface area that each texel stands for [mm²]; 0 in the gutter."""
        jacobian = face_jacobian(self.mesh, self.atlas_uv)
        cross = torch.linalg.cross(jacobian[..., 0], jacobian[..., 1])
        per_uv = torch.linalg.vector_norm(cross, dim=-1)
        height, width = self.size
        return per_uv[self.points.face.long()] / (height * width) * self.covered

    @cached_property
    def nearest(self) -> Int[Tensor, "H W"]:
        """Row-major index of the texel, covered or gutter, nearest to each place of the square."""
        height, width = self.size
        filled = torch.zeros(height * width, dtype=torch.bool, device=self.index.device)
        filled[self.index] = True
        return nearest_filled(filled.reshape(height, width))

    @cached_property
    def texel_mm(self) -> float:
        """Typical edge of a texel on the surface [mm]: the root of the median area; 0 without any."""
        real = self.area[self.area > 0].detach()
        return float(real.median().sqrt()) if real.numel() else 0.0

    def to_image(self, values: Float[Tensor, "P C"], fill: float = 0.0) -> Float[Tensor, "H W C"]:
        """Values laid out as an image, `fill` in empty texels. Differentiable in `values`."""
        height, width = self.size
        image = values.new_full((height * width, values.shape[-1]), fill)
        return image.index_copy(0, self.index, values).reshape(height, width, -1)

    def from_image(self, image: Float[Tensor, "H W C"]) -> Float[Tensor, "P C"]:
        """Values of an image at the points."""
        return image.reshape(-1, image.shape[-1]).index_select(0, self.index)

    def moved(self, vertices: Float[Tensor, "V 3"]) -> "TexelMaps":
        """The same texels on the deformed mesh [mm]."""
        return replace(self, mesh=self.mesh.moved(vertices))


def face_jacobian(mesh: Mesh, uv: Float[Tensor, "F 3 2"]) -> Float[Tensor, "F 3 2"]:
    """∂position/∂uv of every face [mm per unit of uv]; 0 where the face has no area in uv."""
    a, b, c = mesh.corners.unbind(1)
    edges = torch.stack([b - a, c - a], -1).double()  # (F, 3, 2)
    # float32 uv differ exactly in float64: slivers keep their area's digits
    u, v, w = uv.double().unbind(1)
    (p, q), (r, s) = (v - u).unbind(-1), (w - u).unbind(-1)
    det = p * s - q * r
    sound = det.abs() > 1e-20
    inverse = torch.stack([torch.stack([s, -r], -1), torch.stack([-q, p], -1)], -2)
    inverse = inverse / torch.where(sound, det, torch.ones_like(det))[:, None, None]
    return torch.where(sound[:, None, None], edges @ inverse, torch.zeros_like(edges)).to(mesh.vertices.dtype)


def _perpendicular(normal: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
    """Some direction across each normal."""
    x, y = normal.new_tensor([1.0, 0, 0]), normal.new_tensor([0, 1.0, 0])
    return torch.linalg.cross(normal, torch.where(normal[:, :1].abs() < 0.9, x, y))
