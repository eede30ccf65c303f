"""Reflection from a rough dielectric surface: GGX microfacets."""

import math

import torch

from texsss.light.emitters import basis
from texsss.media import fresnel
from texsss.types import Float, Tensor, unit

LEAST_ALPHA = 1e-3  # smoother than this, a point light's highlight is thinner than any pixel


def alpha_of(roughness: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
    """Microfacet slope width from perceptual roughness 0..1: its square. Source: Burley 2012."""
    return (roughness.clamp(0, 1) ** 2).clamp_min(LEAST_ALPHA)


def reflection(
    normal: Float[Tensor, "P 3"],
    view: Float[Tensor, "P 3"],
    light: Float[Tensor, "P 3"],
    roughness: Float[Tensor, " P"],
    eta: float,
) -> Float[Tensor, " P"]:
    """Bidirectional reflectance × cosine towards the light [1/sr]; 0 below the horizon.

    All directions unit, away from the surface. Height-correlated shadowing and masking, exact Fresnel
    at the half vector. Source: Walter et al. 2007; Heitz 2014, eq. 99.
    """
    alpha = alpha_of(roughness)
    to_light, to_view = _dot(normal, light), _dot(normal, view)
    above = (to_light > 0) & (to_view > 0)
    to_light, to_view = to_light.clamp_min(1e-6), to_view.clamp_min(1e-6)
    half = unit(light + view)
    squared = alpha * alpha
    # G2 / (4 to_light to_view), with the cosines inside
    masking = 0.5 / (to_light * _stretch(to_view, squared) + to_view * _stretch(to_light, squared))
    value = (
        _facets(normal, half, squared)
        * masking
        * fresnel.reflectance(_dot(view, half).clamp(0, 1), eta)
        * to_light
    )
    return torch.where(above, value, torch.zeros_like(value))


def density(
    normal: Float[Tensor, "P 3"],
    view: Float[Tensor, "P 3"],
    light: Float[Tensor, "P 3"],
    roughness: Float[Tensor, " P"],
) -> Float[Tensor, " P"]:
    """Density with which `sample_reflection` draws `light` [1/sr]; for directions above the horizon.

    Source: Heitz 2018, eq. 17: visible facets, over the Jacobian of the reflection.
    """
    squared = alpha_of(roughness) ** 2
    to_view = _dot(normal, view).clamp_min(1e-4)
    return _facets(normal, unit(light + view), squared) / (2 * (to_view + _stretch(to_view, squared)))


def sample_reflection(
    normal: Float[Tensor, "P 3"],
    view: Float[Tensor, "P 3"],
    roughness: Float[Tensor, " P"],
    eta: float,
    square: Float[Tensor, "P 2"],
) -> tuple[Float[Tensor, "P 3"], Float[Tensor, " P"]]:
    """Mirrored directions, drawn from the visible microfacets, and what each carries.

    The mean of weight × radiance from the direction is the reflected radiance; weight is 0 below the
    horizon. `square` (P, 2) in 0..1². Source: Heitz 2018; Dupuy & Benyoub 2023 (spherical caps).
    """
    alpha = alpha_of(roughness)
    tangent, bitangent = basis(normal)
    local = torch.stack([_dot(view, tangent), _dot(view, bitangent), _dot(view, normal).clamp_min(1e-4)], -1)
    width = torch.stack([alpha, alpha, torch.ones_like(alpha)], -1)
    stretched = unit(local * width)
    # a point of the spherical cap of directions that the stretched view can mirror to
    z = (1 - square[:, 0]) * (1 + stretched[:, 2]) - stretched[:, 2]
    sine = torch.sqrt((1 - z * z).clamp(0, 1))
    angle = 2 * math.pi * square[:, 1]
    cap = torch.stack([sine * torch.cos(angle), sine * torch.sin(angle), z], -1)
    facet = unit((cap + stretched) * width)
    cosine = _dot(facet, local)
    mirrored = 2 * cosine[:, None] * facet - local
    up = mirrored[:, 2]
    squared = alpha * alpha
    near, far = local[:, 2], up.clamp_min(1e-6)
    # G2 / G1 of the view
    view_term, light_term = far * _stretch(near, squared), near * _stretch(far, squared)
    share = (view_term + near * far) / (view_term + light_term)
    weight = torch.where(up > 0, share * fresnel.reflectance(cosine.clamp(0, 1), eta), torch.zeros_like(up))
    world = mirrored[:, :1] * tangent + mirrored[:, 1:2] * bitangent + mirrored[:, 2:] * normal
    return unit(world), weight


def _facets(
    normal: Float[Tensor, "P 3"], half: Float[Tensor, "P 3"], squared: Float[Tensor, " P"]
) -> Float[Tensor, " P"]:
    """Density D of facets that face along `half` [1/sr]; `squared`: alpha²."""
    to_half = _dot(normal, half).clamp(0, 1)
    # 1 - cos² would cancel where the highlight peaks; the cross product does not
    sine2 = torch.linalg.cross(normal, half).square().sum(-1)
    return squared / (math.pi * (sine2 + squared * to_half * to_half) ** 2)


def _stretch(cosine: Float[Tensor, " P"], squared: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
    """sqrt(cos² + alpha² sin²), the root in Smith's function."""
    return torch.sqrt(squared + (1 - squared) * cosine * cosine)


def _dot(a: Float[Tensor, "P 3"], b: Float[Tensor, "P 3"]) -> Float[Tensor, " P"]:
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
