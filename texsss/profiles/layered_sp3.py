"""Exact single scattering and two-mode multiple scattering through N layers: `layered-sp3`, the default.

Multiple scattering is carried by two modes of different mean cosine, coupled by scattering, as in the
SP3 equations; what the modes carry without scattering is the light that scattered once, crudely, and
is replaced by the exact integral. Cosines, boundary coefficients: fitted to half-spaces of index 1 to
1.6, Gauss nodes at 1. One factor per row makes a stack that absorbs nothing lose nothing.
Source: our own; the equations are those of Larsen et al. 2002 with free boundary coefficients.
"""

from dataclasses import replace

import torch

from texsss.media.stack import LayerTable
from texsss.profiles.single import single
from texsss.profiles.slab import (
    CLEAR,
    Coefficients,
    Directions,
    Light,
    ballistic,
    in_blocks,
    layers_of,
    light_in,
)
from texsss.profiles.two_mode_sweep import scattered_twice
from texsss.profiles.two_modes import TwoModes, two_modes
from texsss.types import Float, Tensor

FEW = 1e-6  # multiply scattered light [of what entered] below which its normalisation fades out


def profile(
    table: LayerTable,
    s: Float[Tensor, " S"],
    directions: Directions,
    *,
    side: str,
    scattering: str = "total",
    phase: str = "henyey-greenstein",
) -> Float[Tensor, "S N"]:
    """R̂ or T̂ (`side`) of light that entered in `directions`, per row and channel, flattened to N.

    `scattering`: total, single or multiple. In reflectance single scattering follows `phase`, and the
    multiple part, whose similarity is σs' = σs (1 - g), isotropic, takes up what the reduced and
    isotropic single scattering counts beyond it, spread like itself. Transmittance keeps to the reduced
    coefficients, in which light that is hardly deflected is part of the beam; of it only `single`
    knows `phase`. Differentiable in `table` and `s`.
    """
    if scattering == "single":
        blocks = [single(part, s, directions, side, phase) for part in in_blocks(table)]
    else:
        factor = _furnace(table, directions)
        parts = in_blocks(table)
        lacking = factor.split([part.sigma_a[..., 0, :].numel() for part in parts])
        blocks = [
            _profile(part, s, directions, side, scattering, phase, f)
            for part, f in zip(parts, lacking, strict=True)
        ]
    return torch.cat(blocks, 1)


def _profile(
    table: LayerTable,
    s: Tensor,
    directions: Directions,
    side: str,
    scattering: str,
    phase: str,
    lacking: Tensor,
) -> Tensor:
    """The total or multiple part of one block of rows; `lacking`: the factor of the furnace."""
    if side == "transmittance" or table.isotropic:
        rest = _multiple(table, s, directions, side) * lacking
        return rest if scattering == "multiple" else rest + single(table, s, directions, side)
    zero = s.new_zeros(1)
    rest = _multiple(table, torch.cat([s, zero]), directions, side) * lacking
    rest, whole = rest[:-1], rest[-1:]
    handed = single(table, zero, directions, side) - single(table, zero, directions, side, phase)
    # backward scattering can ask for more than there is
    rest = rest * (1 + handed / (whole + 1e-20)).clamp_min(0)
    return rest if scattering == "multiple" else rest + single(table, s, directions, side, phase)


def _multiple(table: LayerTable, s: Tensor, directions: Directions, side: str) -> Tensor:
    """R̂ or T̂ of light scattered twice or more, in reduced coefficients and before the furnace."""
    if side == "transmittance" and table.bottomless:
        return s.new_zeros(s.shape[0], table.sigma_a[..., 0, :].numel())
    layers = layers_of(table)
    return _swept(layers, light_in(layers, directions), s, side)


def _swept(layers: list[Coefficients], lights: list[list[Light]], s: Tensor, side: str) -> Tensor:
    """What the two modes make of multiple scattering."""
    inner = layers[0].eta
    if side == "transmittance":  # the stack seen from below
        layers = layers[::-1]
        lights = [[light.flipped for light in beams] for beams in reversed(lights)]
    total = s.new_zeros(())
    for weight, *modes in _parameters(inner, layers[0].eta, layers[-1].eta):
        total = total + weight * scattered_twice(layers, lights, s, *modes)
    return total


def _furnace(table: LayerTable, directions: Directions) -> Tensor:
    """What multiple scattering lacks for the same stack without absorption to return all light, (N,)."""
    scattered = table.sigma_a + table.sigma_s * (1 - table.g)
    fields = [table.sigma_a * 0, scattered.clamp_min(CLEAR), table.g * 0, table.thickness]
    white = replace(table.of(fields), known_isotropic=True)
    zero = table.sigma_a.new_zeros(1)
    sides = ("reflectance",) if table.bottomless else ("reflectance", "transmittance")
    have = torch.stack([_multiple(white, zero, directions, side)[0] for side in sides]).sum(0)
    once = torch.stack([single(white, zero, directions, side)[0] for side in sides]).sum(0)
    lacking = 1 - sum(ballistic(white, directions)) - once
    return ((lacking + FEW) / (have + FEW)).clamp(0.5, 2.0)


def _parameters(inner: float, near: float, far: float) -> list[tuple[float, TwoModes, TwoModes, TwoModes]]:
    """Parameter sets of the medium, the near and the far boundary, with their weights."""
    if near == far:
        return [(weight, modes, modes, modes) for weight, modes in two_modes(near)]
    return [
        (u * v, top if inner == near else bottom, top, bottom)
        for u, top in two_modes(near)
        for v, bottom in two_modes(far)
    ]
