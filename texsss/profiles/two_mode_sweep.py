"""Two coupled modes swept through N layers: what reaches the top of light that collimated beams scatter.

Everything is a vector of two per row and frequency. A stack is swept like scalar diffusion, with 2×2
admittances in the eigenvectors of each layer, which do not depend on the frequency:

    Γ = λ² th + sech (I + G th)⁻¹ G sech,   th = tanh(λd)/λ,   G the admittance below in this layer's modes.

Source: our own; the equations are those of Larsen et al. 2002 with free boundary coefficients.
"""

from dataclasses import dataclass

import torch

from texsss.profiles.slab import TINY, Coefficients, Light, Mode
from texsss.profiles.two_modes import TwoModes
from texsss.types import Tensor

# A face feels the extinction at depth z as e^-(3 σ + 8 s) z, so that a layer that vanishes is not felt.
# The rates hardly matter: on layered stacks the radial error is .065 with all that were tried, worst .10.
_NEAR_SIGMA, _NEAR_S = 3.0, 8.0
_FAR = 20.0

Pair = tuple[Tensor, Tensor]
Matrix = tuple[Tensor, Tensor, Tensor, Tensor]  # row-major 2×2


def scattered_twice(
    layers: list[Coefficients],
    lights: list[list[Light]],
    s: Tensor,
    inner: TwoModes,
    top: TwoModes,
    bottom: TwoModes,
) -> Tensor:
    """Light that leaves by the top after two or more scatterings (S, N), per unit of `lights`.

    That is what the coupled modes carry there less what they carry without scattering on the way.
    `inner`, `top`, `bottom`: parameters of the medium and of either boundary. Differentiable.
    """
    s2 = s[:, None] ** 2
    near = _near_extinction(layers, s)
    b, out = _face(layers[0], s2, near, top, top.gamma), _face(layers[0], s2, near, top, top.delta)
    out = (top.w[0] * out[0], top.w[1] * out[1])
    if layers[-1].d is None:
        lowest = None
    else:
        lowest = _face(layers[-1], s2, _near_extinction(layers[::-1], s), bottom, bottom.gamma)
    both = _coupled(layers, lights, s2, inner, b, out, lowest)
    for m, mu in enumerate(inner.mu):
        both = both - _uncoupled(layers, lights, s2, mu, b[m], out[m], None if lowest is None else lowest[m])
    return both


@dataclass(frozen=True, eq=False)
class _Eigen:
    """Eigenmodes of one layer: λ² = s² + `rates`, eigenvectors V = [[1, k1], [-k2, 1]]; all (N,)."""

    rates: Pair
    k1: Tensor
    k2: Tensor

    def seen_in(self, other: "_Eigen") -> tuple[Matrix, Matrix]:
        """V_other⁻¹ V and its inverse."""
        det, own = 1 + other.k1 * other.k2, 1 + self.k1 * self.k2
        a, b = 1 + other.k1 * self.k2, self.k1 - other.k1
        c, d = other.k2 - self.k2, 1 + other.k2 * self.k1
        return (a / det, b / det, c / det, d / det), (d / own, -b / own, -c / own, a / own)


def _eigen(layer: Coefficients, modes: TwoModes) -> _Eigen:
    sigma2 = layer.sigma**2
    (m1, m2), (w1, w2) = modes.mu, modes.w
    a, lost = layer.sigma_s / layer.sigma, layer.sigma_a / layer.sigma
    K1, K2 = sigma2 / m1**2, sigma2 / m2**2
    c1, c2 = w1 * a * K1, w2 * a * K2
    delta = (K1 - K2 - c1 + c2) / 2
    root = torch.sqrt(delta**2 + c1 * c2)
    fast = (K1 + K2 - c1 - c2) / 2 + root
    slow = K1 * K2 * lost / fast + TINY  # the determinant over the other one: nothing cancels
    # δ > 0 because m1 < m2, so nothing cancels here, at a = 0 neither
    p = delta + root
    return _Eigen((fast, slow), c1 / p, c2 / p)


