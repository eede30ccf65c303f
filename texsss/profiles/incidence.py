"""The direction of the light that entered, as cosines inside the medium."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import torch

from texsss.errors import DomainError
from texsss.media import fresnel
from texsss.media.medium import number
from texsss.numerics.quadrature import gauss_weighted

Incidence = float | str
"""`normal`, `diffuse` (Lambertian, weighted by what enters) or an angle from the normal outside [rad]."""

NODES = 2  # directions of diffuse light where it is refracted: 1 is 5 % off in thin slabs, 2 are 1 %
NODES_WIDE = 3  # ... and where it comes in at grazing, too
GRAZING = 1e-3  # least cosine outside
NODES_FINE = 8  # ... where it is told how much thin slabs take of it: .3 % off


def incidence_directions(
    incidence: Incidence, eta: float, nodes: int | None = None
) -> tuple[tuple[float, float], ...]:
    """Cosines of the refracted light in the medium, and their shares, which sum to 1.

    Diffuse light: Gauss nodes, few unless told, of the distribution of the flux that enters.
    Raises DomainError: for other names, and angles outside 0..π/2.
    """
    if incidence == "normal":
        return ((1.0, 1.0),)
    if incidence == "diffuse":
        return _entered(eta, nodes or (NODES if eta >= 1.2 else NODES_WIDE))
    angle = math.nan if isinstance(incidence, str | None) else number("incidence", incidence)
    if not 0 <= angle <= math.pi / 2:
        raise DomainError(
            f"incidence: expected 'diffuse', 'normal' or an angle in 0..π/2 [rad], got {incidence!r}."
        )
    # light that grazes gets into no layer of index 1: stay a hair above
    return ((math.sqrt(1 - min(math.sin(angle) ** 2, 1 - GRAZING**2) / eta**2), 1.0),)


def mean_direction(incidence: Incidence, eta: float) -> tuple[tuple[float, float], ...]:
    """All light at its mean cosine: .667 at eta 1 and .865 at 1.4 for diffuse light."""
    directions = incidence_directions(incidence, eta)
    return ((sum(cosine * share for cosine, share in directions), 1.0),)


def finer(directions: Sequence[tuple[float, float]], etas: Sequence[float]) -> Sequence[tuple[float, float]]:
    """Diffuse light in more directions, if all `etas` are alike; other light as it is.

    What grazes where they differ is mirrored there, which profiles leave out.
    """
    known = [light("diffuse", etas[0]) for light in (incidence_directions, mean_direction)]
    diffuse = tuple(directions) in known and len(set(etas)) == 1
    return _entered(etas[0], NODES_FINE) if diffuse else directions


@lru_cache(maxsize=64)
def _entered(eta: float, count: int) -> tuple[tuple[float, float], ...]:
    def flux(mu: np.ndarray) -> np.ndarray:  # μ_o dμ_o = eta² μ dμ
        outside = np.sqrt(np.clip(1 - (1 - mu**2) * eta**2, 0, None))
        return mu * fresnel.transmittance(torch.from_numpy(outside), eta).numpy()

    mu, weight = gauss_weighted(flux, math.sqrt(1 - 1 / eta**2), 1.0, count)
    return tuple((float(m), float(w)) for m, w in zip(mu, weight / weight.sum(), strict=True))
