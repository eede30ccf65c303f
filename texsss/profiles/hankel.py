"""Reflectance and transmittance of stacks in Hankel space, by any model: one function for all."""

from dataclasses import replace

import torch

from texsss.errors import DomainError
from texsss.media.medium import Medium
from texsss.media.stack import Layer, LayerTable, Stack
from texsss.profiles import layered_diffusion, layered_sp3
from texsss.profiles.dipole import dipole_hankel
from texsss.profiles.incidence import Incidence, incidence_cosine
from texsss.profiles.multipole import better_dipole, stacked
from texsss.profiles.single import single
from texsss.types import Float, Tensor

MODELS = ("dipole", "better-dipole", "multipole", "layered-diffusion", "layered-sp3")
SCATTERINGS = ("total", "single", "multiple")
SIDES = ("reflectance", "transmittance")
Material = Stack | Layer | Medium | LayerTable


def hankel_profiles(
    material: Material,
    s: Float[Tensor, " S"],
    *,
    model: str = "layered-sp3",
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    phase: str | None = None,
) -> tuple[Float[Tensor, "*B S C"], Float[Tensor, "*B S C"]]:
    """R̂(s) and T̂(s) of scattered light, per unit of light that entered.

    `s` [1/mm] decides dtype and device. `material`: a stack, layer, medium, or the rows of a table.
    `incidence`: diffuse, normal or an angle outside [rad]. `scattering`: total, single or multiple;
    the split depends on `phase`: None takes the reduced coefficients as isotropic, a name the true ones,
    and the total stays as it is. dipole, better-dipole: the first layer as a half-space; those and
    multipole put the source at one depth, whatever the incidence. Differentiable in coefficients,
    thickness and `s`. Raises DomainError: for unknown names; the choices are listed.
    """
    table = as_table(material).to(s.dtype, s.device)
    options = {"model": model, "scattering": scattering, "incidence": incidence, "phase": phase}
    reflected = flat_profile(table, s, side="reflectance", **options)
    transmitted = flat_profile(table, s, side="transmittance", **options)
    return unflattened(reflected, table), unflattened(transmitted, table)


def as_table(material: Material) -> LayerTable:
    """The rows that a material stands for."""
    if isinstance(material, LayerTable):
        return material
    return (material if isinstance(material, Stack) else Stack(material)).table()


def flat_profile(
    table: LayerTable,
    s: Float[Tensor, " S"],
    *,
    side: str,
    model: str,
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    phase: str | None = None,
) -> Float[Tensor, "S N"]:
    """R̂(s) or T̂(s), by `side`, of all rows and channels flattened to N, as they are computed."""
    choose("model", model, MODELS)
    choose("scattering", scattering, SCATTERINGS)
    choose("side", side, SIDES)
    cosine = incidence_cosine(incidence, table.eta[0])
    if model == "layered-sp3":
        return _layered_sp3(table, s, side, scattering, cosine, phase)
    if model == "better-dipole":
        return _better_dipole(table, s, side, scattering, cosine, phase)
    if scattering != "total":
        raise DomainError(f"scattering: {model} knows only the total, got {scattering!r}; use layered-sp3.")
    if model == "dipole":
        R = dipole_hankel(table, s)
        return R if side == "reflectance" else torch.zeros_like(R)
    if model == "multipole":
        slab = stacked(table, s)
        return slab.R_plus if side == "reflectance" else slab.T_plus
    solve = layered_diffusion.reflectance if side == "reflectance" else layered_diffusion.transmittance
    return solve(table, s, cosine)


def _better_dipole(
    table: LayerTable, s: Float[Tensor, " S"], side: str, scattering: str, cosine: float, phase: str | None
) -> Float[Tensor, "S N"]:
    first = table.of([x[..., :1, :] for x in table.fields])
    first = replace(first, eta=table.eta[:1], bottomless=True)
    once, more = single(first, s, cosine, "reflectance", phase), better_dipole(table, s)
    R = {"single": once, "multiple": more, "total": once + more}[scattering]
    return R if side == "reflectance" else torch.zeros_like(R)


def _layered_sp3(
    table: LayerTable, s: Float[Tensor, " S"], side: str, scattering: str, cosine: float, phase: str | None
) -> Float[Tensor, "S N"]:
    if scattering == "single":
        return single(table, s, cosine, side, phase)
    rest = layered_sp3.multiple(table, s, cosine, side)
    if scattering == "multiple" and phase is None:
        return rest
    total = rest + single(table, s, cosine, side)
    # the multiple part takes up what the reduced, isotropic single scattering had counted
    return total if scattering == "total" else total - single(table, s, cosine, side, phase)


def choose(what: str, name: str, choices: tuple[str, ...]) -> None:
    """Raises DomainError, listing the choices, unless `name` is one of them."""
    if name not in choices:
        raise DomainError(f"{what}: expected one of {', '.join(choices)}, got {name!r}.")


def unflattened(flat: Float[Tensor, "S N"], table: LayerTable) -> Float[Tensor, "*B S C"]:
    """A flat profile in the shape of the table's batch."""
    return flat.reshape(-1, *table.batch, table.channels).movedim(0, -2)
