"""Tabulated solutions of the integral transport equation: isotropic scattering, normal incidence, one eta."""

import json
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from reference.boundary import Array
from reference.layers import Layer


@dataclass(frozen=True)
class Tabulated:
    """Hankel-space reflectance and transmittance of one stack; ballistic light and its bounces excluded."""

    name: str
    layers: list[Layer]
    s: Array  # [1/mm]
    R1: Array  # scattered once
    Rm: Array  # twice or more
    T1: Array
    Tm: Array

    @property
    def R(self) -> Array:
        return self.R1 + self.Rm

    @property
    def T(self) -> Array:
        return self.T1 + self.Tm


def read_transport(shared_data: Path) -> list[Tabulated]:
    """All stacks of reference/transport.json; `shared_data` is the fixture of that name."""
    table = json.loads((shared_data / "reference" / "transport.json").read_text())
    s = np.array(table["s"])
    out = []
    for stack in table["stacks"]:
        layers = [
            Layer(
                row["sigma_a"],
                row["sigma_s_prime"],
                inf if row["thickness"] is None else row["thickness"],
                eta=stack["eta"],
            )
            for row in stack["layers"]
        ]
        out.append(
            Tabulated(stack["name"], layers, s, *(np.array(stack[key]) for key in ("R1", "Rm", "T1", "Tm")))
        )
    return out
