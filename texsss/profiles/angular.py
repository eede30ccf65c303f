"""How scattered light enters and leaves by its angle: not evenly, even where nothing refracts."""

import math
from dataclasses import dataclass

import torch

from texsss.media import fresnel
from texsss.media.stack import FAR_MM, Stack
from texsss.profiles.half_space import departure
from texsss.profiles.hankel import hankel_profiles
from texsss.types import Float, Tensor

ANGLES = 17  # that are solved, densest at grazing; straight lines between
LEAST = 1e-4  # of diffuse light that comes back, to be told by its angle


@dataclass(frozen=True, eq=False)
class Angular:
    """π × the BRDF of all but what is marched is e(μ) e(μ') R + b(μ) b(μ').

    `table` (M, C): e of light whose cosine is (m / (M - 1))², per that of diffuse light. `beside` (M, C): b,
    of light that leaves where it entered; None where it is not known, or nothing. `free` (C,) [mm]: how deep
    light goes on average before it scatters, straight down.
    """

    table: Float[Tensor, "M C"]
    free: Float[Tensor, " C"]
    beside: Float[Tensor, "M C"] | None = None

    def at(self, cosine: Float[Tensor, " P"]) -> Float[Tensor, "P C"]:
        """The share e at each cosine outside."""
        return _between(self.table, cosine)

    def beside_at(self, cosine: Float[Tensor, " P"]) -> Float[Tensor, "P C"]:
        """b at each cosine outside; of light that enters, and of light that leaves."""
        assert self.beside is not None, "asked for where it is known"
        return _between(self.beside, cosine)


def _between(table: Float[Tensor, "M C"], cosine: Float[Tensor, " P"]) -> Float[Tensor, "P C"]:
    """Values of a table at cosines."""
    place = cosine.clamp(0, 1).sqrt() * (len(table) - 1)
    low = place.detach().floor().clamp_max(len(table) - 2)
    table, row = table.to(cosine), low.long()
    return torch.lerp(table[row], table[row + 1], (place - low)[:, None])


def angular(stack: Stack, *, model: str = "layered-sp3", scattering: str = "unmarched") -> Angular:
    """How much of the light of an angle comes back, per that of diffuse light; stacks without maps alone.

    By reciprocity it leaves alike: a half-space sends out e(μ) e(μ') R / π, which keeps energy, and is
    within 4.5 % (RMS) of Chandrasekhar's H(μ) H(μ') where all light leaving evenly is 12 % off, of skin in
    blue. What is left is light of few scatterings, which leaves near where it entered and minds both
    directions at once: `beside` is that of a half-space that scatters alike in all directions and sends
    back as much, and brings it within 1 %. Where light refracts, directions within are too steep for it to
    matter, and it is left out.
    Raises as `hankel_profiles`.
    """
    zero = torch.zeros(1, dtype=torch.float64)
    cosine = torch.linspace(0, 1, ANGLES, dtype=torch.float64) ** 2
    angle = [min(math.acos(float(c)), math.pi / 2) for c in cosine]
    options = {"model": model, "scattering": scattering}
    back = torch.stack([hankel_profiles(stack, zero, incidence=a, **options)[0].reshape(-1) for a in angle])
    enters = (cosine * fresnel.transmittance(cosine, stack.eta))[:, None]
    mean = torch.trapezoid(back * enters, cosine, dim=0) / torch.trapezoid(enters, cosine, dim=0)
    some = mean.abs() > 1e-12
    table = torch.where(some, back / torch.where(some, mean, 1), 1.0).float()
    free = mean_depth(stack).float()
    if stack.eta != 1:
        return Angular(table, free)
    beside = [departure(float(r), cosine) if r > LEAST else torch.zeros_like(cosine) for r in mean]
    return Angular(table, free, torch.stack(beside, -1).float())


def mean_depth(stack: Stack) -> Float[Tensor, " C"]:
    """How deep light that enters straight goes on average before it scatters, ∫ e^-τ dz [mm], by σt'."""
    table = stack.table()
    sigma_a, sigma_s, g, thickness = (x.double() for x in table.fields)
    extinction = (sigma_a + sigma_s * (1 - g)).clamp_min(1e-9)
    through = extinction * thickness.clamp_max(FAR_MM)
    before = through.cumsum(-2) - through
    return (torch.exp(-before) * -torch.expm1(-through) / extinction).sum(-2).reshape(-1)
