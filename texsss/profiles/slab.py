"""One layer, one decaying mode: everything that solving a stack asks of it.

In a layer of thickness d a mode obeys v'' = λ² v, so that it is fixed by its values at both faces,

    v(z) = P(z) v(0) + Q(z) v(d),   P = sinh λ(d - z) / sinh λd,   Q = sinh λz / sinh λd,

and its admittance -v'/v goes from G at the far face to λ² th + sech² G / (1 + G th) at the near one.
The light enters as e^-σz. All terms are positive and bounded: nothing overflows or cancels, and
λ = 0 and d = 0 are ordinary.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import torch

from texsss.media import fresnel
from texsss.media.stack import LayerTable
from texsss.numerics.exponentials import relexp
from texsss.types import Tensor, chunks

CLEAR = 1e-6  # a layer extinguishes at least this [1/mm], so that a clear one has a finite D
VALUES = 1800  # rows × channels of a block
TINY = 1e-24  # keeps the derivative of √ finite where nothing is absorbed and s = 0

Directions = Sequence[tuple[float, float]]
"""Where the light comes from: cosines inside the first layer, and their shares."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """One layer of a table, flattened to N rows and channels; `d` is None for a half-space."""

    sigma_a: Tensor
    sigma_s: Tensor  # reduced [1/mm]
    d: Tensor | None
    eta: float

    @cached_property
    def sigma(self) -> Tensor:
        """Reduced extinction [1/mm]."""
        return (self.sigma_a + self.sigma_s).clamp_min(CLEAR)


@dataclass(frozen=True, eq=False)
class Light:
    """Collimated light in one layer: e^(-σz) from above, and what its bottom mirrors back up."""

    cosine: float  # to the normal, inside this layer
    sigma: Tensor  # extinction per depth
    source: Tensor  # scattering per depth, times the share of this direction
    beam: Tensor | None  # e^(-σd) through this layer; None through a half-space
    lost: Tensor | None  # (1 - beam) / d
    down: Tensor  # beam at the top of the layer, its bounces included
    up: Tensor | None  # mirrored beam at the bottom of the layer; None where nothing mirrors

    @property
    def flipped(self) -> "Light":
        """The same seen from below."""
        assert self.up is not None
        return replace(self, down=self.up, up=self.down)


def in_blocks(table: LayerTable) -> list[LayerTable]:
    """A table cut into so few rows that what a sweep has in hand stays in cache; other batches as they are.

    That also keeps operations on single threads, which need not wait for each other.
    """
    if len(table.batch) != 1:
        return [table]
    return [table.rows(part) for part in chunks(table.batch[0], max(VALUES // table.channels, 1))]


def layers_of(table: LayerTable) -> list[Coefficients]:
    """The layers of a table from the surface inwards."""
    reduced = table.sigma_s * (1 - table.g)
    last = len(table.eta) - 1
    return [
        Coefficients(
            sigma_a=table.sigma_a[..., k, :].reshape(-1),
            sigma_s=reduced[..., k, :].reshape(-1),
            d=None if table.bottomless and k == last else table.thickness[..., k, :].reshape(-1),
            eta=eta,
        )
        for k, eta in enumerate(table.eta)
    ]


def light_in(layers: list[Coefficients], directions: Directions) -> list[list[Light]]:
    """The collimated light in every layer, by direction, per unit that entered in all of them.

    It refracts where the index changes. A free bottom mirrors it, and the top again, as long as it
    lasts; reflections at inner interfaces (1 % from 1.5 to 1.2) are left out.
    """
    each = [_light_from(layers, cosine, share) for cosine, share in directions]
    return [list(lights) for lights in zip(*each, strict=True)]


def _light_from(layers: list[Coefficients], cosine: float, share: float) -> list[Light]:
    cosines = [refracted(cosine, layers[0].eta, layer.eta) for layer in layers]
    sigma = [layer.sigma / c for layer, c in zip(layers, cosines, strict=True)]
    depth = [None if layer.d is None else s * layer.d for s, layer in zip(sigma, layers, strict=True)]
    above, down = torch.zeros_like(sigma[0]), []
    for tau in depth:
        down.append(torch.exp(-above))
        above = above if tau is None else above + tau
    up: list[Tensor | None] = [None] * len(layers)
    if layers[-1].d is not None:
        top, bottom = _mirrors(layers, cosine)
        through = torch.exp(-above)
        gain = 1 / (1 - top * bottom * through**2)
        below = torch.zeros_like(above)
        for k in reversed(range(len(layers))):
            up[k] = gain * bottom * through * torch.exp(-below)
            tau = depth[k]
            assert tau is not None, "only the last of a bottomless stack is infinite"
            below = below + tau
        down = [t * gain for t in down]
    return [
        Light(
            cosine=c,
            sigma=s,
            source=share / c * layer.sigma_s,
            beam=None if tau is None else torch.exp(-tau),
            lost=None if tau is None else s * relexp(tau),
            down=t,
            up=u,
        )
        for c, s, layer, tau, t, u in zip(cosines, sigma, layers, depth, down, up, strict=True)
    ]


def _mirrors(layers: list[Coefficients], cosine: float) -> tuple[float, float]:
    """Fresnel reflectance of the top and of the bottom for light at `cosine` in the first layer."""
    outside = refracted(cosine, layers[0].eta, 1.0)
    return mirror_of(outside, layers[0].eta), mirror_of(outside, layers[-1].eta)


@lru_cache(maxsize=1024)
def mirror_of(outside: float, eta: float) -> float:
    """Fresnel reflectance, kept."""
    return fresnel.reflectance(outside, eta)


def ballistic(table: LayerTable, directions: Directions) -> tuple[Tensor, Tensor]:
    """Shares of the light that leave unscattered by the top and by the bottom, flattened to N.

    In reduced coefficients, which is how the profiles count: R̂(0) + T̂(0) + both + absorption is 1.
    """
    layers = layers_of(table)
    returned = passed = torch.zeros_like(layers[0].sigma)
    if table.bottomless:
        return returned, passed
    for cosine, share in directions:
        lights = _light_from(layers, cosine, share)
        top, bottom = _mirrors(layers, cosine)
        first, last = lights[0], lights[-1]
        assert first.up is not None and first.beam is not None and last.beam is not None
        returned = returned + share * (1 - top) * first.up * first.beam
        passed = passed + share * (1 - bottom) * last.down * last.beam
    return returned, passed


def refracted(cosine: float, here: float, there: float) -> float:
    """Cosine at index `there` of light at `cosine` in one of index `here`; 0 if it cannot pass."""
    return max(1 - (1 - cosine**2) * (here / there) ** 2, 0.0) ** 0.5


class Mode:
    """A mode that decays at λ = `decay` (S, N) across a layer of thickness `d` (N,).

    `th` = tanh(λd)/λ, `sech` = sech(λd); `squared` = λ².
    """

    def __init__(self, decay: Tensor, squared: Tensor, d: Tensor):
        self.decay, self.squared = decay, squared
        # all by h = tanh(λd/2): e^-λd = (1 - h)/(1 + h), and so on
        half = (decay * (d / 2)).clamp_min(TINY)
        h = torch.tanh(half)
        ratio = h / half
        h2 = h * h
        plus = 1 / (1 + h2)
        whole = 1 / (1 + h)
        self.th = d * ratio * plus
        self.sech = (1 - h2) * plus
        self._d = d
        self._E = (1 - h) * whole
        self._lost = ratio * whole  # (1 - E) / λd
        self._sinh = 2 * self._lost * whole  # (1 - E²) / λd

    def lit(self, lights: list[Light]) -> tuple[Tensor, Tensor]:
        """∫ P and ∫ Q over the layer with the source of all `lights`: what reaches either face."""
        near, far = [], []
        for light in lights:
            P, Q = self._integrals(light)
            strength = light.source / light.sigma
            down = strength * light.down
            near.append(down * P)
            far.append(down * Q)
            if light.up is not None:
                up = strength * light.up
                near.append(up * Q)
                far.append(up * P)
        return added(near), added(far)

    def _integrals(self, light: Light) -> tuple[Tensor, Tensor]:
        """σ ∫ P e^(-σz) and σ ∫ Q e^(-σz), by parts."""
        assert light.beam is not None and light.lost is not None
        E, beam, sigma = self._E, light.beam, light.sigma
        # ∫ e^(-σz - λz) / d and ∫ e^(-σz) e^(-λ(d - z)) / d
        together = (light.lost * E + self.decay * self._lost) / (sigma + self.decay)
        against = torch.maximum(beam, E) * relexp((sigma - self.decay).abs() * self._d)
        P = 1 - (together + E * against) / self._sinh
        Q = (E * together + against) / self._sinh - beam
        return P, Q


def added(terms: list[Tensor]) -> Tensor:
    """The sum of at least one tensor."""
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total
