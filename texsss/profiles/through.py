"""Light through thin parts: the stack as thick as the object is, and its two profiles."""

from dataclasses import replace

import torch

from texsss.media.stack import FAR_MM, LayerTable, Stack
from texsss.profiles.incidence import Incidence
from texsss.profiles.weights import Weights, weights_for, without_negative
from texsss.types import Cancel, Float, Progress, Tensor

STEP = 0.005  # of thickness, relative: half of it moves what passes by less than a step of 8 bits
COARSE_STEP = 0.03  # where the layers vary, too
THINNEST_MM = 1e-4
FADES_AT = (2.0, 4.0)  # own thicknesses of a finite stack between which the far side is lost from sight
FADING = 64  # steps of what is lost from sight
STEEPEST = 2.0  # d²/2v of a Gaussian of the straight distance: two deviations


def weights_through(
    stack: Stack,
    variances: Float[Tensor, " K"],
    thickness: Float[Tensor, " P"],
    *,
    points_uv: Float[Tensor, "P 2"] | None = None,
    model: str = "layered-sp3",
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    compiled: bool = False,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> tuple[Weights, Weights]:
    """Weights of what comes back, and of what comes out on the far side of an object of `thickness` [mm].

    A stack without a bottom is cut in the middle of the object and mirrored: the far side has the same
    layers. One with a bottom is taken as it is; it passes light to a far side within twice its own
    thickness, and none beyond four times. Where `thickness` is infinite nothing passes. `scattering` is
    of what comes back; what passes is the total. The march ends with the object, too, but knows nothing of
    the far side's upper layers: `unmarched` holds what these scatter once. Both are sums of Gaussians of the
    distance along the surface. `points_uv` (P, 2) where the stack varies. Not differentiable in `thickness`.
    Raises as `weights_for`.
    """
    varies = stack.varies and points_uv is not None
    single = torch.float32
    table = stack.at(points_uv, single) if varies and points_uv is not None else stack.table(single)
    rounded = _rounded(thickness, COARSE_STEP if varies else STEP)
    own_side = table
    if table.bottomless:
        table = mirrored(table, rounded)
        share = None
    else:
        own = table.thickness.sum(-2).amin(-1).expand(len(thickness))
        low, high = FADES_AT
        share = ((high - thickness / own.clamp_min(THINNEST_MM)) / (high - low)).clamp(0, 1)
    options = {"model": model, "incidence": incidence, "levels": None, "points": len(thickness)}
    options["compiled"] = compiled
    hooks = {"progress": progress, "cancel": cancel}
    if scattering == "unmarched" and len(stack.layers) > 1 and share is None:
        # what is marched are the layers of this side alone
        ends = ended(own_side, rounded)
        back = weights_for(table, variances, side="reflectance", scattering="total", **options, **hooks)
        for kind, sign in (("unmarched", 1.0), ("total", -1.0)):
            here = weights_for(ends, variances, side="reflectance", scattering=kind, **options, cancel=cancel)
            back = back.plus(here, sign)
    else:
        back = weights_for(table, variances, side="reflectance", scattering=scattering, **options, **hooks)
    passed = weights_for(table, variances, side="transmittance", **options, cancel=cancel)
    if share is None:
        return back, passed
    levels = torch.linspace(0, 1, FADING + 1)[:, None]
    return back, passed.scaled(levels, torch.round(share * FADING).long())


def mirrored(table: LayerTable, thickness: Float[Tensor, " P"]) -> LayerTable:
    """The layers of an object of `thickness` [mm], from one side to the other; batch (P,).

    `table`: of a stack without a bottom, batch () or (P,). Upper layers end in the middle at most.
    """
    *fields, own = (x.expand(len(thickness), *x.shape[-2:]) for x in table.fields)
    upper, left = _room(own, thickness / 2)
    depths = torch.stack([*upper, 2 * left, *reversed(upper)], 1)
    order = [*range(len(upper) + 1), *reversed(range(len(upper)))]
    eta = tuple(table.eta[i] for i in order)
    return replace(table.of([*(x[:, order] for x in fields), depths]), eta=eta, bottomless=False)


def ended(table: LayerTable, thickness: Float[Tensor, " P"]) -> LayerTable:
    """The layers of one side down to the end of an object of `thickness` [mm]; batch (P,).

    `table`: of a stack without a bottom, batch () or (P,).
    """
    *fields, own = (x.expand(len(thickness), *x.shape[-2:]) for x in table.fields)
    upper, left = _room(own, thickness)
    return replace(table.of([*fields, torch.stack([*upper, left], 1)]), bottomless=False)


def _room(
    own: Float[Tensor, "P L C"], thickness: Float[Tensor, " P"]
) -> tuple[list[Float[Tensor, "P C"]], Float[Tensor, "P C"]]:
    """How thick all layers but the last are within `thickness` [mm], and what that leaves to the last."""
    upper, left = [], thickness[:, None].to(own).expand_as(own[:, 0])
    for depth in own[:, :-1].unbind(1):
        upper.append(torch.minimum(depth, left))
        left = left - upper[-1]
    return upper, left


def straight(passed: Weights, thickness: Float[Tensor, " P"], finest_mm: float | int = 0.0) -> Weights:
    """`passed` as sums of Gaussians of the straight distance between the two sides, `thickness` [mm] apart.

    A Gaussian of the straight distance is e^(-d²/2v) times that of the distance along the surface, so its
    weight grows by the inverse; those whose d is beyond two deviations leave their share to the
    narrowest within, and none is negative: far sides nearer than d must not be flooded. So do those whose
    deviation is below `finest_mm`, if the light is not known as finely. The total is kept, unless the object
    is thicker than two deviations of the widest.
    """
    count = len(passed.table)
    # rows are of one thickness each, but for the rounding
    rows = thickness.new_full((count,), torch.inf)
    rows = rows.scatter_reduce(0, passed.row.long(), thickness, "amin").clamp(THINNEST_MM, FAR_MM)
    variances, order = passed.variances.to(rows).sort()
    exponent = rows[:, None] ** 2 / (2 * variances.clamp_min(1e-30))  # (U, K), falling
    number = torch.arange(len(order))
    unfit = (exponent > STEEPEST) | (variances.sqrt() < finest_mm)
    first = unfit.sum(1, keepdim=True).clamp_max(len(order) - 1)
    heir = torch.maximum(number, first)
    weight = without_negative(passed.table)[:, order]
    taken = torch.zeros_like(weight).scatter_add(1, heir[:, :, None].expand_as(weight), weight)
    grown = taken * torch.exp(exponent.clamp_max(STEEPEST))[:, :, None].to(taken)
    return replace(passed, table=grown[:, torch.argsort(order)])


def _rounded(thickness: Float[Tensor, " P"], step: float) -> Float[Tensor, " P"]:
    """`thickness` in steps of a ratio, so that equal rows are many."""
    bounded = thickness.clamp(THINNEST_MM, FAR_MM)
    return torch.exp(torch.round(bounded.log() / step) * step).clamp(max=FAR_MM)
