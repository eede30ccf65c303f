"""Maps continued beside their charts by what lies across the seams, and blurred across them."""

import math
from dataclasses import dataclass

import torch
from torch.nn.functional import conv2d, pad

from texsss.numerics.sampling import bilinear
from texsss.surface._gutter import gutter_texels
from texsss.surface._scanline import disjoint, filled, spans
from texsss.surface.dilate import nearest_filled
from texsss.surface.onward import SAME_UV, Onward
from texsss.surface.points import Points
from texsss.surface.raster import check_size, covered_points, snapped
from texsss.types import Bool, Cancel, Float, Int, Tensor, check_cancelled, chunks

GUTTER_TEXELS = 32.0  # around charts, as far as there is room, that maps are continued
FINE = 1024  # texels of a side on which blurs go by one texel a step: charts may be five apart
CHUNK_TEXELS = 1 << 18  # looked for at once: each takes some hundred bytes on its way


@dataclass(frozen=True, eq=False)
class Beyond:
    """Texels around the charts of a map and what continues it there.

    `texel` (G,): row-major. `place` (G, 2): where on the surface lines lead that leave a chart there [uv].
    """

    texel: Int[Tensor, " G"]
    place: Float[Tensor, "G 2"]

    def continued(
        self, image: Float[Tensor, "H W C"], times: int = 2, *, cancel: Cancel | None = None
    ) -> Float[Tensor, "H W C"]:
        """The map with what lies across the seams beside its charts, as far as there is room.

        The second time what is looked up next to a seam is known on both of its sides. Differentiable.
        Raises Cancelled.
        """
        flat = image.reshape(-1, image.shape[-1])
        least, most = flat.detach().aminmax(dim=0)  # rounding must not leave them
        for _ in range(times):
            now = flat.reshape(image.shape)
            values = []
            for part in chunks(len(self.texel), CHUNK_TEXELS):
                check_cancelled(cancel)
                values.append(bilinear(now, self.place[part].to(image.dtype), "repeat").clamp(least, most))
            flat = flat.index_copy(0, self.texel, torch.cat(values)) if values else flat
        return flat.reshape(image.shape)

    def smoothed(
        self, image: Float[Tensor, "H W C"], deviation: float, *, cancel: Cancel | None = None
    ) -> Float[Tensor, "H W C"]:
        """The map blurred by a Gaussian [texels], in steps too narrow to see a chart but across a seam.

        Raises Cancelled.
        """
        height, width, channels = image.shape
        steps = max(1, math.ceil((deviation / max(1.0, max(height, width) / FINE)) ** 2))
        step = deviation / steps**0.5
        reach = min(math.ceil(3 * step), height, width)
        kernel = torch.exp(-((torch.arange(-reach, reach + 1).to(image) / step) ** 2) / 2)
        kernel = (kernel / kernel.sum()).expand(channels, 1, 1, -1)
        for _ in range(steps):
            planes = self.continued(image, 1, cancel=cancel).permute(2, 0, 1)[None]
            planes = conv2d(pad(planes, (reach, reach, 0, 0), "circular"), kernel, groups=channels)
            planes = pad(planes, (0, 0, reach, reach), "circular")
            image = conv2d(planes, kernel.transpose(2, 3), groups=channels)[0].permute(1, 2, 0)
        return image


def beyond(onward: Onward, size: tuple[int, int], cancel: Cancel | None = None) -> Beyond:
    """What lies beside the charts of maps of `size` (H, W), up to GUTTER_TEXELS; nothing where they tile.

    In parts: most of the memory that it takes is what it returns. Cancelled: on request.
    """
    uv, nothing = onward.uv, Beyond(torch.empty(0, dtype=torch.int64), onward.uv.new_empty(0, 2))
    if float((uv - 0.5).abs().max()) > 0.5 + SAME_UV:
        return nothing
    check_size(size)
    grid = snapped(uv.float(), size)
    claims = disjoint(spans(grid, size, cancel), cancel)
    held = filled(claims, size)
    # centres on an edge that no face owns are the map's own, too
    on_edge, edge_face, edge_bary, _ = gutter_texels(grid, held, size, 0.0, cancel)
    held[on_edge] = True
    texel, near = _beside(held.reshape(size), cancel)
    if not len(texel):
        return nothing
    parts = chunks(len(texel), CHUNK_TEXELS)
    rims = held.zero_()
    for part in parts:
        rims[near[part].long()] = True
    used = torch.searchsorted(claims.start, rims.nonzero()[:, 0], right=True) - 1
    inside, index = covered_points(grid, claims[used[used >= 0].unique_consecutive()], size, cancel)
    del held, rims, claims, used
    index, order = torch.sort(torch.cat([index, on_edge.int()]))
    points = Points(
        torch.cat([inside.face, edge_face.int()])[order], torch.cat([inside.bary, edge_bary.float()])[order]
    )
    sides, place = torch.tensor([size[1], size[0]]), uv.new_empty(len(texel), 2)
    for part in parts:
        check_cancelled(cancel)
        steps = torch.stack(_steps(texel[part], near[part], size[1]), -1)
        start = points[torch.searchsorted(index, near[part])]
        place[part] = onward.at(start, steps.double() / sides)
    return Beyond(texel.long(), place)


def _beside(held: Bool[Tensor, "H W"], cancel: Cancel | None) -> tuple[Int[Tensor, " G"], Int[Tensor, " G"]]:
    """Texels (row-major, int32) within GUTTER_TEXELS of those that are held, and the nearest of those."""
    height, width = held.shape
    reach = int(GUTTER_TEXELS)
    texels, nearest = [], []
    for rows in chunks(height, max(2 * reach, CHUNK_TEXELS // width)):
        check_cancelled(cancel)
        top = max(rows.start - reach, 0)
        band = nearest_filled(held[top : rows.stop + reach]).reshape(-1)  # each its own where none is
        texel = (~held[rows]).reshape(-1).nonzero()[:, 0] + rows.start * width
        near = band[texel - top * width] + top * width
        along, down = _steps(texel, near, width)
        away = along.square() + down.square()
        close = (away > 0) & (away <= GUTTER_TEXELS**2)
        texels.append(texel[close].int())
        nearest.append(near[close].int())
    return torch.cat(texels), torch.cat(nearest)


def _steps(texel: Int[Tensor, " G"], near: Int[Tensor, " G"], width: int) -> list[Int[Tensor, " G"]]:
    """Texels to the right and down from `near` to `texel`."""
    return [texel % width - near % width, texel // width - near // width]
