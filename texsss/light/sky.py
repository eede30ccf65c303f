"""How much of the light of its surroundings reaches each site past what hides them."""

import math
from collections.abc import Sequence

import torch
from torch.quasirandom import SobolEngine

from texsss.light.emitters import POOL, Environment
from texsss.light.sites import Sites, dot
from texsss.light.smoothing import neighbours_mean
from texsss.light.visibility import Occluder
from texsss.media import fresnel
from texsss.numerics.threads import in_threads
from texsss.types import Bool, Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks

SITES = 1 << 14  # at a time: what the cache of a core holds


def open_shares(
    sites: Sites,
    surroundings: Sequence[Environment],
    *,
    eta: float,
    occluder: Occluder | None,
    samples: int,
    sharing: int,
    seed: int,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> list[Float[Tensor, "P C"]]:
    """For each of `surroundings`, the share of its entering light that nothing hides, 0..1; C is 1 or 3.

    Of `samples` looks each site takes every `sharing`-th, in an order of its own, and shares what it
    saw with its `sharing` nearest neighbours. Without gradients. Raises Cancelled.
    """
    if not len(sites):
        return [sites.position.new_ones(0, 1) for _ in surroundings]
    generator = torch.Generator().manual_seed(seed)
    looks = own_looks(samples, sharing)  # half of them of one kind, half of another
    steps = (SobolEngine(2, scramble=True, seed=seed).draw(looks) * POOL).long()
    sphere = _sphere(generator).to(sites.normal.device)
    shift = torch.randint(POOL, (len(sites), 2), dtype=torch.int32, generator=generator).to(sphere.device)
    parts, ended = chunks(len(sites), SITES), []

    def seen_from(rows: slice) -> list[Float[Tensor, "rows _"]]:
        check_cancelled(cancel)
        view = _View(sites[rows], occluder, eta)
        sums = [view.look_around(light, shift[rows], steps, sphere) for light in surroundings]
        ended.append(rows)
        if progress is not None:
            progress("light", len(ended) / len(parts))
        return sums

    sums = [torch.cat(found) for found in zip(*in_threads(seen_from, parts, cancel), strict=True)]
    if sharing > 1 and occluder is not None:
        sums = neighbours_mean(sites.position, sites.smooth, sums, sharing, cancel)
    shares = []
    for both in sums:
        seen, whole = both.chunk(2, 1)
        # the same looks with and without what hides: where nothing does their ratio is exactly 1
        shares.append(torch.where(whole > 0, seen / torch.where(whole > 0, whole, 1.0), 1.0))
    return [share.to(sites.position.dtype) for share in shares]


def own_looks(samples: int, sharing: int) -> int:
    """How many of `samples` looks, shared by `sharing` neighbours, a site takes itself: an even number."""
    return 2 * -(-samples // (2 * sharing))


class _View:
    """What a chunk of sites sees."""

    def __init__(self, sites: Sites, occluder: Occluder | None, eta: float):
        self.normal, self.smooth = (n.detach().float() for n in (sites.normal, sites.smooth))
        self.bumped = sites.normal is not sites.smooth
        self.eta, self.occluder = eta, occluder
        self.starts = None if occluder is None else occluder.starts(sites.origin, sites.face_normal)

    def look_around(
        self,
        light: Environment,
        shift: Int[Tensor, "P 2"],
        steps: Int[Tensor, "N 2"],
        sphere: Float[Tensor, "D 3"],
    ) -> Float[Tensor, "P C2"]:
        """Light that enters past what hides it, and all that would, summed over looks, side by side.

        `shift`, `steps`: of the sites and of the looks on a torus of POOL² cells.
        """
        seen = whole = self.normal.new_zeros(())
        of_each = len(steps) // 2  # a part of a light takes looks of one kind, and half as many
        for number, step in enumerate(steps[: of_each * len(light.looks)].tolist()):
            row, column = (shift + shift.new_tensor(step)).remainder_(POOL).unbind(1)
            bright = light.looks[number // of_each]
            direction, brought = light.look(bright, row * POOL + column, sphere, self.normal)
            cosine = dot(self.normal, direction)
            entering = brought * fresnel.transmittance(cosine, self.eta)[:, None]
            whole = whole + entering
            # spots leave most looks around them without any light, which need no ray
            shines = entering.amax(1) > 0
            seen = seen + self._unhidden(direction, cosine, shines)[:, None] * entering
        return torch.cat([seen, whole], 1)

    def _unhidden(
        self, direction: Float[Tensor, "P 3"], cosine: Float[Tensor, " P"], shines: Bool[Tensor, " P"]
    ) -> Float[Tensor, " P"]:
        """1 where the sky is open along `direction`, 0 where something is in the way or nothing `shines`."""
        above = (cosine > 0) & shines
        if self.bumped:
            above = above & (dot(self.smooth, direction) > 0)  # bumps must not lift the horizon
        if self.starts is None:
            return above.to(cosine.dtype)
        rows = above.nonzero()[:, 0]
        if len(rows) == len(above):
            return (~self.starts.hidden(direction)).to(cosine.dtype)
        hidden = self.starts[rows].hidden(direction[rows])
        return torch.zeros_like(cosine).index_put((rows,), (~hidden).to(cosine.dtype))


def _sphere(generator: torch.Generator) -> Float[Tensor, "D 3"]:
    """Unit directions, one in each of POOL² parts of the sphere of equal size, row by row."""
    within = torch.rand(POOL, POOL, 2, generator=generator)
    row, column = torch.meshgrid(torch.arange(POOL), torch.arange(POOL), indexing="ij")
    height = 1 - 2 * (row + within[..., 0]) / POOL
    angle = 2 * math.pi * (column + within[..., 1]) / POOL
    across = torch.sqrt((1 - height * height).clamp_min(0))
    return torch.stack([across * torch.cos(angle), height, across * torch.sin(angle)], -1).reshape(-1, 3)
