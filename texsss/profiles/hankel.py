"""Reflectance and transmittance of stacks in Hankel space, by any model: one function for all."""

from typing import Any

import torch

from texsss.errors import DomainError, ShapeError
from texsss.media.medium import Medium, told
from texsss.media.phase import PHASES
from texsss.media.stack import Layer, LayerTable, Stack
from texsss.profiles import layered_diffusion, layered_sp3
from texsss.profiles.blocks import Loops
from texsss.profiles.dipole import dipole_hankel
from texsss.profiles.incidence import Incidence, incidence_directions, mean_direction
from texsss.profiles.multipole import better_dipole, stacked
from texsss.profiles.slab import Directions
from texsss.types import Float, Int, Tensor

HARDLY = 1e-4  # of the scattering, at which an absorption of 0 is differentiated
MODELS = ("dipole", "better-dipole", "multipole", "layered-diffusion", "layered-sp3")
SCATTERINGS = ("total", "single", "multiple", "unmarched")
SIDES = ("reflectance", "transmittance")
Material = Stack | Layer | Medium | LayerTable


def hankel_profiles(
    material: Material,
    s: Float[Tensor, " S"] | Int[Tensor, " S"],
    *,
    model: str = "layered-sp3",
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    phase: str = "henyey-greenstein",
) -> tuple[Float[Tensor, "*B S C"], Float[Tensor, "*B S C"]]:
    """R̂(s) and T̂(s) of scattered light, per unit of light that entered; `ballistic` is the rest.

    R⁻ and T⁻, of light from below, are those of the stack `upside_down`.

    `s` [1/mm] decides dtype and device; whole numbers count as float64. `material`: a stack, layer, medium,
    or the rows of a table. `incidence`: diffuse, normal or an angle outside [rad]. `scattering`: total,
    single or multiple; the single part of R has the true coefficients and `phase` (isotropic, henyey-
    greenstein, schlick), all the rest reduced ones, so that T counts light that is hardly deflected as part
    of the beam. `unmarched` is the total less what `march` adds to R, which no bottom mirrors and no index
    within refracts. dipole, better-dipole: the first layer as a half-space; those and multipole put the
    source at one depth, whatever the incidence; layered-diffusion lets diffuse light in at its mean cosine.
    Differentiable in coefficients, thickness and `s`, also where they are 0; where R̂(0) of a white half-space
    has -∞ by sigma_a, a finite number comes, some -4e12.
    Raises DomainError: for unknown names; the choices are listed; for frequencies that are none, negative or
    not finite; ShapeError: unless they are (S,).
    """
    s = real_frequencies("hankel_profiles", s)
    table = as_table(material, s.dtype).to(device=s.device)
    options = {"model": model, "scattering": scattering, "incidence": incidence, "phase": phase}
    reflected = flat_profile(table, s, side="reflectance", **options)
    transmitted = flat_profile(table, s, side="transmittance", **options)
    return unflattened(reflected, table), unflattened(transmitted, table)


def real_frequencies(name: str, s: Float[Tensor, " S"] | Int[Tensor, " S"]) -> Float[Tensor, " S"]:
    """`s` [1/mm] as given to `name`, whole numbers as float64. Raises DomainError or ShapeError."""
    try:
        s = torch.as_tensor(s)
        if s.is_complex():
            raise TypeError("real numbers are meant")
    except (TypeError, ValueError, RuntimeError) as e:
        raise DomainError(
            f"{name}: expected a tensor of real frequencies (S,) [1/mm], got {told(s)}; pass one."
        ) from e
    if s.ndim != 1 or not len(s):
        raise ShapeError(
            f"{name}: expected one frequency or more (S,), got shape {tuple(s.shape)}; reshape it."
        )
    s = s if s.dtype.is_floating_point else s.to(torch.float64)
    least, most = (float(x) for x in s.detach().aminmax())
    if not (least >= 0 and most < float("inf")):
        raise DomainError(
            f"{name}: expected finite frequencies s >= 0 [1/mm], got {least:g}..{most:g}; profiles "
            "are round, so pass magnitudes."
        )
    return s


