"""Single scattering by evenly spaced samples along the view ray: subsurface texture mapping."""

from typing import no_type_check

import torch

from texsss.transport.march.kernel import optical


@no_type_check
def sample(sigma_s, sigma_t, below, step, found, passed, total):
    """One sample that stands for `step` mm: optical depths after it and light so far, per channel.

    `sigma_s`, `sigma_t` (layers, channels) [1/mm], with points behind where they are maps. `below`:
    depth of M under the surface [mm]; `found`: what `meet` found at M.
    Source: François et al. 2006, Algorithm 1, with n samples instead of n + 1.
    """
    depth, way, boundary, share, _ = found
    layers = len(share)
    within = [below < d for d in depth]  # above boundary i, and then above all that follow
    gathered, reached = [], []
    for c, (scattering, extinction) in enumerate(zip(sigma_s.unbind(1), sigma_t.unbind(1))):
        scattering, extinction = scattering.unbind(0), extinction.unbind(0)
        source = [s * p[min(c, len(p) - 1)] for s, p in zip(scattering, share)]
        here, gain = (extinction[-1], source[-1]) if layers > len(depth) else (0.0, 0.0)
        for i in reversed(range(len(depth))):
            here = torch.where(within[i], extinction[i], here)
            gain = torch.where(within[i], source[i], gain)
        left = torch.exp(-passed[c] - optical(way, boundary, extinction))
        gathered.append(total[c] + gain * left * step)
        reached.append(passed[c] + here * step)
    return reached, gathered
