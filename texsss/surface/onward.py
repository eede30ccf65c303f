"""Straight lines in texture coordinates that leave a chart and go on where the surface does, across seams."""

from functools import cached_property

import numpy as np
import scipy  # its parts are loaded where they are first used
import torch

from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.surface.topology import edges, edges_uv
from texsss.types import Bool, Float, Int, Tensor

SAME_UV = 1e-6  # ends of an edge as far apart on its two sides are at one place
MOST_EDGES = 512  # that a line may cross


class Onward:
    """Where lines in the texture coordinates `uv` (F, 3, 2) of a mesh lead.

    Within a chart they are straight. At a seam the rest of a line keeps its lengths on the surface, along
    the edge and across it, as if both faces lay in a plane. They end at open edges, at those where more than
    two faces meet, and at faces without area. Charts may overlap, mirror and tile.
    """

    def __init__(self, mesh: Mesh, uv: Float[Tensor, "F 3 2"]):
        self.uv = uv.detach().double()
        self._twin, opposed = _twins(mesh.faces.long())
        ends = edges_uv(self.uv).reshape(-1, 2, 2)
        there = ends[self._twin]
        there = torch.where(opposed[:, None, None], there.flip(1), there)
        apart = ((ends - there).abs() > SAME_UV).any(-1).any(-1)
        linked = self._twin >= 0
        self._rim = apart | ~linked
        own, sound = _edge_frames(mesh.corners.detach().double(), self.uv)
        # along the edge both sides run against each other, unless a face is turned over; across it always
        signs = torch.stack([torch.where(opposed, -1.0, 1.0), -torch.ones(len(opposed))], -1).to(own)
        crossed = linked & apart
        usable = crossed & sound & sound[self._twin]
        inverse = torch.linalg.inv(torch.where(usable[:, None, None], own, torch.eye(2).to(own)))
        turn = own[self._twin] @ (signs[..., None] * inverse)
        self._turn = torch.where(usable[:, None, None], turn, torch.eye(2).to(own))
        self._twin = torch.where(crossed & ~usable, -1, self._twin)
        self._opposed = opposed
        along = torch.stack([self.uv[:, 1] - self.uv[:, 0], self.uv[:, 2] - self.uv[:, 0]], -1)
        det = torch.linalg.det(along)
        flat = det.abs() < 1e-20
        per_uv = torch.linalg.inv(torch.where(flat[:, None, None], torch.eye(2).to(along), along))
        per_uv = per_uv.masked_fill(flat[:, None, None], 0)
        self._per_uv = torch.cat([-per_uv.sum(1, keepdim=True), per_uv], 1)  # (F, 3, 2): barycentrics per uv

    @property
    def held_bytes(self) -> int:
        """How much memory it takes, what is found at its first use included."""
        held = {"_clear": self.uv.shape[0] * 8}
        held |= {name: part.nbytes for name, part in list(vars(self).items()) if isinstance(part, Tensor)}
        return sum(held.values())

    @cached_property
    def _clear(self) -> Float[Tensor, " F"]:
        """How far lines go at least from anywhere on each face before they meet a rim of its chart [uv]."""
        middle = self.uv.mean(1)
        radius = torch.linalg.vector_norm(self.uv - middle[:, None], dim=-1).amax(-1)
        rims = edges_uv(self.uv).reshape(-1, 2, 2)[self._rim]
        if not len(rims):
            return torch.full_like(radius, torch.inf)
        length = torch.linalg.vector_norm(rims[:, 1] - rims[:, 0], dim=-1)
        spacing = float(length.mean()) + 1e-12
        count = (length / spacing).ceil().long() + 1
        edge = torch.repeat_interleave(torch.arange(len(rims)), count)
        first = torch.cumsum(count, 0) - count
        share = (torch.arange(len(edge)) - first[edge]).double() / (count[edge] - 1).clamp_min(1)
        samples = torch.lerp(rims[edge, 0], rims[edge, 1], share[:, None])
        near = scipy.spatial.KDTree(samples.numpy()).query(middle.numpy(), workers=-1)[0]
        return torch.from_numpy(np.asarray(near)) - spacing / 2 - radius

    def at(self, points: Points, shift: Float[Tensor, "P 2"]) -> Float[Tensor, "P 2"]:
        """Texture coordinates at the ends of lines that start at points and run along `shift` [uv].

        Gradients in `shift` are those of straight lines.
        """
        place = points.uv(self.uv.to(shift)) + shift
        moving = torch.linalg.vector_norm(shift.detach(), dim=-1)
        rows = (moving > self._clear[points.face.long()].to(moving)).nonzero()[:, 0]
        if not len(rows):
            return place
        found = self._walked(points[rows], shift.detach()[rows].double()).to(place)
        return place + torch.zeros_like(place).index_copy(0, rows, found - place.detach()[rows])

    def _walked(self, points: Points, shift: Float[Tensor, "N 2"]) -> Float[Tensor, "N 2"]:
        """Face by face to the end of each line; starts beyond a face count as on its rim."""
        face = points.face.long()
        bary = points.bary.double().clamp_min(0)
        bary = bary / bary.sum(-1, keepdim=True)
        ended = torch.einsum("pc,pcd->pd", bary, self.uv[face])
        rows = torch.arange(len(face))
        entered = torch.full_like(face, -1)  # the corner opposite to the edge that a line came in by
        for _ in range(MOST_EDGES):
            rate = torch.einsum("pcd,pd->pc", self._per_uv[face], shift)
            leaving = (rate < 0) & (torch.arange(3) != entered[:, None])
            ways = torch.where(leaving, bary / -rate.clamp_max(-1e-300), torch.inf)
            share, corner = ways.min(-1)
            ends = share >= 1
            edge = 3 * face + (corner + 1) % 3
            onto = torch.where(ends, -1, self._twin[edge])
            bary = (bary + rate * share.clamp_max(1)[:, None]).clamp_min(0)
            bary = bary / bary.sum(-1, keepdim=True)
            stays = onto < 0
            ended[rows[stays]] = torch.einsum("pc,pcd->pd", bary[stays], self.uv[face[stays]])
            go = (~stays).nonzero()[:, 0]
            if not len(go):
                return ended
            rows, onto, edge = rows[go], onto[go], edge[go]
            start, stop = bary[go, edge % 3], bary[go, (edge + 1) % 3]
            same = ~self._opposed[edge]
            first, second = torch.where(same, start, stop), torch.where(same, stop, start)
            bary = torch.zeros(len(go), 3, dtype=bary.dtype)
            bary = bary.scatter(1, (onto % 3)[:, None], first[:, None])
            bary = bary.scatter(1, ((onto + 1) % 3)[:, None], second[:, None])
            shift = ((1 - share[go])[:, None, None] * self._turn[edge] @ shift[go, :, None])[..., 0]
            face, entered = onto // 3, (onto + 2) % 3
        ended[rows] = torch.einsum("pc,pcd->pd", bary, self.uv[face])
        return ended


