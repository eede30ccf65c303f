"""Exact single scattering and two-mode multiple scattering through N layers: `layered-sp3`, the default.

Multiple scattering is carried by two modes of different mean cosine, coupled by scattering, as in the
SP3 equations; what the modes carry without scattering is the light that scattered once, crudely, and
is replaced by the exact integral. Everything is a vector of two per row and frequency. A stack is
swept like scalar diffusion, with 2×2 admittances in the eigenvectors of each layer:

    Γ = λ² th + sech (I + G th)⁻¹ G sech,   th = tanh(λd)/λ,   G the admittance below in this layer's modes.

Cosines, boundary coefficients: fitted to half-spaces of index 1 to 1.6, Gauss nodes at 1.
Source: our own; the equations are those of Larsen et al. 2002 with free boundary coefficients.
"""

from dataclasses import dataclass

import torch

from texsss.media.stack import LayerTable
from texsss.profiles.slab import Coefficients, layers_of, light_in, shape
from texsss.profiles.two_modes import TwoModes, two_modes
from texsss.types import Float, Tensor

# a face feels the extinction at depth z as e^-(3 σ + 8 s) z: of the rates tried, the best on thin tops
_NEAR_SIGMA, _NEAR_S = 3.0, 8.0

Pair = tuple[Tensor, Tensor]
Matrix = tuple[Tensor, Tensor, Tensor, Tensor]  # row-major 2×2


def multiple(table: LayerTable, s: Float[Tensor, " S"], cosine: float, side: str) -> Float[Tensor, "S N"]:
    """R̂ or T̂ (`side`) of light scattered twice or more, which entered at `cosine` inside.

    Per row and channel, flattened to N. Similarity is assumed: σs' = σs (1 - g), isotropic.
    Differentiable in `table` and `s`.
    """
    if side == "transmittance" and table.bottomless:
        return s.new_zeros(s.shape[0], table.sigma_a[..., 0, :].numel())
    layers = layers_of(table)
    lights = light_in(layers, cosine)
    if side == "transmittance":  # the stack seen from below
        layers = layers[::-1]
        lights = [light.flipped for light in reversed(lights)]
    total = s.new_zeros(())
    for weight, inner, top, bottom in _parameters(table.eta[0], layers[0].eta, layers[-1].eta):
        both = _coupled(layers, lights, s, inner, top, bottom)
        total = total + weight * (both - _uncoupled(layers, lights, s, inner, top, bottom))
    return total


def _parameters(inner: float, near: float, far: float) -> list[tuple[float, TwoModes, TwoModes, TwoModes]]:
    """Parameter sets of the medium, the near and the far boundary, with their weights."""
    if near == far:
        return [(weight, modes, modes, modes) for weight, modes in two_modes(near)]
    return [
        (u * v, top if inner == near else bottom, top, bottom)
        for u, top in two_modes(near)
        for v, bottom in two_modes(far)
    ]


@dataclass(frozen=True, eq=False)
class _Modes:
    """Eigenmodes of one layer: decay rates (S, N) and eigenvectors [[1, k1], [-k2, 1]]."""

    decay: Pair
    squared: Pair
    k1: Tensor
    k2: Tensor
    det: Tensor

    def into(self, M: Matrix) -> Matrix:
        """A matrix in the eigenvectors as basis, V⁻¹ M V."""
        return _conjugated(M, self.k1, self.k2, self.det)

    def out_of(self, M: Matrix) -> Matrix:
        """A matrix given in the eigenvectors, in physical components, V M V⁻¹."""
        return _conjugated(M, -self.k1, -self.k2, self.det)

    def row_into(self, r: Pair) -> Pair:
        return r[0] - r[1] * self.k2, r[0] * self.k1 + r[1]

    def row_out_of(self, r: Pair) -> Pair:
        return (r[0] + r[1] * self.k2) / self.det, (r[1] - r[0] * self.k1) / self.det


