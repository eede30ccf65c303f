"""Layers that hardly scatter: light crosses them straight, which diffusion does not know.

Diffusion spreads light along a layer by D = μ² / σ, as if it came free paths from all around. In a layer that
is thinner than that it comes from the layers about it, or from a face that mirrors it. Nor do such films hold
back light by their own index: at which angles it gets out is decided where it last scattered.
"""

from typing import no_type_check

import torch

from texsss.profiles.layered_diffusion import admittance
from texsss.profiles.slab import FAR, TINY, added

SLANT = 6.0  # path over thickness of what spreads most: 1 to 12 are within 3 % of R̂(0) of each other
OWN = 4.0  # a layer makes 1 - e^-(4 σ d) of a face its own: 3 to 6 are alike


@no_type_check
def spread_aside(layers):
    """Share of D by which light spreads along every layer, (1, N) each, 1 at most; 1.0 in a half-space.

    That is σ times the mean path since the last scattering of light that leaves the layer, up and down:
    layers that are alike are one, and thick ones know nothing of others. The outer faces mirror it all.
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
def let_out(layers):
    """What the first layer's face lets out of the light beneath, over what it would if that were thick.

    (1, N). Every layer counts by its optical depth from there, with the admittance of a face of its index.
    """
    left, found, whole = 1.0, TINY, TINY
    for layer in layers:
        share = left
        if layer.d is not None:
            x = (OWN * layer.sigma * layer.d).clamp_max(FAR)
            share, left = -left * torch.expm1(-x), left * torch.exp(-x)
        found = found + share * (admittance(layer.eta) / admittance(layers[0].eta))
        whole = whole + share
    return found / whole
