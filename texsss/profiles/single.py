"""Light that scattered exactly once: R1 and T1 of a stack under collimated beams.

Light that leaves at cosine μ inside is displaced by ν = √(1/μ² - 1) per depth, so that the Hankel
transform of what comes from depth z is J0(s ν z). Cosines are integrated by Gauss quadrature whose
weight is the share that the surface lets out. Exact in half-spaces but for the quadrature; where layers
end, the integral of J0 from there on is a damped oscillation that matches its value and slope.
"""

import math
from functools import lru_cache

import torch

from texsss.media import fresnel
from texsss.media.phase import between_cones
from texsss.media.stack import LayerTable
from texsss.numerics.exponentials import relexp
from texsss.numerics.quadrature import gauss_weighted
from texsss.profiles.slab import Coefficients, Directions, Light, layers_of, light_in, mirror_of, refracted
from texsss.types import Float, Tensor

NODES = 4
_FAR = 40.0  # sideways [1/s], beyond which nothing is left; denormal numbers take ten times longer
# 1 - ∫_0^x J0 and J0 itself as damped oscillations: within .05 for x ≤ 3, which is where both matter
_DAMPING, _TURN = 0.35, 0.72
_SPREAD_FROM = 3.0  # sideways shift [1/s] from which light through a slab is attenuated as in a half-space


def single(
    table: LayerTable,
    s: Float[Tensor, " S"],
    directions: Directions,
    side: str,
    phase: str | None = None,
) -> Float[Tensor, "S N"]:
    """R̂1 or T̂1 (`side`) of light that entered in `directions`, per row and channel, flattened to N.

    `phase` None: the reduced coefficients, isotropic (similarity); a name: the true coefficients with
    that phase function. A free bottom mirrors the beam and the light on its way out.
    Differentiable in `table` and `s`. Source: Hanrahan & Krueger 1993, in Hankel space.
    """
    if side == "transmittance" and table.bottomless:
        return s.new_zeros(s.shape[0], table.sigma_a[..., 0, :].numel())
    layers = layers_of(table) if phase is None else _unreduced(table)
    lights = light_in(layers, directions)
    g = [table.g[..., k, :].reshape(-1) for k in range(len(layers))]
    if phase is not None and table.isotropic:
        phase = None
    if side == "transmittance":  # the stack seen from below
        layers, g = layers[::-1], g[::-1]
        lights = [[light.flipped for light in beams] for beams in reversed(lights)]
    total = s.new_zeros(())
    for mu, weight in _nodes(layers[0].eta):
        cosines = [refracted(mu, layers[0].eta, layer.eta) for layer in layers]
        near, through = _leaving(layers, lights, g, cosines, s[:, None], phase)
        if through is not None:
            behind = [[light.flipped for light in beams] for beams in reversed(lights)]
            far, _ = _leaving(layers[::-1], behind, g[::-1], cosines[::-1], s[:, None], phase)
            # per solid angle at the far face, so that both are of one pencil of light
            far = far * _spread(cosines[-1], layers[-1].eta, mu, layers[0].eta)
            outside = refracted(mu, layers[0].eta, 1.0)
            mirror, other = (mirror_of(outside, layers[k].eta) for k in (0, -1))
            near = (near + other * through * far) / (1 - mirror * other * through**2)
        total = total + weight / 2 * near
    return total


def _leaving(
    layers: list[Coefficients],
    lights: list[list[Light]],
    g: list[Tensor],
    cosines: list[float],
    s: Tensor,
    phase: str | None,
) -> tuple[Tensor, Tensor | None]:
    """Light at the near face that comes out at `cosines`, per cosine there, and the share that passes all.

    The latter is None without a bottom.
    """
    drift = [math.sqrt(max(1 / c**2 - 1, 0)) for c in cosines]  # sideways per depth
    bottom = layers[-1].d is not None
    shifts = [n * layer.d for n, layer in zip(drift, layers, strict=True) if layer.d is not None]
    shift = torch.stack(shifts).sum(0) if bottom else None
    total = s.new_zeros(())
    through = s.new_ones(()) if bottom else None
    above = [torch.ones_like(light.down) for light in lights[0]]  # beam down times light up, to s = 0
    depth = torch.zeros_like(layers[0].sigma)  # [mm] sideways
    wave = None  # the damped oscillation, and what its slope adds
    for layer, beams, k, cosine, n in zip(layers, lights, g, cosines, drift, strict=True):
        spread = _spread(cosines[0], layers[0].eta, cosine, layer.eta)
        b, escape = s * n, layer.sigma / cosine
        b2 = b * b
        start = wave
        if layer.d is not None:
            depth = depth + n * layer.d
            x = (s * depth).clamp_max(_FAR)
            damped = torch.exp(-_DAMPING * x)
            swing = damped * (torch.sin(_TURN * x) / _TURN)
            wave = damped * torch.cos(_TURN * x) + _DAMPING * swing, swing
        for i, light in enumerate(beams):
            a = light.sigma + escape
            root = torch.sqrt(b2 + a * a)
            slope = b / (root + a)
            strength = (
                spread * _deflection(phase, light.cosine, -cosine, k) * light.source * lights[0][i].down
            )
            here = (strength * above[i]) * _beyond(slope, start)
            if layer.d is not None:
                above[i] = above[i] * torch.exp(-a * layer.d)
                here = here - (strength * above[i]) * _beyond(slope, wave)
            total = total + here / root
        if bottom:
            assert shift is not None and through is not None and layer.d is not None
            aside = s * shift
            out = escape + (torch.sqrt(escape**2 + b2) - escape) * (aside / (aside + _SPREAD_FROM))
            passed = torch.exp(-out * layer.d)
            for light in beams:
                assert light.up is not None and light.beam is not None
                strength = spread * _deflection(phase, light.cosine, cosine, k) * light.source * light.up
                mirrored = torch.maximum(light.beam, passed) * relexp((light.sigma - out).abs() * layer.d)
                total = total + strength * layer.d * through * mirrored
            through = through * passed
    return total, through


def _beyond(slope: Tensor, wave: tuple[Tensor, Tensor] | None) -> Tensor | float:
    """∫ J0(b (Z + z)) e^(-az) dz √(a² + b²) by the oscillation at Z, `slope` = (√(a² + b²) - a) / b."""
    if wave is None:
        return 1.0
    return torch.addcmul(wave[0], slope, wave[1], value=-1)


def _deflection(phase: str | None, first: float, second: float, g: Tensor) -> Tensor | float:
    """4π times the phase function between cones at two cosines; 1 if it is round."""
    return 1.0 if phase is None else 4 * math.pi * between_cones(phase, first, second, g)


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