def _coupled(layers, lights, s, modes: TwoModes, top: TwoModes, bottom: TwoModes) -> Tensor:
    """What the top receives of the source, by both modes with all scattering between them."""
    response: Pair | None = None
    admittance: Matrix | None = None  # of all below, in physical components, over D
    below: Coefficients | None = None
    here: _Modes | None = None
    for layer, light in zip(reversed(layers), reversed(lights), strict=True):
        previous, here = here, _eigenmodes(layer, s, modes)
        y = (1 - here.k2, 1 + here.k1)
        if layer.d is None:
            first, second = here.decay
            lit = light.source * light.down
            response = (lit * y[0] / (light.sigma + first), lit * y[1] / (light.sigma + second))
            gamma = (first, s.new_zeros(()), s.new_zeros(()), second)
        else:
            forms = [shape(decay, layer.d, light) for decay in here.decay]
            if below is None:
                B1, B2 = _face(layers[::-1], s, bottom, bottom.gamma)
                admittance = (B1, s.new_zeros(()), s.new_zeros(()), B2)
                scale = 1.0
            else:  # D of the layer below over D here
                assert previous is not None and admittance is not None and response is not None
                scale = layer.sigma / below.sigma * (below.eta / layer.eta) ** 2
                response = here.row_into(previous.row_out_of(response))
            G = here.into(tuple(scale * x for x in admittance))
            (th1, th2), (e1, e2) = (f.th for f in forms), (f.sech for f in forms)
            K = _inverse((1 + th1 * G[0], th1 * G[1], th2 * G[2], 1 + th2 * G[3]))
            passed = (K[0] * e1, K[1] * e2, K[2] * e1, K[3] * e2)
            lower = [y[m] * light.source * (light.down * forms[m].Q + light.up * forms[m].P) for m in (0, 1)]
            if response is not None:
                lower = [a + b for a, b in zip(lower, response, strict=True)]
            upper = [y[m] * light.source * (light.down * forms[m].P + light.up * forms[m].Q) for m in (0, 1)]
            carried = _row_times(lower, passed)
            response = (upper[0] + carried[0], upper[1] + carried[1])
            # sech (I + G th)⁻¹ G sech = sech G (I + th G)⁻¹ sech
            GK = _multiply(G, passed)
            gamma = (
                here.squared[0] * th1 + e1 * GK[0],
                e1 * GK[1],
                e2 * GK[2],
                here.squared[1] * th2 + e2 * GK[3],
            )
        admittance = here.out_of(gamma)
        below = layer
    assert admittance is not None and here is not None and response is not None
    b1, b2 = _face(layers, s, top, top.gamma)
    e1, e2 = _face(layers, s, top, top.delta)
    w1, w2 = top.w
    chi = _inverse((admittance[0] + b1, admittance[1], admittance[2], admittance[3] + b2))
    chi = (chi[0] * w1 * e1 + chi[1] * w2 * e2, chi[2] * w1 * e1 + chi[3] * w2 * e2)
    r1, r2 = here.row_out_of(response)
    return r1 * chi[0] + r2 * chi[1]


def _uncoupled(layers, lights, s, modes: TwoModes, top: TwoModes, bottom: TwoModes) -> Tensor:
    """The same without scattering on the way: what the modes make of light that scattered once."""
    total = s.new_zeros(())
    for m, mu in enumerate(modes.mu):
        response = s.new_zeros(())
        admittance = s.new_zeros(())
        below: Coefficients | None = None
        for layer, light in zip(reversed(layers), reversed(lights), strict=True):
            squared = (layer.sigma / mu) ** 2 + s[:, None] ** 2
            decay = torch.sqrt(squared)
            if layer.d is None:
                response = light.source * light.down / (light.sigma + decay)
                admittance = decay
            else:
                form = shape(decay, layer.d, light)
                if below is None:
                    G = _face(layers[::-1], s, bottom, bottom.gamma)[m]
                else:
                    G = layer.sigma / below.sigma * (below.eta / layer.eta) ** 2 * admittance
                passed = form.sech / (1 + G * form.th)
                lower = light.source * (light.down * form.Q + light.up * form.P) + response
                response = light.source * (light.down * form.P + light.up * form.Q) + passed * lower
                admittance = squared * form.th + form.sech * passed * G
            below = layer
        b, e = _face(layers, s, top, top.gamma)[m], _face(layers, s, top, top.delta)[m]
        total = total + top.w[m] * e / (admittance + b) * response
    return total


