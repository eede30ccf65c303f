"""A triangle mesh in millimetres, with the author's texture coordinates per corner."""

from dataclasses import dataclass, replace
from functools import cached_property

import torch

from texsss.errors import DomainError, ShapeError
from texsss.types import Float, Int, Tensor, chunks, unit

CREASE_COS = 0.5  # faces that meet at more than 60° keep a hard edge
WITHIN_COS = 0.867  # faces all within 29.9° of their mean are within 60° of each other
MAX_VALENCE = 256  # pairs around a vertex grow with the square of its faces
CHUNK_CORNERS = 1 << 19  # corners whose pairs are held at once


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with shared vertices [mm].

    `vertices` (V, 3): positions, merged wherever they coincide, so that normals and neighbours
    cross UV seams. `faces` (F, 3): indices into them, counter-clockwise seen from outside.
    `source_uv` (F, 3, 2): the author's texture coordinates per face corner, v down; they may tile,
    overlap or mirror, and are None when the file has none. `source_vertex` (V,): the vertex of the file
    that each one is, None for meshes from elsewhere.
    Raises ShapeError or DomainError: when shapes, indices or values cannot be a surface.
    """

    vertices: Float[Tensor, "V 3"]
    faces: Int[Tensor, "F 3"]
    source_uv: Float[Tensor, "F 3 2"] | None = None
    name: str = "mesh"
    source_vertex: Int[Tensor, " V"] | None = None

    def __post_init__(self):
        if self.faces.shape[0] == 0:
            raise ShapeError(f"Mesh: expected a triangle or more, got none in {self.name}; check the file.")
        if self.source_uv is not None and self.source_uv.shape[0] != self.faces.shape[0]:
            raise ShapeError(
                f"Mesh: expected texture coordinates for {self.faces.shape[0]} faces, got "
                f"{self.source_uv.shape[0]} in {self.name}; pass one uv per face corner."
            )
        low, high = int(self.faces.min()), int(self.faces.max())
        if low < 0 or high >= self.vertices.shape[0]:
            raise DomainError(
                f"Mesh: expected vertex indices in 0..{self.vertices.shape[0] - 1}, got {low}..{high} "
                f"in {self.name}; the file is damaged, export it again."
            )
        if not bool(torch.isfinite(self.vertices).all()):
            raise DomainError(f"Mesh: expected finite vertices, got NaN or infinity in {self.name}; repair.")
        if self.source_uv is not None and not bool(torch.isfinite(self.source_uv).all()):
            raise DomainError(
                f"Mesh: expected finite texture coordinates, got NaN or infinity in {self.name}; "
                "unwrap it anew."
            )
        if not self.height_mm > 0 and not bool((self.extent > 0).any()):
            raise DomainError(f"Mesh: expected an extent above zero, got a single point in {self.name}.")

    @cached_property
    def extent(self) -> Float[Tensor, "3"]:
        """Size of the axis-aligned box [mm]."""
        return (self.vertices.amax(0) - self.vertices.amin(0)).detach()

    @property
    def height_mm(self) -> float:
        """Size along y [mm]."""
        return float(self.extent[1])

    @property
    def diagonal_mm(self) -> float:
        """Length of the box's diagonal [mm]."""
        return float(torch.linalg.vector_norm(self.extent))

    @cached_property
    def corners(self) -> Float[Tensor, "F 3 3"]:
        """Positions of the corners of every face [mm]."""
        return self.vertices[self.faces]

    @cached_property
    def _scaled_cross(self) -> tuple[Float[Tensor, "F 3"], Float[Tensor, " F"]]:
        """Cross product of two edges of each face in units of its longest side, and that side [mm].

        So that squares of tiny faces do not underflow in float32.
        """
        a, b, c = self.corners.unbind(1)
        side = torch.stack([b - a, c - a]).detach().abs().amax((0, -1)).clamp_min(1e-30)
        return torch.linalg.cross((b - a) / side[:, None], (c - a) / side[:, None]), side

    @cached_property
    def face_area(self) -> Float[Tensor, " F"]:
        """Area of every face [mm²]."""
        cross, side = self._scaled_cross
        return torch.linalg.vector_norm(cross, dim=-1) / 2 * side**2

    @cached_property
    def face_normals(self) -> Float[Tensor, "F 3"]:
        """Unit normal of every face; 0 for faces without area."""
        return unit(self._scaled_cross[0])

    @cached_property
    def corner_normals(self) -> Float[Tensor, "F 3 3"]:
        """Unit shading normal at every face corner.

        The angle-weighted mean of the faces around the vertex that lie within 60° of the corner's
        own face: smooth surfaces are smooth, a cube keeps its edges. Vertices of more than 256 faces
        average all of them. Derived from positions alone, so that deformation needs nothing else.
        Differentiable in the vertices.
        Source: Thürmer & Wüthrich 1998 (angle weights).
        """
        normals = self.face_normals
        flat = self.faces.reshape(-1)  # vertex of each corner, (3F,)
        weighted = (normals[:, None] * self._corner_angles[..., None]).reshape(-1, 3)
        mean = torch.zeros_like(self.vertices).index_add(0, flat, weighted)
        total = mean[flat]
        valence = torch.bincount(flat, minlength=self.vertices.shape[0])
        lean = (unit(total.detach()).reshape(-1, 3, 3) * normals.detach()[:, None]).sum(-1).reshape(-1)
        least = lean.new_ones(len(valence)).scatter_reduce(0, flat, lean, "amin")
        creased = (least < WITHIN_COS) & (valence <= MAX_VALENCE)
        some = creased[flat].nonzero()[:, 0]
        if len(some):
            total = total.index_copy(0, some, self._creased(some, flat, valence))
        smooth = unit(total).reshape(-1, 3, 3)
        lost = torch.linalg.vector_norm(smooth, dim=-1, keepdim=True) < 0.5
        return torch.where(lost, _any_normal(normals)[:, None], smooth)

    def _creased(
        self, some: Int[Tensor, " N"], flat: Int[Tensor, " F3"], valence: Int[Tensor, " V"]
    ) -> Float[Tensor, "N 3"]:
        """Angle-weighted sums for `some` corners: of the faces within 60° of each one's own."""
        normals, angles = self.face_normals, self._corner_angles.reshape(-1)
        order = torch.argsort(flat, stable=True)
        first = torch.cumsum(valence, 0) - valence
        parts = []
        # every ordered pair of corners that share a vertex
        for part in chunks(some.numel(), CHUNK_CORNERS):
            count = valence[flat[some[part]]]
            own = torch.repeat_interleave(some[part], count)
            before = torch.repeat_interleave(torch.cumsum(count, 0) - count, count)
            other = order[first[flat[own]] + torch.arange(own.numel(), device=flat.device) - before]
            other_normal = normals[other // 3]
            close = (normals[own // 3] * other_normal).sum(-1) >= CREASE_COS
            to = torch.repeat_interleave(torch.arange(len(count), device=flat.device), count)
            sums = normals.new_zeros(len(count), 3)
            parts.append(sums.index_add(0, to, other_normal * (angles[other] * close)[:, None]))
        return torch.cat(parts)

    @cached_property
    def _corner_angles(self) -> Float[Tensor, "F 3"]:
        here = self.corners
        ahead, behind = here.roll(-1, 1) - here, here.roll(1, 1) - here
        sine = torch.linalg.vector_norm(torch.linalg.cross(ahead, behind), dim=-1)
        return torch.atan2(sine, (ahead * behind).sum(-1))

    def moved(self, vertices: Float[Tensor, "V 3"]) -> "Mesh":
        """The same triangles at new positions [mm]."""
        return replace(self, vertices=vertices)

    def to(self, dtype: torch.dtype | None = None, device: torch.device | str | None = None) -> "Mesh":
        """The mesh with its real numbers in `dtype` on `device`."""
        uv = self.source_uv
        return replace(
            self,
            vertices=self.vertices.to(device=device, dtype=dtype),
            faces=self.faces.to(device=device),
            source_uv=None if uv is None else uv.to(device=device, dtype=dtype),
            source_vertex=None if self.source_vertex is None else self.source_vertex.to(device=device),
        )


def _any_normal(normals: Float[Tensor, "F 3"]) -> Float[Tensor, "F 3"]:
    """`normals`, with +z in place of those of faces without area."""
    flat = torch.linalg.vector_norm(normals, dim=-1, keepdim=True) < 0.5
    return torch.where(flat, normals.new_tensor([0.0, 0.0, 1.0]), normals)
