"""Which points see each other: rays against the mesh, by Embree."""

from dataclasses import dataclass

import numpy as np
import torch
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from texsss.surface.mesh import Mesh
from texsss.types import Bool, Float, Int, Tensor

OFFSET = 2e-5  # how far rays start off the surface, as a share of half the mesh's extent
FACE_BYTES = 130  # that Embree's hierarchy takes per face, as measured
FARTHEST = 1e37  # what a ray reaches, in the cube
_FLOAT32_STEP = 2.0**-23


class Occluder:
    """A mesh that rays can hit. Built once per geometry; visibility has no gradients.

    Embree computes in float32, so the mesh is scaled into the cube -1..1 around the origin first and
    every answer is scaled back: micrometres and kilometres trace alike.
    """

    def __init__(self, mesh: Mesh):
        vertices = mesh.vertices.detach().to("cpu", torch.float64)
        # only what faces use counts for the scale
        used = vertices[mesh.faces.cpu().reshape(-1).long()]
        low, high = used.amin(0), used.amax(0)
        self._centre = (low + high) / 2
        self._scale = 2.0 / float((high - low).amax())
        unit = ((vertices - self._centre) * self._scale).clamp(-2, 2).to(torch.float32)
        # positions that come in float32 from afar are coarser than the offset itself
        coarse = float(used.abs().amax()) * self._scale * _FLOAT32_STEP
        self._offset = max(OFFSET, 8 * coarse)
        self._faces = len(mesh.faces)
        self._scene = EmbreeScene(robust=True)
        self._geometry = TriangleMesh(self._scene, unit.numpy(), mesh.faces.cpu().to(torch.int32).numpy())

    @property
    def held_bytes(self) -> int:
        """About how much memory it takes beside tensors."""
        return FACE_BYTES * self._faces

    @property
    def offset_mm(self) -> float:
        """How far rays start off the surface [mm]."""
        return self._offset / self._scale

    def occluded(
        self,
        origins: Float[Tensor, "P 3"],
        directions: Float[Tensor, "P 3"],
        distance: Float[Tensor, " P"] | None = None,
        normals: Float[Tensor, "P 3"] | None = None,
    ) -> Bool[Tensor, " P"]:
        """Whether anything stands between `origins` [mm] and what lies at `distance` [mm] along `directions`.

        `directions` are of unit length; a `distance` of infinity or None looks at the sky. Rays start
        off the surface by `offset_mm`, along `normals` where given (the geometric normals of the
        surface that the origins lie on), else along themselves.
        """
        if origins.shape[0] == 0:
            return torch.zeros(0, dtype=torch.bool, device=origins.device)
        starts = self.starts(origins, directions if normals is None else normals)
        if distance is None:
            return starts.hidden(directions)
        # short of the end, lest a target on a surface shadow itself
        unit = distance.detach().cpu().double() * self._scale - 2 * self._offset
        return starts.hidden(directions, unit.clamp(0, FARTHEST).to(torch.float32))

    def starts(self, origins: Float[Tensor, "P 3"], away: Float[Tensor, "P 3"]) -> "Starts":
        """Where rays from `origins` [mm] start, `offset_mm` off them along unit `away`; for many rays."""
        start = (origins.detach().cpu().double() - self._centre) * self._scale
        start = start + self._offset * away.detach().cpu()
        return Starts(self._scene, start.to(torch.float32), origins.device)

    def closest(
        self, origins: Float[Tensor, "P 3"], directions: Float[Tensor, "P 3"]
    ) -> tuple[Int[Tensor, " P"], Float[Tensor, "P 3"], Float[Tensor, " P"]]:
        """Face (-1: none), barycentrics of its corners, and distance [mm] (infinite: none) of the first hit.

        `origins` [mm] are off the surface, `directions` of unit length.
        """
        start = (origins.detach().cpu().double() - self._centre) * self._scale
        ahead = directions.detach().to("cpu", torch.float32)
        hit = self._scene.run(_floats(start.to(torch.float32)), _floats(ahead), output=True)
        face = torch.from_numpy(hit["primID"]).long()
        missed = face < 0
        u, v = torch.from_numpy(hit["u"]), torch.from_numpy(hit["v"])
        bary = torch.stack([1 - u - v, u, v], -1).clamp(0, 1)
        bary = bary / bary.sum(-1, keepdim=True)
        distance = torch.from_numpy(hit["tfar"]).double() / self._scale
        distance[missed] = torch.inf
        bary[missed] = 1 / 3
        device, dtype = origins.device, origins.dtype
        return face.to(device), bary.to(device, dtype), distance.to(device, dtype)


@dataclass(frozen=True, eq=False)
class Starts:
    """P points that rays start from, in the frame of Embree's `scene`; `device` takes the answers."""

    scene: EmbreeScene
    place: Float[Tensor, "P 3"]
    device: torch.device

    def __getitem__(self, rows: Int[Tensor, " R"]) -> "Starts":
        return Starts(self.scene, self.place[rows.cpu()], self.device)

    def hidden(
        self, directions: Float[Tensor, "P 3"], reach: Float[Tensor, " P"] | None = None
    ) -> Bool[Tensor, " P"]:
        """Whether anything stands along unit `directions`, within `reach` (in Embree's frame) or at all."""
        ahead = directions.detach().to("cpu", torch.float32)
        reaches = None if reach is None else reach.numpy()
        hit = self.scene.run(_floats(self.place), _floats(ahead), dists=reaches, query="OCCLUDED")
        return torch.from_numpy(hit >= 0).to(self.device)


def _floats(values: Float[Tensor, "P 3"]) -> np.ndarray:
    return np.ascontiguousarray(values.numpy())
