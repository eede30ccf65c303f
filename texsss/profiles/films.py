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
from texsss.types import Tensor

SLANT = 2.0  # path over thickness of what spreads most: 1.5 to 3 are alike, 6 isolates faint films
OWN = 4.0  # a layer makes 1 - e^-(4 σ d) of a face its own: 3 to 4 are alike


class Scattered(NamedTuple):
    """Where light that reaches a face last scattered, (1, N) each."""

    sigma: Tensor  # mean extinction there [1/mm]
    away: Tensor | None  # how much farther from the face than if all were like there [mm]; None where all is
    squared: Tensor | float  # mean eta² there, over that of the layer at the face
    let_out: Tensor | float  # of it by the face, over what that would if its own layer were thick


@no_type_check
def last_scattered(layers):
    """As seen from the face of the first of `layers`, each of which counts by its optical depth from there.

    Its mean depth is ∫ e^-(OWN τ), which is (mean of 1/σ) / OWN; light from a medium of the mean σ would come
    from 1 / (OWN σ), which faces know of. The difference is the distance that is crossed straight: all of a
    clear film, and nothing where layers are alike. Differentiable.
    """
    first, last = layers[0], layers[-1]
    if len(layers) == 1:
        return Scattered(first.sigma, None, 1.0, 1.0)
    left, shares = 1.0, []
    for layer in layers:
        shares.append(left)
        if layer.d is not None:
            x = (OWN * layer.sigma * layer.d).clamp_max(FAR)
            shares[-1], left = -left * torch.expm1(-x), left * torch.exp(-x)
    whole = added(shares) + TINY
    dense = added([share * layer.sigma for share, layer in zip(shares, layers)]) + TINY * last.sigma
    apart = [  # Σ 1/σ Σ σ - (Σ 1)² without the difference
        a * b * ((one.sigma - two.sigma) ** 2 / (one.sigma * two.sigma))
        for k, (a, one) in enumerate(zip(shares, layers))
        for b, two in zip(shares[:k], layers)
    ]
    squared = let_out = 1.0
    if len({layer.eta for layer in layers}) > 1:
        own = admittance(first.eta)
        squared = (
            added([x * (layer.eta / first.eta) ** 2 for x, layer in zip(shares, layers)]) + TINY
        ) / whole
        let_out = (
            added([x * (admittance(layer.eta) / own) for x, layer in zip(shares, layers)]) + TINY
        ) / whole
    return Scattered(dense / whole, added(apart) / (OWN * dense), squared, let_out)


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
    shares = [((u + d) / 2 * layer.sigma).clamp_max(1) for u, d, layer in zip(reversed(ups), downs, finite)]
    hidden = _hidden(finite)
    if not endless:
        hidden = [a * b for a, b in zip(hidden, _hidden(finite[::-1])[::-1])]
    shares = [share * (share + unseen * (1 - share)) for share, unseen in zip(shares, hidden)]
    return [*shares, 1.0] if endless else shares


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
