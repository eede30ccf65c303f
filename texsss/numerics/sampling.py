"""Bilinear look-ups in images, with texsss' convention for texel centres."""

from dataclasses import dataclass
from typing import Literal

from torch.nn.functional import grid_sample, pad

from texsss.types import Float, Tensor

Wrap = Literal["clamp", "repeat"]


@dataclass(frozen=True, eq=False)
class Texture:
    """An image laid out for many look-ups; make it by `Texture.of`.

    `planes`: one plane per channel; with `repeat` a texel of the opposite edge lies around them.
    """

    planes: Float[Tensor, "1 C h w"]
    wrap: Wrap

    @classmethod
    def of(cls, image: "Float[Tensor, 'H W C'] | Texture", wrap: Wrap = "clamp") -> "Texture":
        """`image` outside of whose square its edge goes on (`clamp`) or it is tiled (`repeat`)."""
        if isinstance(image, Texture):
            return image
        planes = image.permute(2, 0, 1)[None]
        return cls(
            pad(planes, (1, 1, 1, 1), mode="circular") if wrap == "repeat" else planes.contiguous(), wrap
        )

    def at(self, uv: Float[Tensor, "P 2"]) -> Float[Tensor, "P C"]:
        """Values interpolated between texel centres; see `bilinear`."""
        place = 2 * uv - 1
        if self.wrap == "repeat":
            height, width = self.planes.shape[2:]
            # the square of one tile, as a share of what `planes` hold
            inner = uv.new_tensor([(width - 2) / width, (height - 2) / height])
            place = (2 * (uv - uv.detach().floor()) - 1) * inner
        grid = place.to(self.planes.dtype)[None, None]
        found = grid_sample(self.planes, grid, mode="bilinear", padding_mode="border", align_corners=False)
        return found[0, :, 0].T.contiguous()


def bilinear(
    image: Float[Tensor, "H W C"], uv: Float[Tensor, "P 2"], wrap: Wrap = "clamp"
) -> Float[Tensor, "P C"]:
    """Values of `image` at `uv`, interpolated bilinearly between texel centres.

    Texel (i, j) has its centre at ((j + ½)/W, (i + ½)/H), v down. Outside the square the image is
    continued by its edge (`clamp`) or tiled (`repeat`). Differentiable in `image` and `uv`.
    """
    return Texture.of(image, wrap).at(uv)
