"""Light that scattered again, led out as two modes should lead out light that scattered once.

How wrong they are about that is known, for single scattering is known exactly; and the last way out is much
the same. With ρ, the truth over what modes make of it, and 1 at s = 0, what scattered twice and more is
multiplied by (1 + most ρ) / (most + ρ), which is between 1 / most and most. Totals stay as they are.
Source: our own.
"""

import math
from typing import no_type_check

import torch

from texsss.profiles.films import ways
from texsss.profiles.slab import TINY, added

# About √ρ back and the fifth root of ρ through: best on 315 random stacks of one index; 2.5 to 3.5 and 1.3 to
# 1.6 are alike
MOST = {"reflectance": 3.0, "transmittance": 1.5}
SMOOTH = 0.1  # below this ρ fades to 0, for R̂1 can be negative
FADED = 0.01  # light that scattered once, over the rest, that says nothing of it any more
LEAST = 1e-12  # ... or of what entered


@no_type_check
def most(layers, side, isotropic):
    """Of what leaves by the face of the first of `layers`, a number or (1, N). `side`: as seen from above.

    What scatters forwards leaves otherwise than what reduced coefficients scatter once.
    """
    if isotropic:
        return MOST[side]
    shares = [way.share for way in ways(layers)] or [1.0]
    across = added([share * (1 - layer.g**2) ** 2 for share, layer in zip(shares, layers)])
    return 1 + (MOST[side] - 1) * across


@no_type_check
def scaled(own, once):
    """By how much `once` is to be multiplied, so that ρ is 1; both at s = 0, as in `led_out`."""
    return (own + LEAST) / (once + LEAST)


@no_type_check
def led_out(twice, own, once, most):
    """What scattered `twice` and more, led out.

    `own`: what modes make of light that scattered once; `once`: what it is, scaled. All (S, N), and
    differentiable.
    """
    # twice each
    once = once + torch.sqrt(once * once + (own * own * SMOOTH**2 + TINY))
    own, rest = own * (1 + math.hypot(1, SMOOTH)), twice * FADED + LEAST
    return twice * (own + most * once + rest) / (most * own + once + rest)
