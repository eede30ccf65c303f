"""The part of the march that depends on rays and light alone: lights, gathered down every ray."""

from typing import Literal

import torch

from texsss.numerics.threads import in_threads
from texsss.transport.march.fused import Fused
from texsss.transport.march.interior import Interior
from texsss.transport.march.kernel import framed, look_up, meet, place
from texsss.transport.march.samples import layer_of, sample
from texsss.transport.march.segments import along, gather, passage, pieces, tail
from texsss.transport.march.setup import Reach, bounded, knots, reach
from texsss.types import Float, Tensor, chunks

BLOCK = 1 << 16  # points a thread takes at a time: fewer, and calls cost more than what they compute

Method = Literal["exact", "uniform"]
Phase = Literal["henyey-greenstein", "schlick"]


class Gatherer:
    """Marches rays through one interior; `compiled`: by the compiled loop, where there can be one."""

    def __init__(self, interior: Interior, method: Method, samples: int, phase: Phase, compiled: bool):
        interior = bounded(interior)
        self.interior, self.method, self.samples, self.phase = interior, method, samples, phase
        self.far: Reach = reach(interior, across=method == "exact")
        self.size: tuple[int, int] = (interior.depth.shape[0], interior.depth.shape[1])
        self.channels: int = interior.sigma_t.shape[-1]
        fused = Fused(interior, phase) if compiled else None
        self._fused = fused if fused is not None and fused.ready else None
        if self._fused is not None:
            return
        self._depth = list(framed(interior.depth).flatten(1))
        g = interior.g
        # one value for all channels is looked at once; equal ones have gradients of their own
        alike = not g.requires_grad and bool((g == g[..., :1]).all())
        fields = [interior.sigma_s, interior.sigma_t, g[..., :1] if alike else g]
        self._fields = [x if x.ndim == 2 else list(framed(x.flatten(2)).flatten(1)) for x in fields]
        self._shapes = [x.shape[-2:] for x in fields]

    def __call__(
        self,
        ray: Float[Tensor, "11 P"],
        lights: Float[Tensor, "N 11 P"],
        jitter: Float[Tensor, " P"] | None = None,
    ) -> Float[Tensor, "P 3"]:
        """Radiance inside, towards the eye [W/(m² sr)], of all lights.

        `ray`, `lights`: from `view_rays` and `light_scalars`; `jitter` shifts uniform samples, in steps.
        """
        if self._fused is not None:
            return self._fused(ray, lights, jitter, self.method, self.samples, self.far.rate)
        if torch.is_grad_enabled() and (ray.requires_grad or lights.requires_grad or self._differentiable):
            return self._block(ray, lights, jitter)

        def block(row: slice) -> Tensor:
            shift = None if jitter is None else jitter[row]
            return self._block(ray[:, row].contiguous(), lights[..., row].contiguous(), shift)

        return torch.cat(in_threads(block, chunks(ray.shape[1], BLOCK)))

    @property
    def _differentiable(self) -> bool:
        return self.interior.requires_grad

    def _block(self, ray: Tensor, lights: Tensor, jitter: Tensor | None) -> Float[Tensor, "P 3"]:
        method = self._exact if self.method == "exact" else self._uniform
        totals = method(ray, lights, jitter)
        return sum(
            (torch.stack(total, -1) * light[8:].T for total, light in zip(totals, lights)),
            start=ray.new_zeros(ray.shape[1], 3),
        )

    def _exact(self, ray: Tensor, lights: Tensor, _: Tensor | None) -> list[list[Tensor]]:
        channels = range(self.channels)
        passed = [torch.zeros_like(ray[0])] * self.channels
        totals = [passed] * len(lights)
        steps = knots(ray[4], self.samples, self.far.rate) * ray[4]
        spot = self._place(ray, steps[0])
        before = self._coefficients(spot)
        starts = [self._meet(ray, light, spot, before) for light in lights]
        for k in range(self.samples):
            next_spot = self._place(ray, steps[k + 1])
            after = self._coefficients(next_spot)
            stretch, rising, at = pieces(
                ray[6], steps[k], steps[k + 1], spot[-1], next_spot[-1], self.interior.layers
            )
            scattering, extinction = (a if a is b else 0.5 * (a + b) for a, b in zip(before[:2], after[:2]))
            passages = [passage(extinction[:, c], stretch, rising) for c in channels]
            view = [[passed[c] + d for d in passages[c][0]] for c in channels]
            ends = [self._meet(ray, light, next_spot, after) for light in lights]
            for n, (start, end) in enumerate(zip(starts, ends)):
                way, within, share = along(at, start, end, stretch)
                totals[n] = [
                    gather(
                        scattering[:, c],
                        extinction[:, c],
                        view[c],
                        way,
                        within,
                        [s[min(c, len(s) - 1)] for s in share],
                        totals[n][c],
                    )
                    for c in channels
                ]
            passed = [passed[c] + passages[c][1] for c in channels]
            starts, before, spot = ends, after, next_spot
        if self.interior.bottomless:
            totals = [self._beyond(ray, e, before, passed, t) for e, t in zip(starts, totals)]
        return totals

    def _uniform(self, ray: Tensor, lights: Tensor, jitter: Tensor | None) -> list[list[Tensor]]:
        passed = [torch.zeros_like(ray[0])] * self.channels
        totals = [passed] * len(lights)
        step = ray[4] / self.samples
        for k in range(self.samples):
            t = step * k if jitter is None else (step * (k + jitter)).clamp_min(0)
            spot = self._place(ray, t)
            known = self._coefficients(spot)
            gain, here = layer_of(known[0], known[1], t * ray[6], spot[-1])
            totals = [
                sample(gain, known[1], step, self._meet(ray, light, spot, known), passed, total)
                for light, total in zip(lights, totals)
            ]
            passed = [p + h * step for p, h in zip(passed, here)]
        if self.interior.bottomless:
            spot = self._place(ray, ray[4])
            known = self._coefficients(spot)
            totals = [
                self._beyond(ray, self._meet(ray, light, spot, known), known, passed, total)
                for light, total in zip(lights, totals)
            ]
        return totals

    def _beyond(self, ray: Tensor, end, known: list[Tensor], passed: list[Tensor], total: list[Tensor]):
        share = end[3][-1]
        return [
            tail(
                known[0][:, c],
                known[1][:, c],
                ray[6],
                end,
                share[min(c, len(share) - 1)] * ray[10],
                passed[c],
                total[c],
            )
            for c in range(self.channels)
        ]

    def _place(self, ray: Tensor, t: Tensor):
        return place(ray, self._depth, self.size, t)

    def _meet(self, ray: Tensor, light: Tensor, spot, known: list[Tensor]):
        return meet(ray, light, spot, self._depth, self.size, known[2], self.phase)

    def _coefficients(self, spot) -> list[Tensor]:
        """σs, σt and g, (L, C) or, where they are maps, (L, C, P) under M."""
        found = []
        for field, shape in zip(self._fields, self._shapes):
            if isinstance(field, list):
                values = look_up(field, self.size, spot[5], spot[6])
                found.append(torch.stack(values).reshape(*shape, -1))
            else:
                found.append(field)
        return found
