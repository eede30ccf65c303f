"""Exact single scattering and two-mode multiple scattering through N layers: `layered-sp3`, the default.

Multiple scattering is carried by two modes of different mean cosine, coupled by scattering, as in the
SP3 equations; what the modes carry without scattering is the light that scattered once, crudely, and
is replaced by the exact integral. How far that was wrong tells how light that scattered again gets out, too
(`led_out`). Cosines, boundary coefficients: fitted to half-spaces of index 1 to 1.6, Gauss nodes at 1.
Thin slabs between faces that mirror are lit evenly instead (`even`), films rarer than what lies beneath are
crossed straight (`films`, `straight`), and where media scatter forwards what is hardly deflected but once
stays narrow (`nearly`). One factor per row makes a stack that absorbs nothing lose nothing.
Source: our own; the equations are those of Larsen et al. 2002 with free boundary coefficients.
"""

from functools import cache
from typing import NamedTuple, no_type_check

import torch

from texsss.media.stack import LayerTable
from texsss.profiles import even, single
from texsss.profiles.blocks import Loops, Solver, solved
from texsss.profiles.even import Even, scattered_evenly
from texsss.profiles.films import Way, one_way, there_and_back, ways
from texsss.profiles.four_streams import lacking
from texsss.profiles.led_out import led_out, most, scaled
from texsss.profiles.nearly import peaked
from texsss.profiles.single import Node, scattered_once
from texsss.profiles.slab import Directions, added, extinguished, from_side, light_in
from texsss.profiles.straight import Fading, leaving
from texsss.profiles.two_mode_sweep import Sweep, scattered_twice
from texsss.profiles.two_mode_sweep import prepare as swept
from texsss.profiles.two_modes import TwoModes, two_modes
from texsss.types import Float, Tensor

FEW = 1e-6  # light [of what entered] below which what scales it fades out


class Multiple(NamedTuple):
    """What scatters more than once."""

    sweeps: tuple[Sweep, ...]
    share: tuple[Tensor | float, ...]  # of every sweep, (1, N) or a number
    even: Even | None
    scale: Tensor | float = 1.0  # (1, N) of light that scattered once, to be what sweeps make of it at s = 0
    most: Tensor | float = 1.0  # (1, N) or a number, of `led_out`

    def times(self, factor: Tensor) -> "Multiple":
        slab = self.even and self.even._replace(strength=self.even.strength * factor)
        share = tuple(share * factor for share in self.share)
        return self._replace(share=share, even=slab, scale=self.scale * factor)


class Entrance(NamedTuple):
    """How light from all around gets through films to where it first scatters: as it leaves.

    Of light that comes back after one scattering `single` knows that itself.
    """

    ways: tuple[Way, ...]
    fading: Fading
    back: bool  # whether it is seen from there

    def times(self, s: Tensor) -> Tensor:
        return (there_and_back if self.back else one_way)(self.ways, self.fading, s)


class Prepared(NamedTuple):
    """A stack seen from one side, whatever the frequency."""

    once: tuple[Node, ...]  # and nearly once; none if not asked for
    reduced: tuple[Node, ...]  # isotropic, as sweeps see it; none if `once` is, or only that was asked for
    more: Multiple | None  # None if only single scattering was
    passed: Tensor | None  # of all, (1, N), where light is deflected forwards on its way through
    less: tuple[Node, ...]  # what of `once` was not asked for: what scattered once, or what the march sees
    entrance: Entrance | None  # None where no film is crossed


def profile(
    table: LayerTable,
    s: Float[Tensor, " S"],
    directions: Directions,
    *,
    side: str,
    scattering: str = "total",
    phase: str = "henyey-greenstein",
    loops: Loops | None = None,
) -> Float[Tensor, "S N"]:
    """R̂ or T̂ (`side`) of light that entered in `directions`, per row and channel, flattened to N.

    `scattering`: total, single, multiple, or unmarched, the total less `_marched`.
    In reflectance single scattering follows `phase`, and so does what is hardly deflected but once
    (`nearly`). The rest, whose similarity is σs' = σs (1 - g), isotropic, takes up what the reduced and
    isotropic single scattering counts beyond both, and what similarity lacks (`four_streams`), spread like
    itself. Transmittance keeps to the reduced coefficients, in which light that is hardly deflected is part
    of the beam, but for what similarity lacks, of which single and multiple scattering have their shares;
    only `single` knows `phase`.
    Differentiable in `table` and `s`.
    """
    asked = (directions, side, scattering, phase)
    solver = Solver(prepare, asked, spectrum, side, unreduced(table))
    return solved(table, s, solver, loops)


def unreduced(table: LayerTable) -> bool:
    """Whether light is scattered forwards or backwards, so that reduced coefficients do not say all."""
    return not table.isotropic


