"""One layer, one decaying mode: everything that solving a stack asks of it.

In a layer of thickness d a mode obeys v'' = λ² v, so that it is fixed by its values at both faces,

    v(z) = P(z) v(0) + Q(z) v(d),   P = sinh λ(d - z) / sinh λd,   Q = sinh λz / sinh λd,

and its admittance -v'/v goes from G at the far face to λ² th + sech² G / (1 + G th) at the near one.
The light enters as e^-σz. All terms are positive and bounded: nothing overflows or cancels, and
λ = 0 and d = 0 are ordinary.
"""

from dataclasses import dataclass, replace

import torch

from texsss.media import fresnel
from texsss.media.stack import LayerTable
from texsss.numerics.exponentials import relexp
from texsss.types import Tensor

CLEAR = 1e-6  # a layer extinguishes at least this [1/mm], so that a clear one has a finite D
TINY = 1e-24  # keeps the derivative of √ finite where nothing is absorbed and s = 0


@dataclass(frozen=True, eq=False)
class Coefficients:
    """One layer of a table, flattened to N rows and channels; `d` is None for a half-space."""

    sigma_a: Tensor
    sigma_s: Tensor  # reduced [1/mm]
    d: Tensor | None
    eta: float

    @property
    def sigma(self) -> Tensor:
        """Reduced extinction [1/mm]."""
        return (self.sigma_a + self.sigma_s).clamp_min(CLEAR)


@dataclass(frozen=True, eq=False)
class Light:
    """The collimated light in one layer: e^(-σz) from above, and what its bottom mirrors back up."""

    cosine: float  # to the normal, inside this layer
    sigma: Tensor  # extinction per depth
    source: Tensor  # scattering per depth
    beam: Tensor  # e^(-σd) through this layer
    down: Tensor  # beam at the top of the layer, its bounces included
    up: Tensor  # mirrored beam at the bottom of the layer

    @property
    def flipped(self) -> "Light":
        """The same seen from below."""
        return replace(self, down=self.up, up=self.down)


@dataclass(frozen=True, eq=False)
class Shape:
    """tanh(λd)/λ, sech(λd), and ∫ P e^(-σz), ∫ Q e^(-σz) over the layer; all (S, N)."""

    th: Tensor
    sech: Tensor
    P: Tensor
    Q: Tensor


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


def light_in(layers: list[Coefficients], cosine: float) -> list[Light]:
    """The collimated light in every layer, per unit that entered at `cosine` inside.

    It refracts where the index changes. A free bottom mirrors it, and the top again, as long as it
    lasts; reflections at inner interfaces (1 % from 1.5 to 1.2) are left out.
    """
    cosines = [refracted(cosine, layers[0].eta, layer.eta) for layer in layers]
    sigma = [layer.sigma / c for layer, c in zip(layers, cosines, strict=True)]
    depth = [None if layer.d is None else s * layer.d for s, layer in zip(sigma, layers, strict=True)]
    above, down = torch.zeros_like(sigma[0]), []
    for tau in depth:
        down.append(torch.exp(-above))
        above = above if tau is None else above + tau
    if layers[-1].d is None:
        up = [torch.zeros_like(t) for t in down]
        gain = 1.0
    else:
        outside = refracted(cosine, layers[0].eta, 1.0)
        top, bottom = (fresnel.reflectance(outside, layers[k].eta) for k in (0, -1))
        through = torch.exp(-above)
        below, up = torch.zeros_like(above), []
        for tau in reversed(depth):
            up.insert(0, bottom * through * torch.exp(-below))
            below = below + tau
        gain = 1 / (1 - top * bottom * through**2)
    return [
        Light(
            cosine=c,
            sigma=s,
            source=layer.sigma_s / c,
            beam=torch.zeros_like(s) if tau is None else torch.exp(-tau),
            down=t * gain,
            up=u * gain,
        )
        for c, s, layer, tau, t, u in zip(cosines, sigma, layers, depth, down, up, strict=True)
    ]


def ballistic(table: LayerTable, cosine: float) -> tuple[Tensor, Tensor]:
    """Shares of the light that leave unscattered by the top and by the bottom, flattened to N.

    In reduced coefficients, which is how the profiles count: R̂(0) + T̂(0) + both + absorption is 1.
    """
    layers = layers_of(table)
    lights = light_in(layers, cosine)
    if table.bottomless:
        nothing = torch.zeros_like(lights[0].sigma)
        return nothing, nothing
    outside = refracted(cosine, layers[0].eta, 1.0)
    top, bottom = (fresnel.reflectance(outside, layers[k].eta) for k in (0, -1))
    returned = lights[0].up * lights[0].beam * (1 - top)
    passed = lights[-1].down * lights[-1].beam * (1 - bottom)
    return returned, passed


def refracted(cosine: float, here: float, there: float) -> float:
    """Cosine at index `there` of light at `cosine` in one of index `here`; 0 if it cannot pass."""
    return max(1 - (1 - cosine**2) * (here / there) ** 2, 0.0) ** 0.5


def shape(decay: Tensor, d: Tensor, light: Light) -> Shape:
    """Shape of a mode that decays at λ = `decay` (S, N) across a layer of thickness `d` (N,)."""
    x = decay * d
    E = torch.exp(-x)
    slope = relexp(x)
    cosh = (1 + E * E) / 2  # each × e^-λd
    sinh = slope * (1 + E) / 2  # over λd
    sigma, beam = light.sigma, light.beam
    # ∫ e^(-σz - λz) / d and ∫ e^(-σz) e^(-λ(d - z)) / d
    together = (sigma * relexp(sigma * d) * E + decay * slope) / (sigma + decay)
    against = torch.maximum(beam, E) * relexp((sigma - decay).abs() * d)
    # by parts, from the integrals of cosh
    P = (1 - (together + E * against) / (2 * sinh)) / sigma
    Q = ((E * together + against) / (2 * sinh) - beam) / sigma
    return Shape(th=d * sinh / cosh, sech=E / cosh, P=P, Q=Q)
