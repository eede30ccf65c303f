"""Light that scattered exactly once: R1 and T1 of a stack under collimated beams.

Light that leaves at cosine μ inside is displaced by ν = √(1/μ² - 1) per depth, so that the Hankel
transform of what comes from depth z is J0(s ν z). Cosines are integrated by Gauss quadrature whose
weight is the share that the surface lets out. Light from all around is displaced on its way in, too: by both
ways together √(ν² + ν'² + 2 ν ν' cos φ) per depth, at an azimuth φ between them that is another for every
pair of cosines. Exact in half-spaces but for the quadrature; where layers end, the integral of J0 from there
on is a damped oscillation that matches its value and slope.
"""

import math
from functools import cache
from typing import NamedTuple, no_type_check

import torch

from texsss.media import fresnel
from texsss.media.phase import between_cones
from texsss.numerics.quadrature import gauss_weighted
from texsss.profiles.modes import overlap
from texsss.profiles.slab import FAR, added, flipped, mirrors, refracted
from texsss.types import Tensor

NODES = 4
# cos φ per cosine out, by direction in, where these are two or three: four angles, each once per direction.
# Of all orders these meet ∫ e^(-az) J0(bz) J0(cz) dz = 1 / agm(√(a² + (b + c)²), √(a² + (b - c)²)) best, in
# the metric of d'Eon et al. 2007 to .9 % of R̂1 at eta 1.2 to 1.5 and 2.6 % at 1 to 1.1
_COSINES = [math.cos((k + 0.5) * math.pi / NODES) for k in range(NODES)]
AZIMUTHS = {
    count: [[_COSINES[k] for k in order] for order in orders]
    for count, orders in (
        (2, ((1, 2, 0, 3), (2, 1, 3, 0))),
        (3, ((2, 3, 1, 0), (1, 2, 0, 3), (0, 1, 3, 2))),
    )
}
# 1 - ∫_0^x J0 and J0 itself as damped oscillations, whose integral is 1 like that of J0: R̂1 beneath clear
# films is within .02 of R̂(0) for a beam
_DAMPING = 0.45
_TURN = math.sqrt(2 * _DAMPING - _DAMPING**2)
LEAST = 1e-12  # frequency [1/mm]
LEAST_DRIFT = 1e-6
_SPREAD_FROM = 3.0  # sideways shift [1/s] from which light through a slab is attenuated as in a half-space


class Shaft(NamedTuple):
    """A beam in one layer, scattered towards one node, (1, N) each."""

    squared: Tensor  # attenuation per depth, in and out, squared [1/mm²]
    slant: Tensor  # the attenuation over the leg's drift [1/mm]
    start: Tensor  # strength at the top of the layer
    end: Tensor | None  # and at its bottom


class Bounced(NamedTuple):
    """A beam from below in one layer, scattered towards one node, (1, N) each."""

    tau: Tensor
    beam: Tensor
    strength: Tensor


class Leg(NamedTuple):
    """The way out through one layer."""

    drift: Tensor  # sideways per depth, a number
    aside: Tensor | None  # sideways from the face to the bottom of the layer [mm] (1, N)
    d: Tensor | None
    escape: Tensor  # attenuation per depth on the way out [1/mm] (1, N)
    shafts: tuple[Shaft, ...]
    over: Tensor | None  # what all shafts end with, less what those of the next layer start with, over drifts
    bounced: tuple[Bounced, ...]
    two: Tensor  # a number


class Node(NamedTuple):
    """One cosine of light that leaves, and one or all of light that enters.

    The ways out by the near face, and by the far one to be mirrored.
    """

    near: tuple[Leg, ...]
    far: tuple[Leg, ...] | None
    mirrored: Tensor  # reflectance of the far face, and of both: numbers
    again: Tensor


@no_type_check
def prepare(layers, lights, phase, around=False):
    """All of the light that leaves by the first of `layers` that does not depend on the frequency.

    `phase` None: isotropic; else one of PHASES with the layers' g, and these have true coefficients.
    `around`: whether the lights are those of diffuse light, two or three directions, that comes in by this
    face; else that they come in aslant is left out. A free bottom mirrors the beam and the light on its way
    out, unless `lights` are not mirrored. Differentiable. Source: Hanrahan & Krueger 1993, in Hankel space.
    """
    nodes = []
    for i, (mu, weight, mirrored, again) in enumerate(exits(layers[0].eta, layers[-1].eta)):
        cosines = [refracted(mu, layers[0].eta, layer.eta) for layer in layers]
        for beams, turn in _groups(lights, i, around):
            near, far = _legs(layers, beams, cosines, phase, weight / 2, turn), None
            if lights[0][0].up is not None:
                # what is per cosine at the far face, per cosine at the near one: one pencil of light
                share = weight / 2 * _spread(mu, layers[0].eta, cosines[-1], layers[-1].eta)
                far = _legs(layers[::-1], flipped(beams), cosines[::-1], phase, share, turn)
            number = layers[0].sigma.new_full
            nodes.append(Node(near, far, number((), mirrored), number((), again)))
    return tuple(nodes)


@no_type_check
def _groups(lights, way_out, around):
    """Lights that are displaced alike, and cos φ of their way in to the way out; None: not displaced."""
    if not around:
        return [(lights, None)]
    turns = AZIMUTHS[len(lights[0])]
    return [([[beams[i]] for beams in lights], turn[way_out]) for i, turn in enumerate(turns)]


def displaced(out: float, into: float, turn: float | None) -> float:
    """Sideways per depth of light that leaves at cosine `out` and came at `into`, unless that is left out."""
    squared = 1 / out**2 - 1
    if turn is not None:
        there = 1 / into**2 - 1
        squared += there + 2 * turn * max(squared * there, 0) ** 0.5
    return max(squared, LEAST_DRIFT**2) ** 0.5


