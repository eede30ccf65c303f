"""The part of the march that depends on rays and light alone: one light, gathered down every ray."""

from collections.abc import Callable
from typing import Any, Literal

import torch

from texsss.numerics.compiled import compiled
from texsss.transport.march.interior import Interior
from texsss.transport.march.kernel import look_up, meet
from texsss.transport.march.samples import sample
from texsss.transport.march.segments import gather, pieces, tail
from texsss.transport.march.setup import Reach, knots, reach
from texsss.types import Float, Tensor

CHUNK = 1 << 16  # points at a time, eager
COMPILED_CHUNK = 1 << 15  # what stays in a core's cache

Method = Literal["exact", "uniform"]
Phase = Literal["henyey-greenstein", "schlick"]


class Gatherer:
    """Marches rays through one interior; `fast` compiles the kernels, for chunks of COMPILED_CHUNK."""

    def __init__(self, interior: Interior, method: Method, samples: int, phase: Phase, fast: bool):
        self.interior, self.method, self.samples, self.phase, self.fast = (
            interior,
            method,
            samples,
            phase,
            fast,
        )
        self.far: Reach = reach(interior)
        self.size: tuple[int, int] = (interior.depth.shape[0], interior.depth.shape[1])
        home = interior.sigma_t
        self.channels: int = home.shape[-1]
        self._size = [home.new_tensor(float(n)) for n in self.size]
        self._planes = [d.reshape(-1).contiguous() for d in interior.depth.unbind(-1)]
        g = interior.g
        # one value for all channels is looked at once
        alike = bool((g.detach() == g.detach()[..., :1]).all())
        self._fields = [interior.sigma_s, interior.sigma_t, g[..., :1] if alike else g]
        self._run: Callable[[Any], Any] = compiled if fast else (lambda kernel: kernel)

    def __call__(
        self,
        ray: Float[Tensor, "10 P"],
        light: Float[Tensor, "S P"],
        jitter: Float[Tensor, " P"] | None = None,
    ) -> Float[Tensor, "P C"]:
        """Radiance inside per unit of irradiance that enters [1/sr].

        `ray`, `light`: from `view_rays` and `light_scalars`; `jitter` shifts uniform samples, in steps.
        """
        count = ray.shape[1]
        if self.fast and count < COMPILED_CHUNK:
            # one shape, one compilation
            missing = COMPILED_CHUNK - count
            ray, light = (torch.cat([x, x[:, -1:].expand(-1, missing)], 1) for x in (ray, light))
            jitter = None if jitter is None else torch.nn.functional.pad(jitter, (0, missing))
        ray, light = ray.contiguous(), light[:8].contiguous()
        passed = total = [torch.zeros_like(ray[0])] * self.channels
        if self.method == "exact":
            passed, total = self._exact(ray, light, passed, total)
        else:
            passed, total = self._uniform(ray, light, jitter, passed, total)
        if self.interior.bottomless:
            total = self._beyond(ray, light, passed, total)
        return torch.stack(total, -1)[:count]

    def _exact(self, ray: Tensor, light: Tensor, passed: list[Tensor], total: list[Tensor]):
        cuts, one_channel = self._run(pieces), self._run(gather)
        steps = knots(ray[4], self.samples, self.far.rate) * ray[4]
        before = self._coefficients(ray, steps[0])
        start = self._meet(ray, light, steps[0], before[2])
        for k in range(self.samples):
            after = self._coefficients(ray, steps[k + 1])
            end = self._meet(ray, light, steps[k + 1], after[2])
            found = cuts(ray[6], steps[k], steps[k + 1], start, end, self.interior.layers)
            *piece, share = found
            scattering, extinction = (a if a is b else 0.5 * (a + b) for a, b in zip(before[:2], after[:2]))
            results = [
                one_channel(
                    scattering[:, c],
                    extinction[:, c],
                    *piece,
                    [s[min(c, len(s) - 1)] for s in share],
                    passed[c],
                    total[c],
                )
                for c in range(self.channels)
            ]
            passed, total = (list(x) for x in zip(*results))
            start, before = end, after
        return passed, total

    def _uniform(
        self, ray: Tensor, light: Tensor, jitter: Tensor | None, passed: list[Tensor], total: list[Tensor]
    ):
        one = self._run(sample)
        step = ray[4] / self.samples
        for k in range(self.samples):
            t = step * k if jitter is None else (step * (k + jitter)).clamp_min(0)
            scattering, extinction, g = self._coefficients(ray, t)
            passed, total = one(
                scattering, extinction, t * ray[6], step, self._meet(ray, light, t, g), passed, total
            )
        return passed, total

    def _beyond(self, ray: Tensor, light: Tensor, passed: list[Tensor], total: list[Tensor]) -> list[Tensor]:
        scattering, extinction, g = self._coefficients(ray, ray[4])
        end = self._meet(ray, light, ray[4], g)
        share = end[3][-1]
        return [
            self._run(tail)(
                scattering[:, c],
                extinction[:, c],
                ray[6],
                end,
                share[min(c, len(share) - 1)],
                passed[c],
                total[c],
            )
            for c in range(self.channels)
        ]

    def _meet(self, ray: Tensor, light: Tensor, t: Tensor, g: Tensor):
        return self._run(meet)(ray, light, self._planes, self._size, g, t, self.phase)

    def _coefficients(self, ray: Tensor, t: Tensor) -> list[Tensor]:
        """σs, σt and g, (L, C) or, where they are maps, (L, C, P) under M(t)."""
        found = []
        for field in self._fields:
            if field.ndim == 2:
                found.append(field)
                continue
            maps = field.flatten(0, 1).flatten(1).unbind(-1)
            values = look_up(maps, self._size, ray[0] + t * ray[2], ray[1] + t * ray[3])
            found.append(torch.stack(values).reshape(*field.shape[-2:], -1))
        return found
