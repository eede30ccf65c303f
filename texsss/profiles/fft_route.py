"""Layers combined by Fourier transforms of profiles on a square grid: the slow reference for `multipole`.

This is the way of the published method before its grid of Gaussians: sample R(r) and T(r) of every
layer in space, transform, combine per frequency, and transform back. `multipole` has the transforms in
closed form instead.
Source: Donner & Jensen 2005, section 4; Mayorga 2008, who gives .118 s per sample for it.
"""

import math

import torch

from texsss.errors import DomainError
from texsss.media.stack import LayerTable
from texsss.profiles.dipole import pole
from texsss.profiles.multipole import PAIRS, Slab, lengths, neighbours, poles_of
from texsss.profiles.slab import TINY, layers_of
from texsss.types import Float, Tensor


def fft_combined(
    table: LayerTable, step_mm: float, size: int, pairs: int = PAIRS
) -> tuple[Float[Tensor, " S"], Slab]:
    """Frequencies [1/mm] along one axis of the grid, and the profiles of the whole stack there, (S, N).

    A single row of layers, on `size` × `size` points `step_mm` apart: the step must resolve the mean free
    path, and the grid hold the profile. Layers thinner than a mean free path mean nothing here.
    Differentiable in the coefficients. Raises DomainError: for grids without points or width.
    """
    if size < 2 or not (math.isfinite(step_mm) and step_mm > 0):
        raise DomainError(
            f"fft_combined: expected at least 2 points, a step > 0 [mm] apart, got {size} and {step_mm:g}; "
            "256 points, a quarter of a mean free path apart, serve well."
        )
    layers = layers_of(table)
    home = layers[0].sigma
    x = torch.fft.fftfreq(size, 1 / size, dtype=home.dtype, device=home.device) * step_mm
    r = torch.hypot(x[:, None], x[None, :])[..., None]  # (size, size, 1)

    def transformed(poles: list[tuple[Tensor, float]], albedo: Tensor, sigma_tr: Tensor) -> Tensor:
        profile = sum(sign * pole(r, z, sigma_tr) for z, sign in poles) * (albedo / 2)
        assert isinstance(profile, Tensor)
        # even in both directions: real, and one row of the spectrum is the Hankel transform
        return torch.fft.fft2(profile, dim=(0, 1)).real[0, : size // 2 + 1] * step_mm**2

    whole: Slab | None = None
    for k in reversed(range(len(layers))):
        layer = layers[k]
        above, below = neighbours(table.eta, k)
        l, z_b0, z_bd = lengths(layer.sigma, above, below)
        sigma_tr = torch.sqrt(3 * layer.sigma_a * layer.sigma + TINY)
        albedo = layer.sigma_s * l
        if layer.d is None:
            R = transformed([(l, 1.0), (-l - 2 * z_b0, -1.0)], albedo, sigma_tr)
            slab = Slab(R, torch.zeros_like(R), torch.zeros_like(R), torch.zeros_like(R))
        else:
            sides = (
                *poles_of(l, layer.d, z_b0, z_bd, pairs),
                *poles_of(l, layer.d, z_bd, z_b0, pairs),
            )
            slab = Slab(*(transformed(poles, albedo, sigma_tr) for poles in sides))
        whole = slab if whole is None else slab.over(whole)
    assert whole is not None, "a stack has layers"
    s = 2 * math.pi * torch.arange(size // 2 + 1, dtype=home.dtype, device=home.device) / (size * step_mm)
    return s, whole