def _twins(faces: Int[Tensor, "F 3"]) -> tuple[Int[Tensor, " E"], Bool[Tensor, " E"]]:
    """The edge of another face that each edge of a face is, -1 where not exactly two meet; whether they run
    against each other. Edge 3 f + k runs from corner k of face f to the next."""
    both = edges(faces).reshape(-1, 2)
    low, high = both.amin(-1), both.amax(-1)
    code = low * (int(faces.max()) + 1) + high
    _, number, count = torch.unique(code, return_inverse=True, return_counts=True)
    order = torch.argsort(number, stable=True)
    pairs = order[((count[number] == 2) & (low < high))[order]].reshape(-1, 2)
    twin = torch.full_like(code, -1)
    twin[pairs[:, 0]], twin[pairs[:, 1]] = pairs[:, 1], pairs[:, 0]
    return twin, both[:, 0] == both[twin, 1]


def _edge_frames(
    corners: Float[Tensor, "F 3 3"], uv: Float[Tensor, "F 3 2"]
) -> tuple[Float[Tensor, "E 2 2"], Bool[Tensor, " E"]]:
    """Change of uv per mm along each edge and across it into its face (columns), and where it is known."""
    start, stop, top = (x.reshape(-1, 3) for x in (corners, corners.roll(-1, 1), corners.roll(-2, 1)))
    a, b, c = (x.reshape(-1, 2) for x in (uv, uv.roll(-1, 1), uv.roll(-2, 1)))
    length = torch.linalg.vector_norm(stop - start, dim=-1, keepdim=True)
    along = (stop - start) / length.clamp_min(1e-30)
    foot = ((top - start) * along).sum(-1, keepdim=True)
    height = torch.linalg.vector_norm(top - start - foot * along, dim=-1, keepdim=True)
    per_along = (b - a) / length.clamp_min(1e-30)
    per_across = (c - a - foot * per_along) / height.clamp_min(1e-30)
    frame = torch.stack([per_along, per_across], -1)
    scale = frame.square().sum((-1, -2))
    sound = (length[:, 0] > 0) & (height[:, 0] > 1e-6 * length[:, 0])
    return frame, sound & (torch.linalg.det(frame).abs() > 1e-6 * scale) & (scale > 0)
