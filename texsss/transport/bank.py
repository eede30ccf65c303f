"""The bank: one blurred copy of the lightmap per Gaussian, weighted per texel by the material."""

from collections.abc import Callable
from dataclasses import dataclass

import torch

from texsss.errors import DomainError, ShapeError
from texsss.profiles.weights import Weights, without_negative
from texsss.surface.points import TexelMaps
from texsss.transport.budget import affordable
from texsss.transport.operators import Operators, surface_operators
from texsss.transport.uv import diffuse_uv, is_grey
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks

RULES = ("exit", "entry", "geometric-mean")
BUDGET_BYTES = 6e9  # of memory for operators, unless told otherwise
CHUNK = 1 << 14  # texels weighted at once: temporaries stay in cache
TINY = 1e-12  # added under roots, whose slope at 0 is infinite

Diffusion = Callable[[Float[Tensor, "P C"], Float[Tensor, " K"]], Float[Tensor, "K P C"]]
"""Values [any] at the texels and variances [mm²] to one blurred copy per variance."""


@dataclass(frozen=True, eq=False)
class Bank:
    """A lightmap convolved with K unit Gaussians on the surface.

    `variances` (K,) [mm²]; `irradiance` (P, C): the lightmap; `values` (K, P, C): its blurred copies [W/m²].
    Raises ShapeError: when there is not one copy per variance.
    """

    variances: Float[Tensor, " K"]
    irradiance: Float[Tensor, "P C"]
    values: Float[Tensor, "K P C"]

    def __post_init__(self):
        if self.variances.shape[0] != self.values.shape[0]:
            raise ShapeError(
                f"Bank: expected one blurred copy for each of {self.variances.shape[0]} variances, got "
                f"{self.values.shape[0]}; build it by build_bank."
            )


def no_diffusion(values: Float[Tensor, "P C"], variances: Float[Tensor, " K"]) -> Float[Tensor, "K P C"]:
    """`values` themselves for every variance, without a copy."""
    return values.expand(len(variances), *values.shape)


