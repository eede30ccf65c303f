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
from texsss.profiles.slab import Coefficients, Light, layers_of, light_in, refracted
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
        cosines = [refracted(mu, layers[0].eta, layer.eta) for layer in layers]
        ways = [_Way(s, c, light, x, phase) for c, light, x in zip(cosines, lights, g, strict=True)]
        near, through = _leaving(layers, lights, ways)
        if not table.bottomless:
            far, _ = _leaving(layers[::-1], seen_from_behind, ways[::-1])
            # per solid angle at the far face, so that both are of one pencil of light
            far = far * _spread(cosines[-1], layers[-1].eta, mu, layers[0].eta)
            outside = refracted(mu, layers[0].eta, 1.0)
            mirror, other = (fresnel.reflectance(outside, layers[k].eta) for k in (0, -1))
            near = (near + other * through * far) / (1 - mirror * other * through**2)
        total = total + weight / 2 * near
    return total


class _Way:
    """How light leaves one layer: its cosine, its sideways drift and the phase function towards it."""

    def __init__(self, s: Tensor, cosine: float, light: Light, g: Tensor, phase: str | None):
        self.cosine = cosine
        self.sideways = s[:, None] ** 2 * (1 / cosine**2 - 1)
        self.forward, self.backward = (
            4 * math.pi * between_cones(phase or "isotropic", light.cosine, c, g) for c in (cosine, -cosine)
        )


def _leaving(layers: list[Coefficients], lights: list[Light], ways: list[_Way]) -> tuple[Tensor, Tensor]:
    """Light at the near face that comes out along `ways`, per cosine there, and the share that passes all."""
    total = ways[0].sideways.new_zeros(())
    through = ways[0].sideways.new_ones(())  # from the near face to here
    joint = lights[0].down  # the same together with the beam that comes in
    for layer, light, way in zip(layers, lights, ways, strict=True):
        spread = _spread(ways[0].cosine, layers[0].eta, way.cosine, layer.eta)
        out = torch.sqrt((layer.sigma / way.cosine) ** 2 + way.sideways)
        both = torch.sqrt((light.sigma + layer.sigma / way.cosine) ** 2 + way.sideways)
        source = spread * light.source
        if layer.d is None:
            return total + source * way.backward * joint / both, through * 0
        returned = way.backward * joint * layer.d * relexp(both * layer.d)
        passed = torch.exp(-out * layer.d)
        mirrored = way.forward * light.up * through * torch.maximum(light.beam, passed) * layer.d
        total = total + source * (returned + mirrored * relexp((light.sigma - out).abs() * layer.d))
        through = through * passed
        joint = joint * torch.exp(-both * layer.d)
    return total, through


def _spread(near: float, eta_near: float, far: float, eta_far: float) -> float:
    """dμ_far / dμ_near of one pencil of light across a change of index."""
    return near * eta_near**2 / (far * eta_far**2)


def _unreduced(table: LayerTable) -> list[Coefficients]:
    return layers_of(table.of([table.sigma_a, table.sigma_s, torch.zeros_like(table.g), table.thickness]))


@lru_cache(maxsize=64)
def _nodes(eta: float) -> tuple[tuple[float, float], ...]:
    """Cosines inside, and weights, of light that the surface lets out."""
    critical = math.sqrt(1 - 1 / eta**2)

    def let_out(mu):
        outside = torch.tensor([refracted(float(m), eta, 1.0) for m in mu], dtype=torch.float64)
        return fresnel.transmittance(outside, eta).numpy()

    mu, weight = gauss_weighted(let_out, critical, 1.0, NODES)
    return tuple((float(m), float(w)) for m, w in zip(mu, weight, strict=True))
