"""Measured and published media by name."""

from texsss.errors import DomainError
from texsss.media.medium import Medium

# name: sigma_s' [1/mm] RGB, sigma_a [1/mm] RGB, eta. Source: Jensen et al. 2001, figure 5.
_REDUCED = {
    "apple": ((2.29, 2.39, 1.97), (0.0030, 0.0034, 0.046), 1.3),
    "chicken1": ((0.15, 0.21, 0.38), (0.015, 0.077, 0.19), 1.3),
    "cream": ((7.38, 5.47, 3.15), (0.0002, 0.0028, 0.0163), 1.3),
    "ketchup": ((0.18, 0.07, 0.03), (0.061, 0.97, 1.45), 1.3),
    "marble": ((2.19, 2.62, 3.00), (0.0021, 0.0041, 0.0071), 1.5),
    "potato": ((0.68, 0.70, 0.55), (0.0024, 0.0090, 0.12), 1.3),
    "skin1": ((0.74, 0.88, 1.01), (0.032, 0.17, 0.48), 1.3),
    "skin2": ((1.09, 1.59, 1.79), (0.013, 0.070, 0.145), 1.3),
    "spectralon": ((11.6, 20.4, 14.9), (0.0, 0.0, 0.0), 1.3),
    "wholemilk": ((2.55, 3.21, 3.77), (0.0011, 0.0024, 0.014), 1.3),
}

# name: sigma_s, sigma_t [1/mm] RGB, g, of a fish. Source: François et al. 2006, table 1; it gives no
# eta, and its march ignores refraction, hence 1.
_FISH = {
    "fish-blood": ((6.0, 3.0, 2.0), (6.6, 3.6, 2.6), 0.40),
    "fish-dermis": ((2.0, 1.0, 1.0), (2.6, 1.6, 1.6), 0.25),
    "fish-organs": ((1.0, 1.0, 2.0), (1.5, 1.5, 2.5), 0.80),
}

PRESETS = tuple(sorted((*_REDUCED, *_FISH)))
"""Names that `preset` knows."""


def preset(name: str) -> Medium:
    """A published medium by name, coefficients per RGB channel [1/mm].

    Those of Jensen et al. 2001 are given as sigma_s' and come with g = 0; spectralon absorbs nothing.
    Raises DomainError: for an unknown name; the choices are listed.
    """
    key = name.lower() if isinstance(name, str) else ""
    if key in _REDUCED:
        sigma_s, sigma_a, eta = _REDUCED[key]
        return Medium(sigma_a, sigma_s, 0.0, eta)
    if key in _FISH:
        sigma_s, sigma_t, g = _FISH[key]
        return Medium([t - s for s, t in zip(sigma_s, sigma_t, strict=True)], sigma_s, g, 1.0)
    raise DomainError(f"preset: expected one of {', '.join(PRESETS)}, got {name!r}.")
