"""The kinds of layered matter that most painted materials are, recorded before they are asked for."""

import torch

from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.numerics import loop_files
from texsss.numerics.jitted import Source
from texsss.profiles.blocks import Loops, recorded
from texsss.profiles.hankel import flat_profile

KINDS = ((2, "total"), (2, "unmarched"), (1, "total"), (1, "unmarched"), (3, "total"))
"""How many layers, the last endless, and what light: media that scatter evenly, of one refractive index."""


def keep() -> None:
    """Writes the sources of their loops and prints their names."""
    for layers, scattering in KINDS:
        print(loop_files.kept(text(layers, scattering)).name)


def text(layers: int, scattering: str) -> str:
    """The source of the loop of one kind."""
    medium, found = Medium(sigma_a=1.0, sigma_s=1.0, eta=1.4), _Texts()
    table = Stack([Layer(medium, 1.0)] * (layers - 1) + [Layer(medium)]).table(torch.float32)
    options = {"model": "layered-sp3", "incidence": "diffuse", "side": "reflectance"}
    flat_profile(table, torch.tensor([1.0, 0.0]), scattering=scattering, loops=found, **options)
    return found.texts[0]


class _Texts(Loops):
    """Keeps what would be compiled, and leaves the rest to torch."""

    def __init__(self):
        super().__init__()
        self.texts: list[str] = []

    def solved(self, given, s, solver):
        self.texts.append(Source(recorded(given, s, solver)[0]).text)


if __name__ == "__main__":
    keep()
