"""Weights of the layered models by one compiled loop: profiles at all frequencies, and their projection."""

import ctypes
from pathlib import Path

import torch

from texsss.media.stack import LayerTable
from texsss.numerics.native import check_memory, library
from texsss.profiles import straight
from texsss.profiles.four_streams import moments
from texsss.profiles.incidence import Incidence, finer, incidence_directions, mean_direction
from texsss.profiles.layered_diffusion import admittance
from texsss.profiles.layered_sp3 import parameters, unreduced
from texsss.profiles.nearly import aligned
from texsss.profiles.single import exits
from texsss.profiles.slab import mirrors
from texsss.types import Float, Tensor

SOURCE = Path(__file__).with_name("fused.cpp")
MODELS = ("layered-diffusion", "layered-sp3")


class Fused:
    """The compiled loop for one model and the rows of a table; `ready` is False where there is none."""

    def __init__(
        self,
        table: LayerTable,
        s: Float[Tensor, " S"],
        matrix: Float[Tensor, "K S"],
        *,
        model: str,
        scattering: str,
        incidence: Incidence,
        side: str,
    ):
        etas, below = table.eta, side == "transmittance"
        self.ready = False
        home = table.sigma_a
        if model not in MODELS or home.dtype != torch.float32 or home.device.type != "cpu":
            return
        if (below and table.bottomless) or (model == MODELS[0] and scattering != "total"):
            return
        two = model == "layered-sp3"
        directions = (incidence_directions if two else mean_direction)(incidence, etas[0])
        found = _loop(len(directions))
        if found is None:
            return
        self.ready = True
        self._weigh = found.weigh
        self._weigh.restype = ctypes.c_bool
        numbers = [*etas, *map(admittance, etas)]
        fine = finer(directions, etas)
        for cosine, share in (*directions, *fine):
            numbers += [cosine, share, *mirrors(etas, cosine)]
        leaving, sets = (), ()
        for near, far in ((etas[0], etas[-1]), (etas[-1], etas[0])) if two else ():
            leaving = exits(near, far)
            sets = parameters(etas[0], near, far)
            for exit_ in leaving:
                numbers += exit_
            for weight, *modes in sets:
                numbers += [weight, *(x for m in modes for pair in m for x in pair)]
        for eta in (etas[0], etas[-1]) if two else ():
            numbers += [*straight.leaving(eta), *straight.returning(eta)]
        deflected = two and unreduced(table)
        if deflected:
            numbers += [*moments(etas, below), aligned(directions)]
        header = [two, len(etas), table.channels, table.bottomless, below, scattering != "multiple"]
        header += [scattering != "single", deflected]
        header += [scattering == "unmarched" and not below, len(fine), len(leaving), len(sets), *matrix.shape]
        self._header = (ctypes.c_int32 * len(header))(*map(int, header))
        self._numbers = (ctypes.c_double * len(numbers))(*numbers)
        fields = table.fields  # as they lie in memory, expanded channels among them
        self._fields = (ctypes.c_void_p * 4)(*(x.data_ptr() for x in fields))
        self._strides = (ctypes.c_int64 * 12)(*(step for x in fields for step in x.stride()))
        self._kept = fields, s.contiguous(), matrix.contiguous()

    def __call__(self, rows: slice, result: Float[Tensor, "U K C"]) -> None:
        """Fills some rows of `result`. Raises DomainError: when the system has no memory for that."""
        fields, s, matrix = self._kept
        assert 0 <= rows.start <= rows.stop <= len(fields[0]) and rows.step is None
        assert result.shape == (len(fields[0]), len(matrix), fields[0].shape[-1])
        assert result.dtype == torch.float32 and result.is_contiguous()
        enough = self._weigh(
            *map(ctypes.byref, (self._header, self._numbers, self._fields, self._strides)),
            *(ctypes.c_void_p(x.data_ptr()) for x in (s, matrix)),
            *map(ctypes.c_int64, (rows.start, rows.stop)),
            ctypes.c_void_p(result.data_ptr()),
        )
        check_memory(enough, "Profiles")


def _loop(directions: int) -> ctypes.CDLL | None:
    return library(SOURCE, {"DIRECTIONS": directions})
