"""Layers that hardly scatter: light crosses them straight, which diffusion does not know.

Diffusion spreads light along a layer by D = μ² / σ, as if it came free paths from all around. In a layer that
is thinner than that it comes from the layers about it, or from a face that mirrors it. What crosses on its
way to an outer face is no diffusion at all (`straight`). Nor do such films hold back light by their own
index: at which angles it gets out is decided where it last scattered.
"""

from typing import NamedTuple, no_type_check

import torch

from texsss.profiles.layered_diffusion import admittance
from texsss.profiles.slab import FAR, TINY, added
from texsss.profiles.straight import faded
from texsss.types import Tensor

SLANT = 2.0  # path over thickness of what spreads most: 1.5 to 3 are alike, 6 isolates faint films
OWN = 4.0  # a layer makes 1 - e^-(4 σ d) of a face its own: 3 to 4 are alike
ROUND = 0.03  # of the corner where a layer gets as dense as those about it: 0 to .1 are alike
DOUBT = 0.05  # of a profile that is known no better: what is left of it fades, too; .02 to .1 are alike


class Way(NamedTuple):
    """From one layer to a face, (1, N) each."""

    share: Tensor  # of all light that gets there
    away: Tensor | None  # crossed straight [mm]; None from the first layer


class Scattered(NamedTuple):
    """Where light that reaches a face last scattered, (1, N) each."""

    sigma: Tensor  # mean extinction there [1/mm]
    squared: Tensor | float  # mean eta² there, over that of the layer at the face
    let_out: Tensor | float  # of it by the face, over what that would if its own layer were thick


@no_type_check
def last_scattered(layers):
    """As seen from the face of the first of `layers`, each of which counts by its optical depth from there.

    Differentiable.
    """
    first = layers[0]
    if len(layers) == 1:
        return Scattered(first.sigma, 1.0, 1.0)
    shares = _shares(layers, OWN)
    sigma = added([share * layer.sigma for share, layer in zip(shares, layers)])
    squared = let_out = 1.0
    if len({layer.eta for layer in layers}) > 1:
        own = admittance(first.eta)
        squared = added([x * (layer.eta / first.eta) ** 2 for x, layer in zip(shares, layers)])
        let_out = added([x * (admittance(layer.eta) / own) for x, layer in zip(shares, layers)])
    return Scattered(sigma, squared, let_out)


@no_type_check
def ways(layers):
    """From every one of `layers` to the face of the first, or into them; none where there is but one.

    Faces and modes know how far light flies within a medium, so that of what lies above a layer only what is
    rarer than it is crossed straight: all of a clear film, nothing of layers that are alike, or denser.
    Differentiable.
    """
    found = []
    for k, share in enumerate(_shares(layers, SLANT) if len(layers) > 1 else ()):
        straight = [above.d * (1 - _at_most_one(above.sigma / layers[k].sigma)) for above in layers[:k]]
        found.append(Way(share, added(straight) if k else None))
    return tuple(found)


@no_type_check
def _shares(layers, slant):
    """Of light that goes to the face of the first layer by `slant` times the depth, and 1 together."""
    left, shares = 1.0, []
    for layer in layers:
        shares.append(left)
        if layer.d is not None:
            x = (slant * layer.sigma * layer.d).clamp_max(FAR)
            shares[-1], left = -left * torch.expm1(-x), left * torch.exp(-x)
    shares[-1] = shares[-1] + TINY  # where there is no layer at all
    whole = added(shares)
    return [share / whole for share in shares]


@no_type_check
def one_way(ways, fading, s):
    """What is left at frequency `s` of light that goes these ways, `fading` by each."""
    once, _ = _faded(ways, fading, s)
    return once


@no_type_check
def there_and_back(ways, fading, s):
    """What is left at frequency `s` of light that goes these ways and back, over that of its way back.

    It comes back from where it went: what a thin film on a clear one scatters crosses neither way.
    """
    once, twice = _faded(ways, fading, s)
    return twice / (once + DOUBT * (1 - once))


@no_type_check
def _faded(ways, fading, s):
    first, *below = ways
    once = twice = first.share
    for way in below:
        left = faded(fading, s * way.away)
        share = way.share * left
        once, twice = once + share, twice + share * left
    return once, twice


@no_type_check
def spread_aside(layers):
    """Share of D by which light spreads along every layer, (1, N) each, 1 at most; 1.0 in a half-space.

    That is σ times the mean path since the last scattering of light that leaves the layer, up and down:
    layers that are alike are one, and thick ones know nothing of others. The outer faces mirror it all. What
    sees an outer face crosses straight instead, but for the share again that scatters on the way.
    Differentiable.
    """
    endless = layers[-1].d is None
    finite = layers[:-1] if endless else layers
    depths = [SLANT * layer.sigma * layer.d for layer in finite]
    # of every layer: path in it of light that crosses it, and the share that does
    crossed = [(-torch.expm1(-x) / layer.sigma, torch.exp(-x)) for x, layer in zip(depths, finite)]
    if endless:
        up = 1 / layers[-1].sigma
    else:  # down, up and down again without end
        whole = added(depths)
        again = _paths(crossed[::-1], 0.0)[-1]
        up = (_paths(crossed, 0.0)[-1] + torch.exp(-whole) * again) / (TINY - torch.expm1(-2 * whole))
    ups = _paths(crossed[::-1], up)
    downs = _paths(crossed, ups[-1] if ups else up)
    shares = [_at_most_one((u + d) / 2 * layer.sigma) for u, d, layer in zip(reversed(ups), downs, finite)]
    hidden = _hidden(finite)
    if not endless:
        hidden = [a * b for a, b in zip(hidden, _hidden(finite[::-1])[::-1])]
    shares = [share * (share + unseen * (1 - share)) for share, unseen in zip(shares, hidden)]
    return [*shares, 1.0] if endless else shares


@no_type_check
def _at_most_one(x):
    """The smaller of `x` and 1, its corner rounded."""
    step = (1 - x).clamp_min(0)
    return x * (step + ROUND) / (step + ROUND * x)


@no_type_check
def _paths(crossed, path):
    """Mean paths of light that leaves layer after layer, from `path` of what enters the first."""
    found = []
    for within, through in crossed:
        path = within + through * path
        found.append(path)
    return found


@no_type_check
def _hidden(layers):
    """Of each layer, the share of its light that does not see the face of the first."""
    above, found = None, []
    for layer in layers:
        depth = OWN * layer.sigma * layer.d
        found.append(torch.zeros_like(depth) if above is None else -torch.expm1(-above))
        above = (depth if above is None else above + depth).clamp_max(FAR)
    return found
