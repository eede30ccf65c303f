"""Scattered light by hierarchical integration: samples of irradiance, each with the profile of its place."""

from dataclasses import dataclass

import torch

from texsss.errors import DomainError
from texsss.profiles.weights import Weights
from texsss.transport.octree.integrate import integrated
from texsss.transport.octree.sources import Sources, sources
from texsss.types import Cancel, Float, Int, Progress, Tensor

RESOLVED = 1.0  # spacings of the samples; a narrower Gaussian is left to the light at the receiver itself
RULES = ("exit", "entry", "geometric-mean")


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


def hierarchical_exitance(
    samples: Surface,
    area: Float[Tensor, " P"],
    receivers: Surface,
    spacing_mm: float,
    *,
    rule: str = "entry",
    epsilon: float = 0.05,
    widened: bool = True,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Float[Tensor, "Q 3"]:
    """Exitance at the receivers [W/m²]: Σ_p D(‖x - p‖) E_p A_p, summed over an octree.

    D = ½ (1 + n_x·n_p) R + ½ (1 - n_x·n_p) T where both sides have `through`, else R. `area` [mm²]: of the
    samples, which lie `spacing_mm` apart; Gaussians too narrow for them weigh the irradiance at the
    receiver itself. `rule`: whose profile counts, the receiver's (exit), the sample's (entry) or the
    root of both. Not differentiable.
    Raises DomainError: for another rule, or an epsilon not above 0; Cancelled.
    Source: Mayorga 2008, section 4.3, eq. for M_o; d'Eon et al. 2007 for sums of Gaussians.
    """
    if rule not in RULES:
        raise DomainError(f"octree: expected a rule of {', '.join(RULES)}, got {rule!r}.")
    order = torch.argsort(receivers.reflected.variances)
    variances = receivers.reflected.variances[order]
    wide = variances.sqrt() >= RESOLVED * spacing_mm
    own = receivers.reflected.table[:, order[~wide]].sum(1)
    light = receivers.irradiance * own[receivers.reflected.row.long()]
    chosen = order[wide]
    if not len(chosen):
        return light
    pair = _Pair(samples, receivers, chosen, rule)
    far = integrated(
        pair.sent(area),
        receivers.position,
        variances[wide],
        pair.received,
        epsilon=epsilon,
        widened=widened,
        progress=progress,
        cancel=cancel,
    )
    return light + far


class _Pair:
    """Senders and receivers with the Gaussians `chosen` of their profiles, by a rule.

    Per Gaussian the sum over senders has columns: light (3), then, where normals count, light × normal
    (9); with the root of both profiles there is one such set for reflected light and one for the rest.
    """

    def __init__(self, samples: Surface, receivers: Surface, chosen: Int[Tensor, " K"], rule: str):
        self.samples, self.receivers, self.chosen = samples, receivers, chosen
        self.faces = samples.through is not None and receivers.through is not None
        self.power = {"exit": (0.0, 1.0), "entry": (1.0, 0.0), "geometric-mean": (0.5, 0.5)}[rule]
        if len(samples.reflected.table) == 1 and not self.faces:
            self.power = (0.0, 1.0)  # all rules are one; this one sends the least
        self.sets = 2 if self.faces and self.power[0] == 0.5 else 1

    def sent(self, area: Float[Tensor, " P"]) -> Sources:
        """The octree of what the samples send."""
        light = self.samples.irradiance * area[:, None]
        reflected = self._weights(self.samples.reflected, slice(None), self.power[0])
        columns = [self._columns(light, reflected, None)]
        if self.faces:
            assert self.samples.through is not None, "faces are looked at when both sides have it"
            through = self._weights(self.samples.through, slice(None), self.power[0])
            if self.power[0] == 0.5:
                columns = [self._columns(light, reflected, 1.0), self._columns(light, through, -1.0)]
            elif self.power[0] == 1.0:
                columns = [self._columns(light, reflected, 1.0) + self._columns(light, through, -1.0)]
            else:
                columns = [self._columns(light, reflected, 1.0)]
        flux = self.samples.irradiance.mean(1)
        return sources(self.samples.position, area, flux, torch.cat(columns, 2))

    def received(self, rows: Int[Tensor, " b"], sums: Float[Tensor, "K Q b"]) -> Float[Tensor, "b 3"]:
        """Exitance of receivers from the sums of the Gaussians."""
        reflected = self._weights(self.receivers.reflected, rows, self.power[1])
        if not self.faces:
            return (reflected * sums.transpose(1, 2)).sum(0)
        assert self.receivers.through is not None, "faces are looked at when both sides have it"
        through = self._weights(self.receivers.through, rows, self.power[1])
        normal = self.receivers.normal[rows]
        parts = [
            (part[:, :3], torch.einsum("kcdb,bd->kcb", part[:, 3:].unflatten(1, (3, 3)), normal))
            for part in sums.chunk(self.sets, 1)
        ]
        same = parts[0][0] + parts[0][1]
        if self.power[0] == 1.0:
            # both profiles are in the sums already, signs included
            return same.sum(0).T / 2
        other = parts[1][0] + parts[1][1] if self.sets == 2 else parts[0][0] - parts[0][1]
        return ((reflected * same.transpose(1, 2) + through * other.transpose(1, 2)) / 2).sum(0)

    def _weights(self, weights: Weights, rows: slice | Tensor, power: float) -> Float[Tensor, "_ _ _"]:
        """The chosen Gaussians' weights (K, P, 3) to a power, (1, 1, 1) to 0; its root is as in `bank`."""
        if power == 0.0:
            return weights.table.new_ones(1, 1, 1)
        table = weights.table
        if power == 0.5:
            positive = table.clamp_min(0)
            some = positive.sum(1, keepdim=True)
            share = table.sum(1, keepdim=True).clamp_min(0) / torch.where(some > 0, some, 1)
            table = (positive * share).sqrt()
        return table[:, self.chosen][weights.row[rows].long()].transpose(0, 1)

    def _columns(
        self, light: Float[Tensor, "P 3"], weight: Float[Tensor, "_ _ _"], side: float | None
    ) -> Float[Tensor, "J P Q"]:
        """What each sample sends: its light and, `side` times, that along its normal."""
        lit = light * weight
        if side is None:
            return lit
        along = side * lit[..., :, None] * self.samples.normal[:, None, :]
        return torch.cat([lit, along.flatten(-2)], -1)
