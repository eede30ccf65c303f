"""Who borders whom: edges, charts, open and non-manifold places."""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded where they are first used
import torch

from texsss.surface.mesh import Mesh
from texsss.types import Float, Int, Tensor


def uv_corners(faces: Int[Tensor, "F 3"], uv: Float[Tensor, "F 3 2"]) -> Int[Tensor, "F 3"]:
    """A number for every corner, the same where vertex and uv are: the mesh as it lies in the atlas."""
    flat = uv.detach().cpu().numpy().astype(np.float64).reshape(-1, 2) + 0.0
    keys = np.stack([faces.detach().cpu().numpy().reshape(-1).astype(np.float64), flat[:, 0], flat[:, 1]], -1)
    packed = np.ascontiguousarray(keys).view(np.dtype((np.void, 24)))[:, 0]
    number = np.unique(packed, return_inverse=True)[1]
    return torch.from_numpy(number.reshape(-1, 3)).to(faces.device)


def edges(faces: Int[Tensor, "F 3"]) -> Int[Tensor, "F 3 2"]:
    """Directed edges of all faces as (start, stop), in the order of corners."""
    return torch.stack([faces, faces.roll(-1, 1)], -1)


def shared_edges(faces: Int[Tensor, "F 3"]) -> Int[Tensor, "N 2"]:
    """Pairs of faces that share an edge, whichever way it runs; a chain of pairs where more than two meet."""
    both = edges(faces.long()).reshape(-1, 2)
    low, high = both.amin(-1), both.amax(-1)
    code, order = torch.sort(low * (int(faces.max()) + 1) + high, stable=True)
    same = torch.nonzero(code[1:] == code[:-1])[:, 0]
    owner = order // 3
    return torch.stack([owner[same], owner[same + 1]], -1)


def components(count: int, pairs: Int[Tensor, "N 2"]) -> Int[Tensor, " count"]:
    """The number of the connected part, from 0 in order of its first member, of each of `count` things."""
    pair = pairs.detach().cpu().numpy()
    graph = scipy.sparse.coo_array(
        (np.ones(len(pair), np.int8), (pair[:, 0], pair[:, 1])), shape=(count, count)
    )
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    _, first, label = np.unique(label, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return torch.from_numpy(rank[label].astype(np.int64)).to(pairs.device)


def charts(faces: Int[Tensor, "F 3"], uv: Float[Tensor, "F 3 2"]) -> Int[Tensor, " F"]:
    """The chart of every face: faces belong together when they share an edge in uv."""
    return components(faces.shape[0], shared_edges(uv_corners(faces, uv)))


def seams(faces: Int[Tensor, "F 3"], uv: Float[Tensor, "F 3 2"]) -> Float[Tensor, "N 2 2 2"]:
    """Edges whose two faces lie apart in uv: side × end × (u, v), the same ends first on both sides."""
    both, place = edges(faces.long()).reshape(-1, 2), edges_uv(uv).reshape(-1, 2, 2)
    turned = both[:, 0] > both[:, 1]
    place = torch.where(turned[:, None, None], place.flip(1), place)
    code, order = torch.sort(both.amin(-1) * (int(faces.max()) + 1) + both.amax(-1), stable=True)
    same = torch.nonzero(code[1:] == code[:-1])[:, 0]
    sides = torch.stack([place[order[same]], place[order[same + 1]]], 1)
    return sides[((sides[:, 0] - sides[:, 1]).abs() > 1e-6).any(-1).any(-1)]


def edges_uv(uv: Float[Tensor, "F 3 2"]) -> Float[Tensor, "F 3 2 2"]:
    """Directed edges of all faces as they lie in uv."""
    return torch.stack([uv, uv.roll(-1, 1)], -2)


@dataclass(frozen=True)
class Edges:
    """How many edges there are, by the faces that meet in them.

    `open`: one; `non_manifold`: more than two; `inconsistent`: two that turn against each other.
    """

    count: int
    open: int
    non_manifold: int
    inconsistent: int


def edge_report(faces: Int[Tensor, "F 3"]) -> Edges:
    """The edges of a surface by how many faces meet in them."""
    both = edges(faces.long()).reshape(-1, 2)
    low, high = both.amin(-1), both.amax(-1)
    forward = both[:, 0] < both[:, 1]
    _, number, count = torch.unique(
        low * (int(faces.max()) + 1) + high, return_inverse=True, return_counts=True
    )
    ahead = torch.zeros_like(count).index_add(0, number, forward.long())
    return Edges(
        count=len(count),
        open=int((count == 1).sum()),
        non_manifold=int((count > 2).sum()),
        inconsistent=int(((count == 2) & (ahead != 1)).sum()),
    )


def closed_volume(mesh: Mesh, part: Int[Tensor, " F"]) -> Float[Tensor, " N"]:
    """Signed volume [mm³] of every connected part; 0 for open ones, below 0 where inside out. float64."""
    corners = mesh.corners.detach().double()
    middle = (corners.amax((0, 1)) + corners.amin((0, 1))) / 2
    a, b, c = (corners - middle).unbind(1)
    volume = (a * torch.linalg.cross(b, c)).sum(-1) / 6
    count = int(part.max()) + 1
    total = torch.zeros(count, dtype=volume.dtype, device=volume.device).index_add(0, part, volume)
    both = edges(mesh.faces.long()).reshape(-1, 2)
    code = both.amin(-1) * mesh.vertices.shape[0] + both.amax(-1)
    _, number, meet = torch.unique(code, return_inverse=True, return_counts=True)
    rim = (meet[number] == 1).reshape(-1, 3).any(-1)
    is_open = torch.zeros(count, device=part.device).index_add(0, part, rim.float()) > 0
    return torch.where(is_open, 0.0, total)
