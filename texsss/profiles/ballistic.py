"""Light that crosses a stack without being scattered: what T̂ and R̂ do not hold."""

import torch

from texsss.profiles.hankel import Material, as_table
from texsss.profiles.incidence import Incidence, incidence_directions
from texsss.profiles.slab import crossed, layers_of, mirrors
from texsss.types import Float, Tensor

NODES = 24  # directions of diffuse light: 1e-5 of what 64 find


def ballistic(
    material: Material, *, incidence: Incidence = "diffuse"
) -> tuple[Float[Tensor, "*B C"], Float[Tensor, "*B C"]]:
    """What leaves unscattered by the top and by the bottom, per unit of light that entered.

    The top sends out what the bottom mirrored; a stack without a bottom has neither. In reduced coefficients,
    as T̂ counts, so that R̂(0) + T̂(0) + both + what is absorbed is 1. `material`, `incidence`: as for
    `hankel_profiles`. Differentiable in coefficients and thickness. Raises DomainError: for an unknown
    incidence.
    """
    table = as_table(material)
    layers = layers_of(table)
    none = torch.zeros_like(layers[0].sigma)
    above, below = none, none
    directions = () if table.bottomless else incidence_directions(incidence, table.eta[0], NODES)
    for cosine, share in directions:
        top, bottom = mirrors(table.eta, cosine)
        through = torch.exp(-crossed(layers, cosine))
        reaches = share * through / (1 - top * bottom * through**2)
        above = above + reaches * bottom * through * (1 - top)
        below = below + reaches * (1 - bottom)
    shape = table.channels, *table.batch
    return above.reshape(shape).movedim(0, -1), below.reshape(shape).movedim(0, -1)
