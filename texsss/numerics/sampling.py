"""Bilinear look-ups in images, with texsss' convention for texel centres."""

from dataclasses import dataclass
from typing import Literal

import torch
from torch.nn.functional import grid_sample

from texsss.types import Float, Tensor

Wrap = Literal["clamp", "repeat"]


@dataclass(frozen=True, eq=False)
class Texture:
    """An image and how it goes on outside its square; make it by `Texture.of`.

    `planes`: a view of the image, one plane per channel: nothing is copied.
    """

    planes: Float[Tensor, "1 C H W"]
    wrap: Wrap

    @classmethod
    def of(cls, image: "Float[Tensor, 'H W C'] | Texture", wrap: Wrap = "clamp") -> "Texture":
        """`image` outside of whose square its edge goes on (`clamp`) or it is tiled (`repeat`)."""
        return image if isinstance(image, Texture) else cls(image.permute(2, 0, 1)[None], wrap)

    def at(self, uv: Float[Tensor, "P 2"]) -> Float[Tensor, "P C"]:
        """Values interpolated between texel centres; see `bilinear`."""
        if self.wrap == "repeat":
            uv = uv - uv.detach().floor()
        grid = (2 * uv - 1).to(self.planes.dtype)[None, None]
        found = grid_sample(self.planes, grid, mode="bilinear", padding_mode="border", align_corners=False)
        found = found[0, :, 0].T.contiguous()
        if self.wrap == "clamp":
            return found
        size = uv.new_tensor(self.planes.shape[:1:-1])
        place = uv.detach() * size
        # between the last centres of one tile and the first of the next
        rim = ((place < 0.5) | (place > size - 0.5)).any(1).nonzero()[:, 0]
        return found.index_copy(0, rim, self._tiled(uv[rim], size)) if len(rim) else found

    def _tiled(self, uv: Float[Tensor, "P 2"], size: Float[Tensor, "2"]) -> Float[Tensor, "P C"]:
        """As `at`, for few points: their four texels one by one. `size`: width and height."""
        image = self.planes[0].permute(1, 2, 0)
        place = uv * size - 0.5
        low = place.detach().floor()
        x, y = (place - low).to(image)[:, None].unbind(-1)
        left, top = low.remainder(size).long().unbind(-1)
        right, bottom = (low + 1).remainder(size).long().unbind(-1)
        upper = torch.lerp(image[top, left], image[top, right], x)
        return torch.lerp(upper, torch.lerp(image[bottom, left], image[bottom, right], x), y)


def resized(image: Float[Tensor, "H W C"], height: int, width: int) -> Float[Tensor, "h w C"]:
    """A tiling image looked up bilinearly at the centres of as many texels; itself if it has them."""
    if tuple(image.shape[:2]) == (height, width):
        return image
    v, u = ((torch.arange(n, dtype=image.dtype) + 0.5) / n for n in (height, width))
    uv = torch.stack(torch.meshgrid(v, u, indexing="ij")[::-1], -1)
    return bilinear(image, uv.reshape(-1, 2), "repeat").reshape(height, width, -1)


def bilinear(
    image: Float[Tensor, "H W C"], uv: Float[Tensor, "P 2"], wrap: Wrap = "clamp"
) -> Float[Tensor, "P C"]:
    """Values of `image` at `uv`, interpolated bilinearly between texel centres.

    Texel (i, j) has its centre at ((j + ½)/W, (i + ½)/H), v down. Outside the square the image is
    continued by its edge (`clamp`) or tiled (`repeat`). Differentiable in `image` and `uv`.
    """
    return Texture.of(image, wrap).at(uv)
