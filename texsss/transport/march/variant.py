"""Which of the compiled marches an interior asks for; without torch, while which loads they are built."""

from pathlib import Path

SOURCE = Path(__file__).with_name("fused.cpp")


def macros(
    boundaries: int,
    *,
    endless: bool = True,
    schlick: bool = False,
    coloured_g: bool = False,
    mapped: bool = False,
    wide: bool = False,
) -> dict[str, int]:
    """What `SOURCE` is compiled with.

    `endless`: a layer goes on below the last boundary; `coloured_g`: g differs between channels; `mapped`:
    coefficients are maps; `wide`: three boundaries have 16 bits each, not 10.
    """
    flags = {"ENDLESS": endless, "SCHLICK": schlick, "MAPPED": mapped, "WIDE": wide}
    numbers = {"BOUNDARIES": boundaries, "G_CHANNELS": 3 if coloured_g else 1}
    return numbers | {name: int(value) for name, value in flags.items()}
