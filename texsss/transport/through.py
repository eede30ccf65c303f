"""Light that crosses an object: the far side's blurred light looked up, and kept out of the near side's."""

from dataclasses import dataclass

import torch

from texsss.light.thickness import FarSide
from texsss.numerics.sampling import bilinear
from texsss.profiles.weights import Weights
from texsss.surface.points import TexelMaps
from texsss.transport.bank import Bank, Diffusion, exitance
from texsss.types import Cancel, Float, Tensor

LEAST_SHARE = 0.1  # of a Gaussian that must lie on the near side for its mean to be taken there alone


@dataclass(frozen=True, eq=False)
class Across:
    """Values at the texels as seen from the far side: `of` looks them up there, bilinearly."""

    far: FarSide
    texels: TexelMaps

    def of(self, values: Float[Tensor, "K P C"]) -> Float[Tensor, "K P C"]:
        """`values` at the far side of every texel; 0 without one. Differentiable."""
        uv = self.far.points.uv(self.texels.atlas_uv).to(values)
        share = (self.far.opposite * self.far.found)[:, None].to(values)
        return torch.stack([bilinear(self.texels.to_image(copy), uv) * share for copy in values])


def transmitted(
    bank: Bank,
    passed: Weights,
    across: Across,
    rule: str = "exit",
    *,
    blur: Diffusion | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "P C"]:
    """Exitance of light that entered on the far side [W/m²]: Σ_k t_k (G(v_k) * E) there.

    `passed`: weights of the transmitted profile at every texel. `rule`, `blur`: as in `exitance`, of the
    near side's texels. Differentiable in the bank and in the weights' table. Raises as `exitance`.
    Source: d'Eon & Luebke 2007 (modified translucent shadow maps).
    """

    def both(values: Tensor, variances: Tensor) -> Tensor:
        assert blur is not None, "asked for by rules that come with a blur"
        return across.of(blur(values, variances))

    beyond = Bank(bank.variances, bank.irradiance, across.of(bank.values))
    return exitance(beyond, passed, rule, blur=None if blur is None else both, cancel=cancel)


def on_one_side(blur: Diffusion, normal: Float[Tensor, "P 3"]) -> Diffusion:
    """`blur` in which pairs of points count by how far they face the same way, ½ (1 + n·n').

    Linear in both normals, so it is the blur of light and of light × normal. What is left is scaled to
    keep constants, but where next to nothing faces the same way. Differentiable in the values.
    """

    def faced(values: Tensor, variances: Tensor) -> Tensor:
        unit = normal.to(values)
        share = 1 + (blur(unit, variances) * unit).sum(-1, keepdim=True)
        light = blur(values, variances)
        # a column at a time: grey light stays grey, and three columns are blurred fastest
        for along in unit[:, :, None].unbind(1):
            light = torch.addcmul(light, blur(values * along, variances), along)
        return light / share.clamp_min(2 * LEAST_SHARE)

    return faced
