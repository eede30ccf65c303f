"""Mean cosines and boundary coefficients of the two modes of `layered-sp3`, by refractive index."""

import math
from typing import NamedTuple

from texsss.errors import DomainError


class TwoModes(NamedTuple):
    """Per mode: mean cosine, boundary loss, and growth of loss and exit with frequency; and its weight."""

    mu: tuple[float, float]
    b: tuple[float, float]
    gamma: tuple[float, float]
    delta: tuple[float, float]
    w: tuple[float, float]  # Σ w = 1 and Σ w μ² = ⅓


# eta: μ1 μ2, b1 b2, γ1 γ2, δ1 δ2. Gauss nodes at eta 1; the others are fitted to half-spaces of
# albedo .4 to .999 solved by integral transport.
_FITTED = {
    1.0: ((0.2113249, 0.7886751), (1.0, 1.0), (1.0, 1.0), (1.0, 1.0)),
    1.1: ((0.16907, 0.77852), (0.067696, 0.89174), (148.41, 3.6767), (20.279, 2.4125)),
    1.2: ((0.21354, 0.86588), (0.044862, 0.80475), (148.41, 4.1015), (38.542, 2.2842)),
    1.3: ((0.28336, 0.94983), (0.044072, 0.79374), (148.41, 3.7649), (106.60, 1.6315)),
    1.33: ((0.28462, 0.96756), (0.042150, 0.75428), (148.41, 3.7518), (95.369, 1.6215)),
    1.4: ((0.26827, 0.99459), (0.036438, 0.63064), (148.41, 4.0085), (55.378, 1.8326)),
    1.5: ((0.25610, 0.99459), (0.027079, 0.48842), (148.41, 5.0925), (27.917, 2.2529)),
    1.6: ((0.26713, 0.99459), (0.019483, 0.40854), (148.41, 6.4265), (21.723, 2.6469)),
}
ETA_MAX = max(_FITTED)


def two_modes(eta: float) -> list[tuple[float, TwoModes]]:
    """Parameter sets at `eta` and their weights in the result.

    One set, interpolated, above 1.1; below, where the fit changes character, both ends, between which
    results are interpolated. Raises DomainError: outside 1..1.6.
    """
    if not 1 <= eta <= ETA_MAX:
        raise DomainError(
            f"layered-sp3: expected eta in 1..{ETA_MAX:g}, for which it is fitted, got {eta:g}; "
            "use layered-diffusion beyond."
        )
    if eta in _FITTED:
        return [(1.0, _modes(*_FITTED[eta]))]
    knots = sorted(_FITTED)
    high = next(k for k in knots if k > eta)
    low = knots[knots.index(high) - 1]
    share = (eta - low) / (high - low)
    if low == 1.0:
        return [(1 - share, _modes(*_FITTED[low])), (share, _modes(*_FITTED[high]))]
    linear = [_blend(a, b, share) for a, b in zip(_FITTED[low][:2], _FITTED[high][:2], strict=True)]
    logarithmic = [
        tuple(math.exp(x) for x in _blend(_log(a), _log(b), share))
        for a, b in zip(_FITTED[low][2:], _FITTED[high][2:], strict=True)
    ]
    return [(1.0, _modes(*linear, *logarithmic))]


def _modes(mu, b, gamma, delta) -> TwoModes:
    first, second = mu[0] ** 2, mu[1] ** 2
    w = (second - 1 / 3) / (second - first)
    return TwoModes(mu, b, gamma, delta, (w, 1 - w))


def _log(pair: tuple[float, float]) -> tuple[float, float]:
    return math.log(pair[0]), math.log(pair[1])


def _blend(a: tuple[float, float], b: tuple[float, float], share: float) -> tuple[float, float]:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