def diffusion(
    texels: TexelMaps,
    method: str = "uv",
    *,
    operators: Operators | None = None,
    budget_bytes: float | int = BUDGET_BYTES,
    notice: Callable[[str], None] | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Diffusion:
    """The function that convolves values at the texels with Gaussians, by name.

    `method`: none (every copy is the lightmap), uv, surface. The last applies `operators`, or builds those
    it is asked for, as many as `budget_bytes` allow; Gaussians without one are left to uv, and `notice`
    gets a sentence that says so.
    Raises DomainError: for another name.
    """
    if method == "none":
        return no_diffusion
    if method == "uv":
        return lambda values, variances: diffuse_uv(
            values, texels, variances, progress=progress, cancel=cancel
        )
    if method == "surface":

        def over_surface(values: Tensor, variances: Tensor) -> Tensor:
            built = operators
            if built is None:
                fits = affordable(texels, variances, budget_bytes)
                built = surface_operators(texels, variances[fits], progress=progress, cancel=cancel)
            place = {float(v): k for k, v in enumerate(built.variances.to(variances))}
            crosses = torch.tensor([float(v) in place for v in variances], dtype=torch.bool)
            built = built.only([place[float(v)] for v in variances if float(v) in place])
            if is_grey(values):
                copies = built.applied(values[:, :1]).expand(-1, -1, values.shape[1])
            else:
                copies = built.applied(values)
            if bool(crosses.all()):
                return copies
            if notice is not None:
                notice(narrow_stop(int((~crosses).sum()), len(variances), budget_bytes))
            along_uv = diffuse_uv(values, texels, variances[~crosses], progress=progress, cancel=cancel)
            both = torch.cat([copies, along_uv])
            order = torch.cat([crosses.nonzero()[:, 0], (~crosses).nonzero()[:, 0]])
            return both[torch.argsort(order)]

        return over_surface
    raise DomainError(f"diffusion: expected none, uv or surface, got {method!r}; choose one of them.")


def narrow_stop(stopped: int, count: int, budget_bytes: float | int) -> str:
    """The sentence for Gaussians that were left to uv."""
    return (
        f"{stopped} of {count} Gaussians stop at seams, as operators for all would not fit into "
        f"{budget_bytes / 1e9:.1f} GB; choose a smaller atlas."
    )


def build_bank(
    irradiance: Float[Tensor, "P C"],
    texels: TexelMaps,
    variances: Float[Tensor, " K"],
    *,
    method: str = "uv",
    operators: Operators | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Bank:
    """The bank of a lightmap.

    `irradiance` [W/m²]: at the texels, gutter included. `variances` [mm²]. `method` and `operators` as
    in `diffusion`.
    Differentiable in `irradiance`. Raises DomainError: for an unknown method; Cancelled.
    """
    blur = diffusion(texels, method, operators=operators, progress=progress, cancel=cancel)
    return Bank(variances, irradiance, blur(irradiance, variances))


def exitance(
    bank: Bank,
    weights: Weights,
    rule: str = "exit",
    *,
    blur: Diffusion | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "P C"]:
    """Exitance: the bank weighted per texel by the material [W/m²].

    `rule` says where the profile is taken. exit: Σ_k w_k(x) (G(v_k) * E)(x), where light leaves; a change
    of material costs no blur. entry: Σ_k G(v_k) * (w_k E), where it entered. geometric-mean:
    Σ_k √w_k G(v_k) * (√w_k E), which is reciprocal; it takes negative weights as 0 and scales the others
    to keep their sum. All are the same where the material is; the latter two blur K lightmaps with
    `blur` (of `diffusion`) unless the material is uniform.
    Differentiable in the bank and in the weights' table. Raises ShapeError: when weights and bank differ
    in Gaussians or texels; DomainError: for an unknown rule, or one that lacks `blur`; Cancelled.
    """
    if rule not in RULES:
        raise DomainError(f"exitance: expected a rule of {', '.join(RULES)}, got {rule!r}.")
    _check(weights, bank)
    table, row = weights.table, weights.row.long()
    if rule == "exit" or table.shape[0] == 1:
        return _weighted(bank.values, table, row)
    if blur is None:
        raise DomainError(
            f"exitance: the rule {rule!r} blurs per material, got no blur; pass diffusion(texels)."
        )
    if rule == "geometric-mean":
        table = (without_negative(table) + TINY).sqrt()
    total = torch.zeros_like(bank.irradiance)
    for k in range(len(bank.variances)):
        check_cancelled(cancel)
        weight = table[:, k][row]
        blurred = blur(weight * bank.irradiance, bank.variances[k : k + 1])[0]
        total = total + (blurred * weight if rule == "geometric-mean" else blurred)
    return total


def _weighted(
    values: Float[Tensor, "K P C"], table: Float[Tensor, "U K C"], row: Int[Tensor, " P"]
) -> Float[Tensor, "P C"]:
    """Σ_k table[row, k] × values[k], in chunks that stay in cache."""
    if table.shape[0] == 1 and values.stride(2) == 0:  # one material under white light: a product of matrices
        return values[..., 0].T @ table[0]
    parts = []
    shared = table.transpose(0, 1).expand(-1, CHUNK, -1).contiguous() if table.shape[0] == 1 else None
    for part in chunks(values.shape[1], CHUNK):
        if shared is not None:
            weight = shared[:, : part.stop - part.start]
        else:  # whole rows of the table are gathered, then laid out like the copies
            weight = table.index_select(0, row[part]).transpose(0, 1).contiguous()
        parts.append((weight * values[:, part]).sum(0))
    return torch.cat(parts) if parts else values.sum(0)


def _check(weights: Weights, bank: Bank) -> None:
    (copies, points), row = bank.values.shape[:2], weights.row
    if weights.table.shape[1] != copies or row.shape[0] != points:
        raise ShapeError(
            f"exitance: expected weights of {copies} Gaussians at {points} texels, got "
            f"{weights.table.shape[1]} at {row.shape[0]}; make both from one ladder and one atlas."
        )
