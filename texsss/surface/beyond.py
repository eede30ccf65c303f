"""Maps continued beside their charts by what lies across the seams, and blurred across them."""

import math
from dataclasses import dataclass

import torch
from torch.nn.functional import conv2d, pad

from texsss.numerics.sampling import bilinear
from texsss.surface.onward import SAME_UV, Onward
from texsss.surface.raster import rasterise
from texsss.types import Cancel, Float, Int, Tensor

GUTTER_TEXELS = 32.0  # around charts, as far as there is room, that maps are continued
FINE = 1024  # texels of a side on which blurs go by one texel a step: charts may be five apart


@dataclass(frozen=True, eq=False)
class Beyond:
    """Texels around the charts of a map and what continues it there.

    `texel` (G,): row-major. `place` (G, 2): where on the surface lines lead that leave a chart there [uv].
    """

    texel: Int[Tensor, " G"]
    place: Float[Tensor, "G 2"]

    def continued(self, image: Float[Tensor, "H W C"], times: int = 2) -> Float[Tensor, "H W C"]:
        """The map with what lies across the seams beside its charts, as far as there is room.

        The second time what is looked up next to a seam is known on both of its sides. Differentiable.
        """
        flat = image.reshape(-1, image.shape[-1])
        least, most = flat.detach().aminmax(dim=0)  # rounding must not leave them
        for _ in range(times):
            values = bilinear(flat.reshape(image.shape), self.place.to(image.dtype), "repeat")
            flat = flat.index_copy(0, self.texel, values.clamp(least, most))
        return flat.reshape(image.shape)

    def smoothed(self, image: Float[Tensor, "H W C"], deviation: float) -> Float[Tensor, "H W C"]:
        """The map blurred by a Gaussian [texels], in steps too narrow to see a chart but across a seam."""
        height, width, channels = image.shape
        steps = max(1, math.ceil((deviation / max(1.0, max(height, width) / FINE)) ** 2))
        step = deviation / steps**0.5
        reach = min(math.ceil(3 * step), height, width)
        kernel = torch.exp(-((torch.arange(-reach, reach + 1).to(image) / step) ** 2) / 2)
        kernel = (kernel / kernel.sum()).expand(channels, 1, 1, -1)
        for _ in range(steps):
            planes = self.continued(image, 1).permute(2, 0, 1)[None]
            planes = conv2d(pad(planes, (reach, reach, 0, 0), "circular"), kernel, groups=channels)
            planes = pad(planes, (0, 0, reach, reach), "circular")
            image = conv2d(planes, kernel.transpose(2, 3), groups=channels)[0].permute(1, 2, 0)
        return image


def beyond(onward: Onward, size: tuple[int, int], cancel: Cancel | None = None) -> Beyond:
    """What lies beside the charts of maps of `size` (H, W), up to GUTTER_TEXELS; nothing where they tile."""
    uv, nothing = onward.uv, Beyond(torch.empty(0, dtype=torch.int64), onward.uv.new_empty(0, 2))
    if float((uv - 0.5).abs().max()) > 0.5 + SAME_UV:
        return nothing
    texels = rasterise(onward.mesh, uv.float(), size, gutter_texels=0, cancel=cancel)
    if not len(texels):
        return nothing
    width, near = size[1], texels.nearest.reshape(-1)
    every = torch.arange(len(near))
    steps = torch.stack([every % width - near % width, every // width - near // width], -1)
    away = steps.square().sum(-1)
    texel = ((away > 0) & (away <= GUTTER_TEXELS**2)).nonzero()[:, 0]
    row = torch.empty_like(near).index_copy(0, texels.index, torch.arange(len(texels)))
    shift = steps[texel].double() / torch.tensor([width, size[0]])
    return Beyond(texel, onward.at(texels.points[row[near[texel]]], shift))
