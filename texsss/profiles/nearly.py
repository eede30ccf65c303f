"""Light that is hardly deflected but once: where media scatter forwards, much that scatters several times.

On its way to where it turns back, and out again, it keeps so near to its direction that it leaves as if it
had not scattered there. It scatters once in a medium that scatters less by what goes straight on, g³ of it,
and by what is left of the phase function, of mean cosine (g - g³) / (1 - g³). Oblique light is led aside:
of that less goes straight on.
Source: our own; δ-peaks of Wiscombe 1977. Against a Monte Carlo g² is too much in thick media, and much less
than g³ too little everywhere.
"""

from typing import no_type_check

from texsss.profiles.slab import Directions


def aligned(directions: Directions) -> float:
    """How much of what goes straight on keeps its way, 1 at normal incidence."""
    return sum(share * cosine**2 for cosine, share in directions)


@no_type_check
def peaked(unreduced, directions):
    """Layers of true coefficients in which going straight on is no scattering; as they are where g < 0."""
    found = []
    for layer in unreduced:
        straight = aligned(directions) * layer.g.clamp_min(0) ** 3
        less = layer.sigma_s * straight
        g = (layer.g - straight) / (1 - straight)
        found.append(layer._replace(sigma_s=layer.sigma_s - less, sigma=layer.sigma - less, g=g))
    return found
