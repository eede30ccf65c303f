"""What in a panorama is far brighter than the rest, drawn from as finely as it is painted."""

import math

import torch

from texsss.light import panorama
from texsss.light.emitters import Spots
from texsss.light.panorama import direction, looked_up, place, solid_angle, turned
from texsss.numerics.sampling import Texture
from texsss.types import Float, Tensor

_WIDEST = 4096  # texels that spots are looked for in; larger panoramas are averaged down
_BRIGHT = 4.0  # times the mean radiance: what is brighter belongs to the spots
_LEAST = 0.01  # share of the light that they must have to be looked for


def brightest_of_the_rest(power: Float[Tensor, "h w"]) -> float | None:
    """Radiance above which light belongs to the spots; None where those have little of it.

    `power`: radiance × solid angle.
    """
    whole = float(power.sum(dtype=torch.float64))
    level = _BRIGHT * whole / (4 * math.pi)
    excess = (power - level * solid_angle(*power.shape).to(power)[:, None]).clamp_min(0)
    return level if float(excess.sum(dtype=torch.float64)) > _LEAST * whole else None


def spots_of(image: Float[Tensor, "H W 3"], intensity: float, rotation: float) -> Spots | None:
    """The part of a panorama above four times its mean radiance; None where that is little.

    See `ImageEnvironment` for the arguments. Without gradients.
    """
    power = panorama.power(image.detach().mean(-1, keepdim=True), _WIDEST)[..., 0].to(image)
    height, width = power.shape
    angle = solid_angle(height, width).to(power)[:, None]
    level = brightest_of_the_rest(power)
    if level is None:
        return None
    share = (power - level * angle).clamp_min(0)
    share = share / share.sum(dtype=torch.float64).float()
    bright = (share.reshape(-1) > 0).nonzero()[:, 0]
    upto = share.reshape(-1)[bright].double().cumsum(0)

    texture = Texture.of(share[..., None], "repeat")

    def drawn(square: Float[Tensor, "P 2"]) -> Float[Tensor, "P 3"]:
        u, v = square.double().unbind(-1)
        u = u * upto[-1]
        number = torch.searchsorted(upto, u).clamp_max(len(bright) - 1)
        before = torch.where(number > 0, upto[number - 1], 0.0)
        within = ((u - before) / (upto[number] - before).clamp_min(1e-30)).clamp(0, 1)
        row, column = bright[number] // width, bright[number] % width
        x, y = column + 0.5 + _tent(within), row + 0.5 + _tent(v)
        y = torch.where(y < 0, -y, torch.where(y > height, 2 * height - y, y))
        return turned(direction(torch.stack([x / width, y / height], -1)), rotation).to(square)

    def above(towards: Float[Tensor, "P 3"], radiance: Float[Tensor, "P 3"]) -> tuple[Tensor, Tensor]:
        grey = radiance.detach().mean(-1)
        part = (1 - intensity * level / grey.clamp_min(1e-30)).clamp_min(0)
        uv = place(turned(towards.detach(), -rotation))
        # a texel and an offset from its centre, as a tent: the density is what lies between texels, too
        density = looked_up(texture, uv)[:, 0].to(uv) * (height * width)
        sine = torch.sin(math.pi * uv[:, 1]).clamp_min(1e-4)
        return radiance * part[:, None], density / (2 * math.pi**2 * sine)

    return Spots(drawn, above)


def _tent(uniform: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
    """Numbers in -1..1 with density 1 - |x|."""
    low = uniform < 0.5
    root = torch.sqrt(2 * torch.where(low, uniform, 1 - uniform))
    return torch.where(low, root - 1, 1 - root)