@no_type_check
def prepare(layers, directions, side, scattering, phase, unreduced):
    """All of a profile that does not depend on the frequency.

    `unreduced`: the layers with their true coefficients, where single scattering has these; else None.
    """
    lights = light_in(layers, directions)
    spread = len(directions) > 1  # from one side it would come from another place, not spread
    around = spread and side == "reflectance"
    once = reduced = single.prepare(*from_side(side, layers, lights), None, around)
    if unreduced is not None and scattering in ("single", "multiple"):
        once = single.prepare(*from_side(side, unreduced, light_in(unreduced, directions)), phase, around)
    entrance = None
    if spread and len(layers) > 1:
        entrance = Entrance(ways(layers), leaving(layers[0].eta), side == "reflectance")
    if scattering == "single":
        return Prepared(once, (), None, None, (), entrance)
    more = _multiple(layers, lights, directions, side)
    factor = _furnace(layers, lights, directions)
    zero = factor.new_zeros(1, 1)
    first, (twice, own) = scattered_once(reduced, zero), _by_modes(more, zero)
    seen, _ = from_side(side, layers, lights)
    more = more._replace(scale=scaled(own, first), most=most(seen, side, isotropic=unreduced is None))
    passed, less = None, ()
    if unreduced is not None:
        whole = factor * _and_evenly(more, twice, zero)
        handed = lacking(layers, directions, side)
        if side == "reflectance":
            near = peaked(unreduced, directions)
            less, once = once, single.prepare(near, light_in(near, directions), phase, around)
            handed = handed + first - scattered_once(once, zero)
            # narrow light can be more than there is
            factor = factor * (1 + handed / (whole + 1e-20)).clamp_min(0)
        else:
            once = reduced
            passed = (1 + handed / (whole + first + FEW)).clamp_min(0)
    if scattering == "multiple":
        once = once if less else ()
    elif scattering == "unmarched" and side == "reflectance":
        less = _marched(*((layers, None) if unreduced is None else (unreduced, phase)), directions)
    else:
        less = ()
    return Prepared(once, () if once is reduced else reduced, more.times(factor), passed, less, entrance)


@no_type_check
def spectrum(prepared, s):
    """R̂ or T̂ per frequency, row and channel (S, N); `s`: frequencies (S, 1)."""
    terms = [scattered_once(prepared.once, s)] if prepared.once else []
    if prepared.more is not None:
        first = scattered_once(prepared.reduced, s) if prepared.reduced else terms[0]
        back = prepared.entrance is not None and prepared.entrance.back
        entered = prepared.entrance.times(s) if back else 1.0
        terms.append(_scattered_more(prepared.more, s, first, entered))
    total = added(terms)
    if prepared.passed is not None:
        total = total * prepared.passed
    if prepared.less:
        total = total - scattered_once(prepared.less, s)
    if prepared.entrance is not None and not prepared.entrance.back:
        total = total * prepared.entrance.times(s)
    return total


@no_type_check
def _marched(layers, phase, directions):
    """Light scattered once as the march sees it: through one refractive index, and no face mirrors it."""
    level = [layer._replace(eta=layers[0].eta) for layer in layers]
    return single.prepare(level, light_in(level, directions, mirrored=False), phase, len(directions) > 1)


@no_type_check
def _scattered_more(more, s, first, entered):
    """`first`: what leaves after one scattering (S, N), of reduced coefficients; `entered`: through films."""
    twice, own = (entered * order for order in _by_modes(more, s))
    return _and_evenly(more, led_out(twice, own, more.scale * first, more.most), s)


@no_type_check
def _by_modes(more, s):
    """What sweeps make of light that scattered twice and more, and of such as did once, (S, N) each."""
    s2 = s * s
    twice, once = zip(*(scattered_twice(sweep, s, s2) for sweep in more.sweeps))
    return tuple(added([share * x for share, x in zip(more.share, order)]) for order in (twice, once))


@no_type_check
def _and_evenly(more, twice, s):
    return twice if more.even is None else twice + scattered_evenly(more.even, s)


@no_type_check
def _multiple(layers, lights, directions, side):
    """Sweeps of two modes, one per parameter set, their shares, and light that is everywhere alike."""
    inner, slab = layers[0].eta, even.prepare(layers, directions)
    layers, lights = from_side(side, layers, lights)
    sets = parameters(inner, layers[0].eta, layers[-1].eta)
    share = tuple(weight if slab is None else weight * slab.rest for weight, *_ in sets)
    return Multiple(tuple(swept(layers, lights, *modes) for _, *modes in sets), share, slab)


@no_type_check
def _furnace(layers, lights, directions):
    """What multiple scattering lacks for the same stack without absorption to return all light, (1, N)."""
    white = [layer._replace(sigma_a=torch.zeros_like(layer.sigma), sigma_s=layer.sigma) for layer in layers]
    lit = [
        [light._replace(source=light.share / light.cosine * layer.sigma) for light in beams]
        for layer, beams in zip(layers, lights)
    ]
    zero = layers[0].sigma.new_zeros(1, 1)
    once, have = 0.0, 0.0
    for side in ("reflectance", "transmittance")[: 1 if layers[-1].d is None else 2]:
        once = once + scattered_once(single.prepare(*from_side(side, white, lit), None), zero)
        more = _multiple(white, lit, directions, side)
        have = have + _and_evenly(more, _by_modes(more, zero)[0], zero)
    lacking = extinguished(layers, directions) - once
    return ((lacking + FEW) / (have + FEW)).clamp(0.5, 2.0)


@cache
def parameters(inner, near, far):
    """Parameter sets of the medium, the near and the far boundary, with their weights."""
    if near == far:
        return tuple((weight, modes, modes, modes) for weight, modes in two_modes(near))
    found = []
    for u, top in two_modes(near):
        for v, bottom in two_modes(far):
            medium = top if inner == near else bottom
            found.append((u * v, medium, face_of(top, medium), face_of(bottom, medium)))
    return tuple(found)


def face_of(face: TwoModes, medium: TwoModes) -> TwoModes:
    """The boundary of a medium of other modes, that lets the same light out.

    What a face takes of a mode is b D √(1 / μ² + …) with its own modes' μ and D = μ² / σ, and a field that is
    the same in both modes loses Σ w of it: D and w of the medium come in their place.
    """
    ratio = [(f / m) ** 2 for f, m in zip(face.mu, medium.mu, strict=True)]
    first, second = (b * r * w / own for b, r, w, own in zip(face.b, ratio, face.w, medium.w, strict=True))
    return face._replace(b=(first, second), w=medium.w)
