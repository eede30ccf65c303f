"""Media from what artists know: a colour and a depth, or the make-up of skin."""

import math

import torch

from texsss.errors import DomainError
from texsss.media.medium import Coefficient, Medium, as_map, check_at_least_zero, expect, home, number
from texsss.media.stack import Layer, Stack
from texsss.types import Float, Tensor


def from_colour(colour: Coefficient, mean_free_path: Coefficient, g: float = 0.0, eta: float = 1.4) -> Medium:
    """The medium of which a half-space looks like `colour` under even light, where nothing refracts.

    `colour` 0..1, linear, and `mean_free_path` 1 / sigma_t [mm]: numbers, triples or maps. eta only
    says how the surface refracts; like all such inversions this one leaves it out.
    Differentiable in colour and mean free path. Raises DomainError: outside 0..1, or for a mean free path
    not above zero.
    Source: d'Eon 2021, A Hitchhiker's Guide to Multiple Scattering, as OpenPBR 1.1 prints it.
    """
    g = number("from_colour.g", g)
    if not -1 < g < 1:
        raise DomainError(f"from_colour: expected -1 < g < 1, got {g:g}; 0 scatters alike in all directions.")
    dtype, device = home((colour, mean_free_path))
    rho = as_map("from_colour.colour", colour, dtype, device)
    path = as_map("from_colour.mean_free_path", mean_free_path, dtype, device)
    low, high = (float(x) for x in rho.detach().aminmax())
    if not (low >= 0 and high <= 1):
        raise DomainError(f"from_colour: expected a colour in 0..1, got {low:g}..{high:g}; clamp it.")
    if not float(path.detach().min()) > 0:
        raise DomainError(
            "from_colour: expected a mean free path > 0 [mm], got 0 or less; use .01 for a hard look."
        )
    # root of the inverse of `to_colour`; the albedo is that of the similar isotropic medium
    s = 4.09712 + 4.20863 * rho - torch.sqrt(9.59217 + 41.6808 * rho + 17.7126 * rho**2)
    s2 = s.clamp(0, 1) ** 2
    albedo = (1 - s2) / (1 - g * s2)
    return Medium((1 - albedo) / path, albedo / path, g, eta)


def to_colour(medium: Medium) -> tuple[Float[Tensor, "..."], Float[Tensor, "..."]]:
    """The colour 0..1 of a half-space under even light where nothing refracts, and 1 / sigma_t [mm].

    The inverse of `from_colour`, to 1e-4. Differentiable but at no absorption. Source: d'Eon 2021.
    """
    expect("to_colour", medium, Medium, "a medium")
    s = torch.sqrt(1 - medium.albedo_prime)
    return (1 - s) * (1 - 0.139 * s) / (1 + 1.17 * s), 1 / medium.sigma_t


WAVELENGTHS = (630.0, 540.0, 450.0)  # that stand for R, G, B [nm]
# molar extinction of haemoglobin [1/cm per mol/l], to base 10; and what makes it absorption [1/mm] of
# whole blood with 150 g/l of it: ln 10 · 150 / 64500 g per mol, per mm
_OXYGENATED = (610.0, 53236.0, 62816.0)
_DEOXYGENATED = (5148.8, 46592.0, 103292.0)
_WHOLE_BLOOD = math.log(10) * 150 / 64500 / 10


def skin(
    melanin: Coefficient = 0.03,
    blood: Coefficient = 0.01,
    epidermis_mm: Coefficient = 0.08,
    *,
    oxygen: float = 0.75,
    eta: float = 1.4,
) -> Stack:
    """Human skin: an epidermis coloured by melanin over a dermis coloured by blood.

    `melanin`: volume share of melanosomes in the epidermis, .01 pale to .4 dark. `blood`: volume share
    in the dermis, .002 to .05. `epidermis_mm`: its thickness [mm]. Numbers or maps (H, W). `oxygen`:
    saturation 0..1. Differentiable. Raises DomainError: when a share leaves 0..1.
    Source: Jacques 1998, Skin Optics: bloodless tissue .244 + 85.3 e^(-(nm - 154) / 66.2), melanosomes
    6.6e11 nm^-3.33, reduced scattering 2e5 nm^-1.5 (fibres) + 2e12 nm^-4 (Rayleigh), all per cm and taken
    for the epidermis, too; Prahl 1999 (haemoglobin at 630, 540, 450 nm).
    """
    dtype, device = home((melanin, blood, epidermis_mm))
    shares = {}
    for name, value in (("melanin", melanin), ("blood", blood), ("oxygen", oxygen)):
        shares[name] = as_map(f"skin.{name}", value, dtype, device)
        check_at_least_zero(f"skin.{name}", shares[name], "share")
        if float(shares[name].detach().max()) > 1:
            raise DomainError(f"skin: expected {name} in 0..1, got more; it is a share of the volume.")
    nm = torch.tensor(WAVELENGTHS, dtype=dtype, device=device)
    melanosomes = 6.6e10 * nm**-3.33
    bloodless = 0.0244 + 8.53 * torch.exp(-(nm - 154) / 66.2)
    scattering = 2e4 * nm**-1.5 + 2e11 * nm**-4.0
    oxygenated, deoxygenated = (
        _WHOLE_BLOOD * torch.tensor(x, dtype=dtype, device=device) for x in (_OXYGENATED, _DEOXYGENATED)
    )
    haemoglobin = oxygen * oxygenated + (1 - oxygen) * deoxygenated
    epidermis = torch.lerp(*_alike(bloodless, melanosomes, shares["melanin"]))
    dermis = torch.lerp(*_alike(bloodless, haemoglobin, shares["blood"]))
    return Stack(
        [
            Layer(Medium(epidermis, scattering, 0.0, eta), epidermis_mm),
            Layer(Medium(dermis, scattering, 0.0, eta)),
        ]
    )


def _alike(*tensors: Tensor) -> list[Tensor]:
    return list(torch.broadcast_tensors(*tensors))
