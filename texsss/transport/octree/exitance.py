"""Scattered light by hierarchical integration: samples of irradiance, each with the profile of its place."""

from dataclasses import dataclass

import torch

from texsss.errors import DomainError
from texsss.profiles.weights import Weights, without_negative
from texsss.transport.bank import RULES
from texsss.transport.octree.integrate import integrated
from texsss.transport.octree.sources import Sources, sources
from texsss.types import Cancel, Float, Int, Progress, Tensor

RESOLVED = 1.0  # spacings of the samples; a narrower Gaussian is left to the light at the receiver itself
TINY = 1e-20
LEAST_FACING = 0.1  # of what a Gaussian reaches that must face as the receiver does, to be its whole


@dataclass(frozen=True, eq=False)
class Surface:
    """P points that send or receive light.

    `position` (P, 3) [mm]; `normal` (P, 3), unit; `irradiance` (P, 3) [W/m²]; `reflected`: the profile at
    each; `through`: that of light which comes out on the far side, as a sum of Gaussians of the straight
    distance, or None for light to be reflected alone, whichever way surfaces face.
    """

    position: Float[Tensor, "P 3"]
    normal: Float[Tensor, "P 3"]
    irradiance: Float[Tensor, "P 3"]
    reflected: Weights
    through: Weights | None = None


@dataclass(frozen=True, eq=False)
class Emission:
    """Light on its way out of a surface: the octree of what its samples send, see `emission`.

    `variances` (K,) [mm²] of the Gaussians that are summed; `chosen`, `narrow`: their numbers in the
    profiles, and those of the others. `power` of the sample's and the receiver's weight. Per Gaussian
    `sources` have columns: light (3), then, where `faces` count, light × normal (9); unless the receiver's
    profile alone counts, there is one such set for reflected light and one for the rest. Behind them, where
    sums are to be `normalised`, stands area (1), with normals area × normal (3), too.
    """

    sources: Sources | None
    variances: Float[Tensor, " K"]
    chosen: Int[Tensor, " K"]
    narrow: Int[Tensor, " N"]
    power: tuple[float, float]
    faces: bool
    normalised: bool

    def exitance(
        self,
        receivers: Surface,
        *,
        epsilon: float = 0.05,
        widened: bool = True,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
    ) -> Float[Tensor, "Q 3"]:
        """Exitance at the receivers [W/m²]: Σ_p D(‖x - p‖) E_p A_p, summed over the octree.

        D = ½ (1 + n_x·n_p) R + ½ (1 - n_x·n_p) T where both sides have `through`, else R. When sums are
        normalised, every Gaussian of R is divided by what it makes of E = 1. Gaussians too narrow for the
        samples weigh the irradiance at the receiver itself. `epsilon`, `widened`: see `integrated`. Not
        differentiable.
        Raises DomainError: for an epsilon not above 0, or when one side lacks `through`; Cancelled.
        Source: Mayorga 2008, section 4.3; d'Eon et al. 2007 for sums of Gaussians.
        """
        if (receivers.through is not None) is not self.faces:
            raise DomainError("octree: expected profiles of what passes on both sides or on none; add them.")
        own = receivers.reflected.table[:, self.narrow].sum(1)
        light = receivers.irradiance * own[receivers.reflected.row.long()]
        if self.sources is None:
            return light
        far = integrated(
            self.sources,
            receivers.position,
            self.variances,
            lambda rows, sums: self._received(receivers, rows, sums),
            epsilon=epsilon,
            widened=widened,
            progress=progress,
            cancel=cancel,
        )
        return light + far

    def _received(
        self, receivers: Surface, rows: Int[Tensor, " b"], sums: Float[Tensor, "K Q b"]
    ) -> Float[Tensor, "b 3"]:
        """Exitance of some receivers from the sums of the Gaussians."""
        reflected = _weights(receivers.reflected, self.chosen, rows, self.power[1])
        area = 0 if not self.normalised else 4 if self.faces else 1
        light, area = sums[:, : sums.shape[1] - area], sums[:, sums.shape[1] - area :]
        if not self.faces:
            if self.normalised:
                light = light / area.clamp_min(TINY)
            return (reflected * light.transpose(1, 2)).sum(0)
        assert receivers.through is not None, "faces are looked at when both sides have it"
        through = _weights(receivers.through, self.chosen, rows, self.power[1])
        normal = receivers.normal[rows]

        def along(moments: Tensor) -> Tensor:
            return torch.einsum("kcdb,bd->kcb", moments.unflatten(1, (-1, 3)), normal)

        back, passed = light.chunk(2, 1) if self.power[0] else (light, light)
        back, passed = back[:, :3] + along(back[:, 3:]), passed[:, :3] - along(passed[:, 3:])
        if self.normalised:
            facing = torch.maximum(area[:, :1] + along(area[:, 1:]), 2 * LEAST_FACING * area[:, :1])
            back = 2 * back / facing.clamp_min(TINY)
        return ((reflected * back.transpose(1, 2) + through * passed.transpose(1, 2)) / 2).sum(0)


