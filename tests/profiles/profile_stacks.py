"""Reference stacks as those of texsss, and random ones."""

import math

import numpy as np
import torch
from reference import layers as reference
from reference import sp3

from texsss.media.medium import Medium
from texsss.media.stack import Layer, LayerTable, Stack
from texsss.profiles.hankel import hankel_profiles

ALIKE = [
    reference.Layer(0.1, 1.0, 0.2, eta=1.5),
    reference.Layer(0.4, 0.7, 0.1, eta=1.5),
    reference.Layer(0.01, 1.09, 0.4, eta=1.5),
]


def stack_of(layers: list[reference.Layer]) -> Stack:
    """The same layers as a Stack of one channel, float64."""
    return Stack(
        [
            Layer(
                Medium(row.sigma_a, row.sigma_s, row.g, row.eta),
                None if math.isinf(row.thickness) else row.thickness,
            )
            for row in layers
        ]
    )


def dense_multiple(layers: list[reference.Layer], s: torch.Tensor) -> list[np.ndarray]:
    """R and T of two modes by collocation, with our single scattering, under a beam, up to one factor."""
    once = hankel_profiles(stack_of(layers), s, incidence="normal", scattering="single")
    return sp3.scattered_more(layers, s.numpy(), [x[:, 0].numpy() for x in once])


def random_table(rows: int, layers: int, bottomless: bool, eta: float, seed: int) -> LayerTable:
    """Rows of random layers: sigma_a 0 to 3, sigma_s' .01 to 30 [1/mm], .005 to 20 mm thick."""
    generator = torch.Generator().manual_seed(seed)

    def spread(low: float, high: float) -> torch.Tensor:
        x = torch.rand(rows, layers, 3, generator=generator, dtype=torch.float64)
        return low * (high / low) ** x

    sigma_a = spread(1e-5, 3) * (torch.rand(rows, layers, 3, generator=generator) > 0.1)
    thickness = spread(0.005, 20)
    if bottomless:
        thickness[:, -1] = math.inf
    g = torch.zeros(rows, layers, 3, dtype=torch.float64)
    return LayerTable(sigma_a, spread(0.01, 30), g, thickness, (eta,) * layers, bottomless)