def _eigenmodes(layer: Coefficients, s: Tensor, modes: TwoModes) -> _Modes:
    sigma, s2 = layer.sigma, s[:, None] ** 2
    (m1, m2), (w1, w2) = modes.mu, modes.w
    a = layer.sigma_s / sigma
    lost = layer.sigma_a / sigma
    K1, K2 = (sigma / m1) ** 2 + s2, (sigma / m2) ** 2 + s2
    c1, c2 = w1 * a * (sigma / m1) ** 2, w2 * a * (sigma / m2) ** 2
    half = (K1 + K2 - c1 - c2) / 2
    delta = (K1 - K2 - c1 + c2) / 2
    root = torch.sqrt(delta**2 + c1 * c2)
    det = (
        sigma**4 * lost / (m1 * m2) ** 2
        + s2 * sigma**2 * ((1 - a * w1) / m1**2 + (1 - a * w2) / m2**2)
        + s2**2
    )
    fast = half + root
    slow = det / fast + 1e-24
    # δ > 0 because m1 < m2, so nothing cancels, at a = 0 neither
    p = delta + root
    k1, k2 = c1 / p, c2 / p
    return _Modes((torch.sqrt(fast), torch.sqrt(slow)), (fast, slow), k1, k2, 1 + k1 * k2)


def _conjugated(M: Matrix, k1: Tensor, k2: Tensor, det: Tensor) -> Matrix:
    a, b, c, d = M
    p, q, r, s = a - b * k2, a * k1 + b, c - d * k2, c * k1 + d
    return (p - k1 * r) / det, (q - k1 * s) / det, (k2 * p + r) / det, (k2 * q + s) / det


def _face(layers: list[Coefficients], s: Tensor, modes: TwoModes, growth: tuple[float, float]) -> Pair:
    """What the face of the first of `layers` lets out of each mode, over D there [1/mm].

    It depends on the extinction that light has near the face: the mean over the first mean free path,
    so that a layer that vanishes takes its influence with it.
    """
    sigma = layers[0].sigma
    left = torch.ones_like(sigma)
    weight, near = 1e-20 * left, 1e-20 * sigma
    for layer in layers:
        share = (
            left
            if layer.d is None
            else -left * torch.expm1(-(_NEAR_SIGMA * layer.sigma + _NEAR_S * s[:, None]) * layer.d)
        )
        weight, near = weight + share, near + layer.sigma * share
        left = left - share
    near = near / weight  # of a thin slab only what is there counts
    first, second = (
        sigma / near * b * torch.sqrt((near / mu) ** 2 + grown * s[:, None] ** 2)
        for b, mu, grown in zip(modes.b, modes.mu, growth, strict=True)
    )
    return first, second


def _multiply(a: Matrix, b: Matrix) -> Matrix:
    return (
        a[0] * b[0] + a[1] * b[2],
        a[0] * b[1] + a[1] * b[3],
        a[2] * b[0] + a[3] * b[2],
        a[2] * b[1] + a[3] * b[3],
    )


def _inverse(a: Matrix) -> Matrix:
    det = a[0] * a[3] - a[1] * a[2]
    return a[3] / det, -a[1] / det, -a[2] / det, a[0] / det


def _row_times(r, a: Matrix) -> Pair:
    return r[0] * a[0] + r[1] * a[2], r[0] * a[1] + r[1] * a[3]
