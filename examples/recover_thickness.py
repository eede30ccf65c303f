"""A thickness map recovered from the light that a layered skin gives off: the weights are differentiable.

    python examples/recover_thickness.py

A flat patch of skin2, .15 to 1.5 mm thick, lies on blood-filled tissue and is lit by stripes. From its
exitance alone (and the media and the light) L-BFGS finds the thickness, starting from .6 mm everywhere.
"""

import math

import torch

from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.project import variance_ladder
from texsss.profiles.weights import weights_for

SIZE, TEXEL_MM = 48, 0.5
TISSUE = Medium([0.25, 1.2, 1.0], [1.2, 1.3, 1.4], 0.0, 1.3)
STEPS = 40


def blurred(light: torch.Tensor, variances: torch.Tensor) -> torch.Tensor:
    """The light (H, W, 1), convolved with unit Gaussians on a patch that tiles, (K, H·W, 1)."""
    s = 2 * math.pi * torch.fft.fftfreq(SIZE, TEXEL_MM, dtype=light.dtype)
    s2 = (s[:, None] ** 2 + s[None, :] ** 2)[..., None]
    spectrum = torch.fft.fft2(light, dim=(0, 1))
    copies = [torch.fft.ifft2(spectrum * torch.exp(-v * s2 / 2), dim=(0, 1)).real for v in variances]
    return torch.stack(copies).reshape(len(variances), -1, 1)


def exitance(thickness: torch.Tensor, bank: torch.Tensor, ladder: torch.Tensor) -> torch.Tensor:
    """What every texel gives off, (H·W, 3) [W/m²]."""
    stack = Stack([Layer(preset("skin2"), thickness), Layer(TISSUE)])
    weights = weights_for(stack, ladder, model="layered-diffusion", levels=None, dtype=torch.float64)
    return torch.einsum("pkc,kpc->pc", weights.at(), bank.expand(-1, -1, 3))


def recovered(seen: torch.Tensor, bank: torch.Tensor, ladder: torch.Tensor) -> torch.Tensor:
    """The thickness map [mm] whose exitance is `seen`."""
    logarithm = torch.full((SIZE, SIZE), math.log(0.6), dtype=torch.float64, requires_grad=True)
    search = torch.optim.LBFGS([logarithm], max_iter=STEPS, line_search_fn="strong_wolfe")

    def step() -> torch.Tensor:
        search.zero_grad()
        error = ((exitance(logarithm.exp(), bank, ladder) - seen) ** 2).sum()
        error.backward()
        return error

    search.step(step)
    return logarithm.detach().exp()


def main() -> None:
    y, x = torch.meshgrid(*[torch.arange(SIZE, dtype=torch.float64) * 2 * math.pi / SIZE] * 2, indexing="ij")
    true = 0.15 + 1.35 * (0.5 + 0.25 * torch.sin(2 * x) * torch.cos(y) + 0.25 * torch.cos(3 * y + x)).clamp(
        0, 1
    )
    ladder = variance_ladder(TEXEL_MM, SIZE * TEXEL_MM, 6)
    light = (1 + 0.8 * torch.sin(4 * x))[..., None]
    bank = blurred(light, ladder)
    found = recovered(exitance(true, bank, ladder), bank, ladder)
    wrong = (found / true - 1).abs()
    mean, worst = 100 * float(wrong.mean()), 100 * float(wrong.max())
    print(f"thickness .15 to 1.5 mm: error {mean:.4f} % on average, {worst:.2f} % at worst")


if __name__ == "__main__":
    main()
