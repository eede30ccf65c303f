"""Which points see each other: rays against the mesh, by Embree."""

import numpy as np
import torch
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from texsss.surface.mesh import Mesh
from texsss.types import Bool, Float, Int, Tensor

OFFSET = 2e-5  # how far rays start off the surface, as a share of half the mesh's extent
FACE_BYTES = 130  # that Embree's hierarchy takes per face, as measured
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
        start, ahead = self._rays(origins, directions, directions if normals is None else normals)
        reach = np.full(len(start), 1e37, dtype=np.float32)
        if distance is not None:
            # short of the end, lest a target on a surface shadow itself
            unit = distance.detach().cpu().double() * self._scale - 2 * self._offset
            reach = unit.clamp(0, 1e37).to(torch.float32).numpy()
        hit = self._scene.run(start, ahead, dists=reach, query="OCCLUDED") >= 0
        return torch.from_numpy(hit).to(origins.device)

    def closest(
        self, origins: Float[Tensor, "P 3"], directions: Float[Tensor, "P 3"]
    ) -> tuple[Int[Tensor, " P"], Float[Tensor, "P 3"], Float[Tensor, " P"]]:
        """Face (-1: none), barycentrics of its corners, and distance [mm] (infinite: none) of the first hit.

        `origins` [mm] are off the surface, `directions` of unit length.
        """
        start, ahead = self._rays(origins, directions, None)
        hit = self._scene.run(start, ahead, output=True)
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

    def _rays(
        self,
        origins: Float[Tensor, "P 3"],
        directions: Float[Tensor, "P 3"],
        away: Float[Tensor, "P 3"] | None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Origins, moved off the surface along `away`, and directions in Embree's frame."""
        start = (origins.detach().cpu().double() - self._centre) * self._scale
        if away is not None:
            start = start + self._offset * away.detach().cpu()
        ahead = directions.detach().cpu()
        return (
            np.ascontiguousarray(start.to(torch.float32).numpy()),
            np.ascontiguousarray(ahead.to(torch.float32).numpy()),
        )