def _coupled(layers, lights, s2, modes: TwoModes, b: Pair, out: Pair, lowest: Pair | None) -> Tensor:
    """What the top receives of the source, by both modes with all scattering between them."""
    gamma: Matrix | None = None  # admittance of all below over D, in the modes of the layer below
    response: Pair | None = None
    below: tuple[Coefficients, _Eigen] | None = None
    for layer, beams in zip(reversed(layers), reversed(lights), strict=True):
        here = _eigen(layer, modes)
        y = (1 - here.k2, 1 + here.k1)
        squared = (s2 + here.rates[0], s2 + here.rates[1])
        decay = (torch.sqrt(squared[0]), torch.sqrt(squared[1]))
        if layer.d is None:
            slow, fast = (
                torch.stack([light.source * light.down * y[m] / (light.sigma + decay[m]) for light in beams])
                for m in (0, 1)
            )
            response = slow.sum(0), fast.sum(0)
            gamma = (decay[0], s2.new_zeros(()), s2.new_zeros(()), decay[1])
            below = layer, here
            continue
        if below is None:
            assert lowest is not None
            # V⁻¹ diag(lowest) V
            det = 1 + here.k1 * here.k2
            mixed = here.k1 * here.k2 / det
            step = lowest[0] - lowest[1]
            G = (
                lowest[0] - mixed * step,
                here.k1 / det * step,
                here.k2 / det * step,
                lowest[1] + mixed * step,
            )
            received = None
        else:
            assert gamma is not None and response is not None
            into, back = below[1].seen_in(here)
            scale = layer.sigma / below[0].sigma * (below[0].eta / layer.eta) ** 2  # D below over D here
            G = _product(_product(tuple(scale * x for x in into), gamma), back)
            received = _row_times(response, back)
        first, second = (Mode(decay[m], squared[m], layer.d) for m in (0, 1))
        (near1, far1), (near2, far2) = first.lit(beams), second.lit(beams)
        l1, l2 = y[0] * far1, y[1] * far2
        if received is not None:
            l1, l2 = l1 + received[0], l2 + received[1]
        t1, t2 = first.th, second.th
        det = G[0] * G[3] - G[1] * G[2]
        # (I + th G)⁻¹ over its determinant
        D = 1 + t1 * G[0] + t2 * (G[3] + t1 * det)
        e1, e2 = first.sech / D, second.sech / D
        response = (
            y[0] * near1 + e1 * (l1 + t2 * (l1 * G[3] - l2 * G[2])),
            y[1] * near2 + e2 * (l2 + t1 * (l2 * G[0] - l1 * G[1])),
        )
        gamma = (
            squared[0] * t1 + first.sech * e1 * (G[0] + t2 * det),
            first.sech * e2 * G[1],
            second.sech * e1 * G[2],
            squared[1] * t2 + second.sech * e2 * (G[3] + t1 * det),
        )
        below = layer, here
    assert gamma is not None and response is not None and below is not None
    # (V Γ + diag(b) V) c = out
    k1, k2 = below[1].k1, below[1].k2
    M = (
        gamma[0] + k1 * gamma[2] + b[0],
        gamma[1] + k1 * (gamma[3] + b[0]),
        gamma[2] - k2 * (gamma[0] + b[1]),
        gamma[3] - k2 * gamma[1] + b[1],
    )
    reached = response[0] * (M[3] * out[0] - M[1] * out[1]) + response[1] * (M[0] * out[1] - M[2] * out[0])
    return reached / (M[0] * M[3] - M[1] * M[2])


def _uncoupled(layers, lights, s2, mu: float, b: Tensor, out: Tensor, lowest: Tensor | None) -> Tensor:
    """The same in one mode without scattering on the way: what it makes of light that scattered once."""
    response = s2.new_zeros(())
    admittance = s2.new_zeros(())
    below: Coefficients | None = None
    for layer, beams in zip(reversed(layers), reversed(lights), strict=True):
        squared = s2 + (layer.sigma / mu) ** 2
        decay = torch.sqrt(squared)
        if layer.d is None:
            response = sum(light.source * light.down / (light.sigma + decay) for light in beams)
            admittance = decay
            below = layer
            continue
        mode = Mode(decay, squared, layer.d)
        if below is None:
            assert lowest is not None
            G = lowest
        else:
            G = layer.sigma / below.sigma * (below.eta / layer.eta) ** 2 * admittance
        near, far = mode.lit(beams)
        passed = mode.sech / (1 + G * mode.th)
        response = near + passed * (far + response)
        admittance = squared * mode.th + mode.sech * passed * G
        below = layer
    return out / (admittance + b) * response


def _near_extinction(layers: list[Coefficients], s: Tensor) -> Tensor:
    """Extinction that light has near the face of the first of `layers` [1/mm], (S, N) or (N,).

    A mean that weighs what is near.
    """
    sigma = layers[0].sigma
    if len(layers) == 1:
        return sigma
    weight, near, left = torch.full_like(sigma, TINY), TINY * sigma, 1.0
    for layer in layers:
        if layer.d is None:
            share, rest = left, 0.0
        else:
            depth = (_NEAR_SIGMA * layer.sigma + _NEAR_S * s[:, None]) * layer.d
            rest = left * torch.exp(-depth.clamp_max(_FAR))  # beyond, denormal numbers take ten times longer
            share = left - rest
        weight, near, left = weight + share, near + layer.sigma * share, rest
    return near / weight  # of a thin slab only what is there counts


def _face(
    layer: Coefficients, s2: Tensor, near: Tensor, modes: TwoModes, growth: tuple[float, float]
) -> Pair:
    """What a face of `layer` lets out of each mode, over D there [1/mm]."""
    x = s2 / near**2
    first, second = (
        b * layer.sigma * torch.sqrt(grown * x + 1 / mu**2)
        for b, mu, grown in zip(modes.b, modes.mu, growth, strict=True)
    )
    return first, second


def _product(a: Matrix, b: Matrix) -> Matrix:
    return (
        a[0] * b[0] + a[1] * b[2],
        a[0] * b[1] + a[1] * b[3],
        a[2] * b[0] + a[3] * b[2],
        a[2] * b[1] + a[3] * b[3],
    )


def _row_times(r: Pair, a: Matrix) -> Pair:
    return r[0] * a[0] + r[1] * a[2], r[0] * a[1] + r[1] * a[3]
