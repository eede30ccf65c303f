"""Which values black and white stand for in an image of data, so that one can read it."""

from dataclasses import dataclass

from texsss.types import Float, Tensor

UNITS = {
    "irradiance": "W/m²",
    "diffused": "W/m²",
    "exitance": "W/m²",
    "seam-jump": "W/m²",
    "gaussian": "W/m²",
    "radiance": "W/(m² sr)",
    "single": "W/(m² sr)",
    "position": "mm",
    "texel-mm": "mm",
    "through-mm": "mm",
    "thickness": "mm",
}
"""Of what lies between the stages; all else is a share of 1."""

ENDS = {"coverage": (0.0, 1.0), "albedo": (0.0, 1.0), "metric": (0.0, 1.0), "normal": (-1.0, 1.0)}
"""Values that black and white always stand for."""

BRIGHT = 0.995  # share of the values above 0 that white is not below: a few specks must not darken all
MOST_SORTED = 1 << 20


@dataclass(frozen=True)
class Reading:
    """What an image shows: `black` and `white` are the values that these stand for, in `unit`.

    `least`, `greatest`: of all values, which may lie beyond.
    """

    black: float
    white: float
    least: float
    greatest: float
    unit: str

    def shown(self, values: Float[Tensor, "H W C"]) -> Float[Tensor, "H W C"]:
        """The values from 0, black, to 1, white."""
        return ((values - self.black) / (self.white - self.black)).clamp(0, 1)

    @property
    def values(self) -> str:
        """From where to where they go, for people."""
        return f"values from {self.least:.4g} to {self.greatest:.4g}{self._unit}"

    @property
    def sentence(self) -> str:
        """All of it, for people."""
        return f"black is {self.black:.4g}{self._unit}, white {self.white:.4g}{self._unit}; {self.values}"

    @property
    def _unit(self) -> str:
        return f" {self.unit}" if self.unit else ""

    @property
    def text(self) -> dict[str, str]:
        """The same as words and numbers for a file's own description."""
        numbers = {name: f"{getattr(self, name):.9g}" for name in ("black", "white", "least", "greatest")}
        return {"Description": self.sentence} | numbers | {"unit": self.unit or "1"}


def reading(name: str, values: Float[Tensor, "H W C"]) -> Reading:
    """How to show what lies between the stages under this name.

    Shares and normals have the same black and white always. Black is 0 for others, or the least value where
    they are positions; white is what all but a two-hundredth of those above 0 lie below.
    Raises nothing.
    """
    values = values.detach()
    least, greatest = (float(end) for end in values.aminmax())
    kind = name.rsplit("-", 1)[0] if name.rsplit("-", 1)[-1].isdigit() else name
    unit = UNITS.get(kind, "")
    if kind in ENDS:
        return Reading(*ENDS[kind], least, greatest, unit)
    if kind == "position":
        return Reading(least, greatest if greatest > least else least + 1, least, greatest, unit)
    some = values[values > 0]
    some = some[:: -(-len(some) // MOST_SORTED) or 1]  # thinned evenly: to sort more takes long
    white = float(some.quantile(BRIGHT)) if len(some) else 1.0
    return Reading(0.0, white, least, greatest, unit)
