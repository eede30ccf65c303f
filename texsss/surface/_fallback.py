"""An unwrap that always ends: faces projected along the axis they face, charts packed in shelves."""

import torch

from texsss.surface._scanline import disjoint, spans
from texsss.surface._shelves import pack
from texsss.surface.mesh import Mesh
from texsss.surface.raster import snapped
from texsss.surface.topology import components, shared_edges
from texsss.types import Cancel, Float, Progress, Tensor, check_cancelled

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
    texels per mm (a projection shortens slanted faces by 1/√3 at most). With so many charts that the
    padding asked for would fill the square, they get less.
    """
    corners = _scaled(mesh)
    normals = mesh.face_normals.detach().cpu()
    axis = normals.abs().argmax(-1)
    positive = torch.gather(normals, 1, axis[:, None])[:, 0] >= 0
    flat = _projected(corners, axis, positive)
    pairs = shared_edges(mesh.faces.cpu())
    chart = _split(axis * 2 + positive, pairs)
    for step in range(ROUNDS):
        check_cancelled(cancel)
        if progress is not None:
            progress("unwrap", 0.1 + 0.8 * step / ROUNDS)
        folded = _folded(flat, chart)
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


def _folded(flat: Tensor, chart: Tensor) -> Tensor:
    """Faces that lie on top of others of their chart. Packed charts don't meet, so one raster tells."""
    side = min(max(int(8 * len(chart) ** 0.5), TEST_SIZES[0]), TEST_SIZES[1])
    uv, _ = pack(flat.numpy(), chart.numpy(), side, 1.0)
    claims = spans(snapped(torch.from_numpy(uv), (side, side)), (side, side))
    return disjoint(claims).texels_per_face(len(chart)) < claims.texels_per_face(len(chart))