def emission(
    samples: Surface,
    area: Float[Tensor, " P"],
    spacing_mm: float,
    *,
    rule: str = "entry",
    normalise: bool = True,
) -> Emission:
    """What samples send, each of `area` (P,) [mm²] and `spacing_mm` apart, in an octree.

    `rule`: whose profile counts, the receiver's (exit), the sample's (entry) or the root of both. Normals
    count when the samples have a profile of what passes. `normalise`: even light comes back as even light
    from folds, too, where the plain sum of the source sends more than entered.
    Raises DomainError: for another rule.
    """
    if rule not in RULES:
        raise DomainError(f"octree: expected a rule of {', '.join(RULES)}, got {rule!r}.")
    power = {"exit": (0.0, 1.0), "entry": (1.0, 0.0), "geometric-mean": (0.5, 0.5)}[rule]
    if len(samples.reflected.table) == 1 and samples.through is None:
        power = (0.0, 1.0)  # all rules are one; this one sends the least
    order = torch.argsort(samples.reflected.variances)
    variances = samples.reflected.variances[order]
    wide = variances.sqrt() >= RESOLVED * spacing_mm
    chosen = order[wide]
    sent = _sources(samples, area, chosen, power[0], normalise) if len(chosen) else None
    faces = samples.through is not None
    return Emission(sent, variances[wide], chosen, order[~wide], power, faces, normalise)


def _sources(
    samples: Surface, area: Float[Tensor, " P"], chosen: Int[Tensor, " K"], power: float, normalise: bool
) -> Sources:
    """The octree of what the samples send, their weights taken to a power."""
    light, normal = samples.irradiance * area[:, None], samples.normal
    back = light * _weights(samples.reflected, chosen, slice(None), power)
    if samples.through is None:
        sent = back
    else:
        passed = light * _weights(samples.through, chosen, slice(None), power)
        sent = _with_normals(back, normal)
        if power:
            sent = torch.cat([sent, _with_normals(passed, normal)], 2)
    if normalise:
        even = area[:, None]
        even = even if samples.through is None else torch.cat([even, even * normal], 1)
        sent = torch.cat([sent, even.expand(len(sent), -1, -1)], 2)
    return sources(samples.position, area, samples.irradiance.mean(1), sent)


def _with_normals(lit: Float[Tensor, "J P 3"], normal: Float[Tensor, "P 3"]) -> Float[Tensor, "J P 12"]:
    """Light, and light × normal."""
    return torch.cat([lit, (lit[..., :, None] * normal[:, None, :]).flatten(-2)], -1)


def _weights(
    weights: Weights, chosen: Int[Tensor, " K"], rows: slice | Tensor, power: float
) -> Float[Tensor, "_ _ _"]:
    """The chosen Gaussians' weights (K, P, 3) to a power, (1, 1, 1) to 0; its root is as in `bank`."""
    if power == 0.0:
        return weights.table.new_ones(1, 1, 1)
    table = weights.table
    if power == 0.5:
        table = without_negative(table).sqrt()
    return table[:, chosen][weights.row[rows].long()].transpose(0, 1)
