"""A quotient of exponentials that neither overflows nor cancels."""

import torch

from texsss.types import Tensor

_SERIES_BELOW = 1e-2


def relexp(x: Tensor) -> Tensor:
    """(1 - e^-x) / x for x ≥ 0; 1 at x = 0. Differentiable everywhere."""
    if not x.requires_grad:
        # 1 - e^-x = 2 t / (1 + t), t = tanh x/2: exact for small arguments, at a third of the time of expm1
        x = x.clamp_min(1e-30)
        t = torch.tanh(x / 2)
        return 2 * t / (x + x * t)
    # the derivative of the quotient cancels near 0: a series takes over
    large = x.clamp_min(_SERIES_BELOW)
    small = x.clamp_max(_SERIES_BELOW)
    series = 1 - small / 2 * (1 - small / 3 * (1 - small / 4 * (1 - small / 5 * (1 - small / 6))))
    return torch.where(x < _SERIES_BELOW, series, -torch.expm1(-large) / large)
