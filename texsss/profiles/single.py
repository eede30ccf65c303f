"""Light that scattered exactly once: R1 and T1 of a stack under a collimated beam.

Light that leaves at cosine μ inside is displaced by ν = √(1/μ² - 1) per depth, so that in Hankel space
a layer attenuates by √(σ²/μ² + s² ν²) per depth. Cosines are integrated by Gauss quadrature whose
weight is the share that the surface lets out. Exact in half-spaces but for the quadrature.
"""

import math
from functools import lru_cache

import torch

from texsss.media import fresnel
from texsss.media.phase import between_cones
from texsss.media.stack import LayerTable
from texsss.numerics.exponentials import relexp
from texsss.numerics.quadrature import gauss_weighted
from texsss.profiles.slab import Coefficients, Light, layers_of, light_in, outer_cosine
from texsss.types import Float, Tensor

NODES = 4


def single(
    table: LayerTable, s: Float[Tensor, " S"], cosine: float, side: str, phase: str | None = None
) -> Float[Tensor, "S N"]:
    """R̂1 or T̂1 (`side`) of light that entered at `cosine` inside, per row and channel, flattened to N.

    `phase` None: the reduced coefficients, isotropic (similarity); a name: the true coefficients with
    that phase function. A free bottom mirrors the beam and the light on its way out.
    Differentiable in `table` and `s`. Source: Hanrahan & Krueger 1993, in Hankel space.
    """
    if side == "transmittance" and table.bottomless:
        return s.new_zeros(s.shape[0], table.sigma_a[..., 0, :].numel())
    layers = layers_of(table) if phase is None else _unreduced(table)
    lights = light_in(layers, cosine)
    g = [table.g[..., k, :].reshape(-1) for k in range(len(layers))]
    if side == "transmittance":  # the stack seen from below
        layers, lights, g = layers[::-1], [light.flipped for light in reversed(lights)], g[::-1]
    seen_from_behind = [light.flipped for light in reversed(lights)]
    total = s.new_zeros(())
    for mu, weight in _nodes(layers[0].eta):
        sideways = s[:, None] ** 2 * (1 / mu**2 - 1)
        forward, backward = (
            [4 * math.pi * between_cones(phase or "isotropic", cosine, c, x) for x in g] for c in (mu, -mu)
        )
        near, through = _leaving(layers, lights, sideways, mu, forward, backward)
        if not table.bottomless:
            far, _ = _leaving(layers[::-1], seen_from_behind, sideways, mu, forward[::-1], backward[::-1])
            mirror, other = (
                fresnel.reflectance(outer_cosine(mu, layers[k].eta), layers[k].eta) for k in (0, -1)
            )
            near = (near + other * through * far) / (1 - mirror * other * through**2)
        total = total + weight / 2 * near
    return total


def _leaving(
    layers: list[Coefficients],
    lights: list[Light],
    sideways: Tensor,
    mu: float,
    forward: list[Tensor],
    backward: list[Tensor],
) -> tuple[Tensor, Tensor]:
    """Light at the near face that comes out at cosine `mu`, and what passes the whole stack there."""
    total = sideways.new_zeros(())
    through = sideways.new_ones(())  # from the near face to here
    joint = lights[0].down  # the same together with the beam that comes in
    for k, (layer, light) in enumerate(zip(layers, lights, strict=True)):
        way = torch.sqrt((layer.sigma / mu) ** 2 + sideways)
        both = torch.sqrt((light.sigma + layer.sigma / mu) ** 2 + sideways)
        if layer.d is None:
            return total + light.source * backward[k] * joint / both, sideways.new_zeros(())
        returned = backward[k] * joint * layer.d * relexp(both * layer.d)
        passed = torch.exp(-way * layer.d)
        mirrored = forward[k] * light.up * through * torch.maximum(light.beam, passed) * layer.d
        total = total + light.source * (returned + mirrored * relexp((light.sigma - way).abs() * layer.d))
        through = through * passed
        joint = joint * torch.exp(-both * layer.d)
    return total, through


def _unreduced(table: LayerTable) -> list[Coefficients]:
    return layers_of(table.of([table.sigma_a, table.sigma_s, torch.zeros_like(table.g), table.thickness]))


@lru_cache(maxsize=64)
def _nodes(eta: float) -> tuple[tuple[float, float], ...]:
    """Cosines inside, and weights, of light that the surface lets out."""
    critical = math.sqrt(1 - 1 / eta**2)

    def let_out(mu):
        outside = torch.tensor([outer_cosine(float(m), eta) for m in mu], dtype=torch.float64)
        return fresnel.transmittance(outside, eta).numpy()

    mu, weight = gauss_weighted(let_out, critical, 1.0, NODES)
    return tuple((float(m), float(w)) for m, w in zip(mu, weight, strict=True))
