"""Single scattering by evenly spaced samples along the view ray: subsurface texture mapping."""

from typing import no_type_check

import torch

from texsss.transport.march.kernel import optical


@no_type_check
def layer_of(sigma_s, sigma_t, below, depth):
    """σs per layer and channel where M lies in that layer, else 0; and σt at M per channel.

    `sigma_s`, `sigma_t` (layers, channels) [1/mm], with points behind where they are maps; `below`:
    depth of M under the surface [mm]; `depth`: of the boundaries under M.
    """
    under = [(below >= d).to(below.dtype) for d in depth]
    inside, above = [], 1
    for u in under:
        inside.append(above - u)
        above = u
    if len(sigma_t) > len(depth):
        inside.append(above)
    here = [sum(k * w for k, w in zip(s.unbind(0), inside)) for s in sigma_t.unbind(1)]
    return [[k * w for k, w in zip(s.unbind(0), inside)] for s in sigma_s.unbind(1)], here


@no_type_check
def sample(gain, sigma_t, step, found, passed, total):
    """Light so far, per channel, with one sample that stands for `step` mm; `gain`: what `layer_of` found.

    `found`: what `meet` found at M; `passed`: optical depth of the view ray to M.
    Source: François et al. 2006, Algorithm 1, with n samples instead of n + 1.
    """
    _, way, boundary, share, _ = found
    within = [torch.minimum(way, b) for b in boundary]
    gathered = []
    for c, extinction in enumerate(sigma_t.unbind(1)):
        left = torch.exp(-passed[c] - optical(way, within, extinction.unbind(0)))
        bright = sum(k * p[min(c, len(p) - 1)] for k, p in zip(gain[c], share))
        gathered.append(total[c] + bright * left * step)
    return gathered