def as_table(material: Material, dtype: torch.dtype | None = None) -> LayerTable:
    """The rows that a material stands for."""
    if isinstance(material, LayerTable):
        return material.to(dtype)
    return (material if isinstance(material, Stack) else Stack(material)).table(dtype)


def flat_profile(
    table: LayerTable,
    s: Float[Tensor, " S"],
    *,
    side: str,
    model: str,
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    phase: str = "henyey-greenstein",
    loops: Loops | None = None,
) -> Float[Tensor, "S N"]:
    """R̂(s) or T̂(s), by `side`, of all channels and rows, flattened to N in this order.

    `loops`: for layered models of many float32 rows without gradients, at the same `s` each time.
    """
    choose("model", model, MODELS)
    choose("scattering", scattering, SCATTERINGS)
    choose("side", side, SIDES)
    choose("phase", phase, PHASES)
    directions = incidence_directions(incidence, table.eta[0])
    if model == "layered-sp3":
        options = {"side": side, "scattering": scattering, "phase": phase, "loops": loops}
        return layered_sp3.profile(table, s, directions, **options)
    if model == "better-dipole":
        return _better_dipole(table, s, side, scattering, directions, phase)
    if scattering != "total":
        raise DomainError(f"scattering: {model} knows only the total, got {scattering!r}; use layered-sp3.")
    if model == "dipole":
        R = dipole_hankel(table, s)
        return R if side == "reflectance" else torch.zeros_like(R)
    if model == "multipole":
        slab = stacked(table, s)
        return slab.R_plus if side == "reflectance" else slab.T_plus
    mean = mean_direction(incidence, table.eta[0])
    return layered_diffusion.profile(table, s, mean, side=side, loops=loops)


def tame_profile(table: LayerTable, s: Float[Tensor, " S"], **options: Any) -> Float[Tensor, "S N"]:
    """`flat_profile`, whose derivatives are of use where nothing at all is absorbed endlessly deep.

    R̂(0) of a half-space has -∞ by a sigma_a of exactly 0; what comes instead is the derivative where it is
    HARDLY of the scattering, and 0 where nothing scatters, at all frequencies. Values and other derivatives
    are as they are.
    """
    deepest = table.sigma_a[..., -1:, :]
    if not (table.sigma_a.requires_grad and table.bottomless and bool((deepest == 0).any())):
        return flat_profile(table, s, **options)
    above, scattering = table.sigma_a[..., :-1, :], (table.sigma_s * (1 - table.g))[..., -1:, :].detach()
    known = torch.cat([above, torch.where(deepest == 0, 0, deepest)], -2)
    exact = flat_profile(table.of([known, *table.fields[1:]]), s, **options)
    white = (deepest == 0) & (scattering > 0)
    darker = torch.where(white, deepest + HARDLY * scattering, deepest.detach())
    others = [field.detach() for field in table.fields[1:]]
    beside = flat_profile(table.of([torch.cat([above.detach(), darker], -2), *others]), s, **options)
    return exact + (beside - beside.detach())


def _better_dipole(
    table: LayerTable,
    s: Float[Tensor, " S"],
    side: str,
    scattering: str,
    directions: Directions,
    phase: str,
) -> Float[Tensor, "S N"]:
    once = layered_sp3.profile(
        table.first, s, directions, side="reflectance", scattering="single", phase=phase
    )
    more = better_dipole(table, s)
    # a half-space of one index: the march sees all that scatters once
    R = {"single": once, "multiple": more, "unmarched": more, "total": once + more}[scattering]
    return R if side == "reflectance" else torch.zeros_like(R)


def choose(what: str, name: str, choices: tuple[str, ...]) -> None:
    """Raises DomainError, listing the choices, unless `name` is one of them."""
    if name not in choices:
        raise DomainError(f"{what}: expected one of {', '.join(choices)}, got {name!r}.")


def unflattened(flat: Float[Tensor, "S N"], table: LayerTable) -> Float[Tensor, "*B S C"]:
    """A flat profile in the shape of the table's batch."""
    return flat.reshape(-1, table.channels, *table.batch).movedim((1, 0), (-1, -2))
