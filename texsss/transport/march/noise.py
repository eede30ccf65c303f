"""Noise that hides the steps of point sampling."""

from dataclasses import dataclass

import torch

from texsss.errors import DomainError, ShapeError
from texsss.numerics.sampling import bilinear
from texsss.types import Float, Tensor

LOOKUPS = 4  # how often the texture is read at the place that it named before


@dataclass(frozen=True, eq=False)
class Noise:
    """Jitter of the march per point, in -1..1 times a scale.

    `uv`: scale of the shift of texture coordinates [uv]. `start`: scale of the shift of uniform
    samples, as a share of their distance. `texture` (H, W), values 0..1: where numbers come from
    instead of a seeded generator, so that they stick to the surface while the camera moves.
    Raises DomainError: for scales that are negative or not finite; ShapeError: for other textures.
    Source: Norberg 2010, 3.1.2.
    """

    uv: float = 0.0
    start: float = 0.0
    texture: Float[Tensor, "H W"] | None = None

    def __post_init__(self):
        for name in ("uv", "start"):
            scale = getattr(self, name)
            if not 0 <= scale < float("inf"):
                raise DomainError(
                    f"Noise: expected a finite {name} >= 0, got {scale:g}; 0 is none, 1 all of it."
                )
        if self.texture is not None and (self.texture.ndim != 2 or self.texture.numel() == 0):
            raise ShapeError(
                f"Noise: expected a texture (H, W), got {tuple(self.texture.shape)}; take one channel of it."
            )
        if self.texture is not None and not bool(torch.isfinite(self.texture).all()):
            raise DomainError("Noise: expected a finite texture, got NaN or infinity; repair the image.")


def draw(noise: Noise, uv: Float[Tensor, "P 2"], generator: torch.Generator) -> Float[Tensor, "P 3"]:
    """Shift of u and v [uv], and of the start [share of a step], per point.

    From the texture, which is read again at the place that the last reading named, or from `generator`.
    """
    if noise.texture is None:
        raw = torch.rand(len(uv), 3, generator=generator).to(uv)
    else:
        image = noise.texture.to(uv)[..., None]
        readings = []
        place = uv
        for _ in range(LOOKUPS + 3):
            readings.append(bilinear(image, place, wrap="repeat")[:, 0])
            # golden ratio: two coordinates out of one value
            place = torch.frac(torch.stack([readings[-1] * 7.618034, readings[-1] * 61.8034], -1) + uv)
        raw = torch.stack(readings[-3:], -1)
    return (2 * raw - 1) * raw.new_tensor([noise.uv, noise.uv, noise.start])
