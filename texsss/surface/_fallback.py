"""An unwrap that always ends: faces projected along the axis they face, charts packed in shelves."""

import torch

from texsss.surface._scanline import disjoint, spans
from texsss.surface._shelves import pack
from texsss.surface.mesh import Mesh
from texsss.surface.raster import snapped
from texsss.surface.topology import components, shared_edges
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled

AGREEING = 12  # rounds in which faces follow their neighbours, at most
PULL = 0.3  # of each neighbour, against the cosine to an axis
SLANTED = 0.35  # cosine to an axis below which faces are not looked at along it: they would shrink
ROUNDS = 6  # of taking overlapping faces out of their chart; what still overlaps then stands alone
TEST_SIZES = (512, 2048)  # texels along the square in which a chart's overlaps are looked for, by its faces


def projected_uv(
    mesh: Mesh,
    size: int,
    padding_texels: int,
    *,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> tuple[Float[Tensor, "F 3 2"], float]:
    """uv from projections along ±x, ±y, ±z, and the padding [texels] that they have at `size`.

    Charts are connected faces whose normals favour the same axis, without folds; every chart has the same
    texels per mm (a projection shortens slanted faces to SLANTED at most). With so many charts that the
    padding asked for would fill the square, they get less.
    """
    corners = _scaled(mesh)
    normals = mesh.face_normals.detach().cpu()
    pairs = shared_edges(mesh.faces.cpu())
    side = _sides(normals, pairs)
    flat = _projected(corners, side // 2, side % 2 == 1)
    chart = _split(side, pairs)
    for step in range(ROUNDS):
        check_cancelled(cancel)
        if progress is not None:
            progress("unwrap", 0.1 + 0.8 * step / ROUNDS)
        folded = _folded(flat, chart, cancel)
        if not bool(folded.any()):
            break
        if step < ROUNDS - 1:
            # what lies on top forms charts of its own, to be looked at again
            chart = _split(chart * 2 + folded, pairs)
        else:
            chart = torch.where(folded, len(chart) + torch.arange(len(chart)), chart)
            chart = torch.unique(chart, return_inverse=True)[1]
    check_cancelled(cancel)
    uv, padding = pack(flat.numpy(), chart.numpy(), size, float(padding_texels))
    if progress is not None:
        progress("unwrap", 1.0)
    return torch.from_numpy(uv).to(mesh.vertices), padding


def _sides(normals: Tensor, pairs: Tensor) -> Tensor:
    """Which way each face is looked at: 0 to 5 for -x, +x, -y … +z.

    Along the axis that it faces, but as its neighbours are where it nearly faces that way, too: rough
    surfaces would fall into crumbs. Each round weighs what the neighbours have chosen so far.
    """
    facing = torch.stack([-normals, normals], -1).reshape(-1, 6)
    side = facing.argmax(1)
    apart = facing < torch.minimum(facing.amax(1, keepdim=True), torch.tensor(SLANTED))
    for _ in range(AGREEING):
        votes = torch.zeros_like(facing)
        for here, there in ((0, 1), (1, 0)):
            at = pairs[:, here] * 6 + side[pairs[:, there]]
            votes.view(-1).index_add_(0, at, votes.new_full((), PULL).expand(len(at)))
        chosen = (facing + votes).masked_fill(apart, -torch.inf).argmax(1)
        if torch.equal(chosen, side):
            break
        side = chosen
    return side


def _split(label: Tensor, pairs: Tensor) -> Tensor:
    """Connected faces of one label."""
    return components(len(label), pairs[label[pairs[:, 0]] == label[pairs[:, 1]]])


def _scaled(mesh: Mesh) -> Tensor:
    """Corners in a unit box, float64 on the CPU."""
    corners = mesh.corners.detach().cpu().double()
    low = corners.amin((0, 1))
    return (corners - low) / float((corners.amax((0, 1)) - low).max())


def _projected(corners: Tensor, axis: Tensor, positive: Tensor) -> Tensor:
    """Corners (F, 3, 2) seen along the axis, as from outside: v runs down."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    u = torch.gather(corners, 2, first[:, None, None].expand(-1, 3, 1))[..., 0]
    v = torch.gather(corners, 2, second[:, None, None].expand(-1, 3, 1))[..., 0]
    return torch.stack([torch.where(positive[:, None], -u, u), v], -1)


def _folded(flat: Tensor, chart: Tensor, cancel: Cancel | None) -> Tensor:
    """Faces that lie on top of others of their chart. Packed charts don't meet, so one raster tells."""
    side = min(max(int(8 * len(chart) ** 0.5), TEST_SIZES[0]), TEST_SIZES[1])
    uv, _ = pack(flat.numpy(), chart.numpy(), side, 1.0)
    claims = spans(snapped(torch.from_numpy(uv), (side, side)), (side, side), cancel)
    return disjoint(claims, cancel).texels_per_face(len(chart)) < claims.texels_per_face(len(chart))