@no_type_check
def _legs(layers, lights, cosines, phase, weight, turn):
    """Ways out at `cosines` by the face of the first layer, per cosine there."""
    mirrored = lights[0][0].up is not None
    above = [light.down * weight for light in lights[0]]  # beam down times light up, to s = 0
    aside = torch.zeros_like(layers[0].sigma)
    legs = []
    for layer, beams, cosine in zip(layers, lights, cosines):
        drift = displaced(cosine, beams[0].cosine, turn)
        spread = _spread(cosines[0], layers[0].eta, cosine, layer.eta)
        escape = layer.sigma / cosine
        if layer.d is not None:
            aside = aside + drift * layer.d
        shafts, bounced = [], []
        for i, light in enumerate(beams):
            a = light.sigma + escape
            source = light.source * (spread * _deflection(phase, light.cosine, -cosine, layer.g))
            start, end = source * above[i], None
            if layer.d is not None:
                above[i] = above[i] * torch.exp(-(a * layer.d).clamp_max(FAR))
                end = source * above[i]
            shafts.append(Shaft(a * a, a / drift, start, end))
            if mirrored:
                source = light.source * (weight * spread * _deflection(phase, light.cosine, cosine, layer.g))
                bounced.append(Bounced(light.sigma * layer.d, light.beam, source * layer.d * light.up))
        if legs:
            legs[-1] = legs[-1]._replace(over=legs[-1].over - added([x.start for x in shafts]) / drift)
        over = None if layer.d is None else added([x.end for x in shafts]) / drift
        way = None if layer.d is None else aside
        number, two = escape.new_full((), drift), escape.new_full((), 2.0)
        legs.append(Leg(number, way, layer.d, escape, tuple(shafts), over, tuple(bounced), two))
    return tuple(legs)


@no_type_check
def scattered_once(nodes, s):
    """R̂1 or T̂1 per frequency, row and channel (S, N); `s`: frequencies (S, 1)."""
    s = s.clamp_min(LEAST)
    total = None
    for node in nodes:
        near, through = _leaving(node.near, s, total)
        if node.far is not None:
            far, _ = _leaving(node.far, s, None)
            near = (near + node.mirrored * through * far) / (1 - node.again * through * through)
            near = near if total is None else total + near
        total = near
    return total


@no_type_check
def _leaving(legs, s, total):
    """Light at the near face, added to `total` where nothing is mirrored, and the share that passes all.

    What comes from below depth Z, ∫ J0(b z) e^(-a(z - Z)) dz with b = s drift and J0 from Z on as the
    oscillation w there, is (w + a W) / √(a² + b²) - W, W = (∫_0^Z J0 - 1 + w) / b.
    """
    slab = bool(legs[-1].bounced)
    total = None if slab else total
    wave, area, through = None, None, 1.0  # the oscillation where the layer begins, and W times the drift
    if slab:
        shift = s * legs[-1].aside
        shift = shift / (shift + _SPREAD_FROM)
    for leg in legs:
        b2 = (s * leg.drift) ** 2
        first, before = wave, area
        if leg.d is not None:
            turn = torch.clamp((s * _TURN) * leg.aside, max=FAR * _TURN)
            damped = torch.exp(turn * (-_DAMPING / _TURN))
            area = (damped * torch.sin(turn)).mul_(1 / (_TURN * s))
            wave = torch.addcmul(damped * torch.cos(turn), s * _DAMPING, area)
        for shaft in leg.shafts:
            here = shaft.start
            if first is not None:
                here = here * torch.addcmul(first, shaft.slant, before)
            if leg.d is not None:
                here = torch.addcmul(here, shaft.end, torch.addcmul(wave, shaft.slant, area), value=-1)
            root = (shaft.squared + b2).rsqrt_()
            total = here * root if total is None else torch.addcmul(total, here, root)
        if leg.d is not None:
            total = torch.addcmul(total, leg.over, area)
        if slab:
            root = torch.sqrt(leg.escape * leg.escape + b2)
            m = torch.lerp(leg.escape.expand_as(root), root, shift) * leg.d
            passed = torch.clamp(m, max=FAR).neg_().exp_()
            for ray in leg.bounced:
                total = total + ray.strength * through * overlap(passed, ray.beam, ray.tau - m, leg.two)
            through = through * passed
    return total, through


@no_type_check
def _deflection(phase, first, second, g):
    """4π times the phase function between cones at two cosines; 1 if it is round."""
    return 1.0 if phase is None else 4 * math.pi * between_cones(phase, first, second, g)


@no_type_check
def _spread(near, eta_near, far, eta_far):
    """dμ_far / dμ_near of one pencil of light across a change of index."""
    return near * eta_near**2 / (far * eta_far**2)


@cache
def exits(near: float, far: float) -> tuple[tuple[float, float, float, float], ...]:
    """Light that the near face lets out: cosines inside, weights, what the far face mirrors, and both.

    `near`, `far`: indices within the two faces.
    """
    found = []
    for mu, weight in _nodes(near):
        mirror, other = mirrors((near, far), mu)
        found.append((mu, weight, other, mirror * other))
    return tuple(found)


def _nodes(eta: float) -> list[tuple[float, float]]:
    critical = math.sqrt(1 - 1 / eta**2)

    def let_out(mu):
        outside = torch.tensor([refracted(float(m), eta, 1.0) for m in mu], dtype=torch.float64)
        return fresnel.transmittance(outside, eta).numpy()

    mu, weight = gauss_weighted(let_out, critical, 1.0, NODES)
    return [(float(m), float(w)) for m, w in zip(mu, weight, strict=True)]
