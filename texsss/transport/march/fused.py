"""The march as one compiled loop: every sample and light of a point before the next point."""

import ctypes

import torch

from texsss.numerics.native import check_memory, library
from texsss.numerics.threads import in_threads
from texsss.transport.march.interior import Interior
from texsss.transport.march.kernel import framed
from texsss.transport.march.setup import thicknesses
from texsss.transport.march.variant import SOURCE, macros
from texsss.types import Float, Tensor, chunks

BLOCK = 1 << 14  # points a thread takes at a time
MOST_BOUNDARIES = 16
COARSE = 0.01  # optical depth that 10 bits may round to: beyond, boundaries get 16


class Fused:
    """The compiled loop for one interior, float32; `ready` is False where there is none."""

    def __init__(self, interior: Interior, phase: str):
        home = interior.sigma_t.detach()
        boundaries = interior.depth.shape[-1]
        fields = [interior.sigma_s, interior.sigma_t, interior.g]
        mapped = interior.varies
        alike = bool((interior.g == interior.g[..., :1]).all())
        self.ready = False
        if boundaries > MOST_BOUNDARIES or home.dtype != torch.float32 or home.device.type != "cpu":
            return
        wide = _needs_more(interior)
        how = {"endless": interior.bottomless, "schlick": phase == "schlick", "coloured_g": not alike}
        found = library(SOURCE, macros(boundaries, **how, mapped=mapped, wide=wide))
        if found is None:
            return
        self.ready = True
        self._march = found.march
        self._march.restype = ctypes.c_bool
        height, width = interior.depth.shape[:2]
        self._size = (height, width)
        self._words, self._coded = packed(interior.depth, wide)
        wide = [x.expand(*x.shape[:-1], 3) for x in fields]
        if alike:
            wide[2] = wide[2][..., :1]
        if mapped:
            flat = [x.expand(height, width, *x.shape[-2:]).flatten(2) for x in wide]
            self._maps = side_by_side(torch.cat(flat, -1))
            self._numbers = home.new_zeros(1)
        else:
            self._maps = home.new_zeros(1)
            self._numbers = torch.cat([x.flatten() for x in wide]).contiguous()

    def __call__(
        self,
        ray: Float[Tensor, "11 P"],
        lights: Float[Tensor, "N 11 P"],
        jitter: Float[Tensor, " P"] | None,
        method: str,
        samples: int,
        rate: float,
    ) -> Float[Tensor, "P 3"]:
        """Radiance inside [W/(m² sr)]; exact steps are spaced by `rate`.

        Raises DomainError: when the system has no memory for what the loop holds.
        """
        points = ray.shape[1]
        # the loop reads them as they lie
        assert ray.dtype == lights.dtype == torch.float32 and lights.shape[1:] == ray.shape
        assert jitter is None or (jitter.dtype == torch.float32 and len(jitter) == points)
        tables = [x.contiguous() for x in (ray, lights)]
        shift = None if jitter is None else jitter.contiguous()
        result = ray.new_empty(3, points)
        pointer = [x.data_ptr() for x in (self._words, self._coded, self._maps, self._numbers, *tables)]

        def work(row: slice) -> None:
            enough = self._march(
                *map(ctypes.c_void_p, pointer[:3]),
                *map(ctypes.c_int, self._size),
                *map(ctypes.c_void_p, pointer[3:]),
                ctypes.c_int(len(lights)),
                ctypes.c_void_p(None if shift is None else shift.data_ptr()),
                ctypes.c_int(samples if method == "exact" else -samples),
                ctypes.c_float(rate),
                *map(ctypes.c_int64, (row.start, row.stop, points)),
                ctypes.c_void_p(result.data_ptr()),
            )
            check_memory(enough, "March")

        in_threads(work, chunks(points, BLOCK))
        return result.T


def side_by_side(maps: Float[Tensor, "H W N"]) -> Float[Tensor, "h w n"]:
    """The maps, tiled beyond the right and the lower edge, with zeros up to a multiple of four per texel."""
    padded = torch.nn.functional.pad(maps, (0, -maps.shape[-1] % 4))
    return framed(padded).permute(1, 2, 0).contiguous()


def _needs_more(interior: Interior) -> bool:
    """Whether three boundaries vary by too much for 10 bits each."""
    if interior.depth.shape[-1] != 3:
        return False
    extinction = interior.sigma_t.detach().movedim(-2, 0).flatten(1)[:3].amax(1)
    flat = thicknesses(interior.depth.detach()).reshape(-1, 3)
    unit = (flat.amax(0) - flat.amin(0)) / (2**10 - 1)
    return bool((unit * extinction > COARSE).any())


def packed(depth: Float[Tensor, "H W B"], wide: bool = False) -> tuple[Tensor, Float[Tensor, " 2*B"]]:
    """Depths as pairs of 32-bit words (words, H + 1, W + 2, 2), each with that of the texel below, and
    least thickness and unit of each layer [mm].

    Thicknesses are kept as whole numbers between the least and the greatest of their layer, so that
    boundaries stay in order and layers of one thickness stay exact: 24 bits for one boundary, 16 for two
    or four and more, 10 for three (`wide`: 16), whose rounding is 5e-4 of what the layer varies by.
    """
    height, width, boundaries = depth.shape
    if boundaries == 0:
        return torch.zeros(0, dtype=torch.int32), depth.new_zeros(0)
    per_word = {1: 1, 3: 2 if wide else 3}.get(boundaries, 2)
    bits = {1: 24, 2: 16, 3: 10}[per_word]
    thickness = thicknesses(depth).reshape(-1, boundaries)
    least = thickness.amin(0)
    unit = (thickness.amax(0) - least) / (2**bits - 1)
    scale = torch.where(unit > 0, 1 / unit.clamp_min(1e-30), 0)
    # 24 bits are all that float32 has: the greatest may round to one more, which a mask would make the least
    whole = ((thickness - least) * scale).round().clamp_max(2**bits - 1).to(torch.int32)
    words = []
    for first in range(0, boundaries, per_word):
        word = whole[:, first].clone()
        for i in range(1, min(per_word, boundaries - first)):
            word |= whole[:, first + i] << (bits * i)
        words.append(word.reshape(height, width))
    framed_words = framed(torch.stack(words, -1))
    return torch.stack([framed_words[:, :-1], framed_words[:, 1:]], -1), torch.cat([least, unit])
