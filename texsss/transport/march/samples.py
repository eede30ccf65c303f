"""Single scattering by evenly spaced samples along the view ray: subsurface texture mapping."""

from typing import no_type_check

import torch

from texsss.transport.march.kernel import meet, optical, split


@no_type_check
def sample_step(ray, light, planes, size, sigma_s, sigma_t, g, t, step, optical0, total, phase):
    """One sample at t [mm] that stands for `step` mm: optical depth of the view ray after it, light so far.

    Source: François et al. 2006, Algorithm 1, with n samples instead of n + 1.
    """
    sigma_s, sigma_t = split(sigma_s), split(sigma_t)
    depth, way, boundary, share, _ = meet(ray, light, planes, size, split(g), t, phase)
    layers, channels = len(sigma_t), len(sigma_t[0])
    below = t * ray[6]
    within = [below < d for d in depth]  # above boundary i; rising with i
    gathered, passed = [], []
    for c in range(channels):
        if layers > len(depth):
            extinction, source = sigma_t[-1][c], sigma_s[-1][c] * share[-1][min(c, len(share[-1]) - 1)]
        else:
            extinction = source = 0.0
        for i in reversed(range(len(depth))):
            extinction = torch.where(within[i], sigma_t[i][c], extinction)
            source = torch.where(within[i], sigma_s[i][c] * share[i][min(c, len(share[i]) - 1)], source)
        left = torch.exp(-optical0[c] - optical(way, boundary, sigma_t, c))
        gathered.append(total[c] + source * left * step)
        passed.append(optical0[c] + extinction * step)
    return passed, gathered
