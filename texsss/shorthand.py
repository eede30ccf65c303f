"""Lights in short, as the command line takes them: `point:300,400,700:3`."""

import math
from collections.abc import Sequence

from texsss.errors import DomainError

FORMS = {
    "studio": "studio[:INTENSITY]",
    "point": "point:X,Y,Z[:W_PER_SR]",
    "sun": "sun:X,Y,Z[:W_PER_M2]",
    "sky": "sky[:RADIANCE]",
    "spot": "spot:X,Y,Z:DX,DY,DZ[:W_PER_SR]",
    "ball": "ball:X,Y,Z:RADIUS_MM[:RADIANCE]",
    "panel": "panel:X,Y,Z:DX,DY,DZ:WIDTH_MM,HEIGHT_MM[:RADIANCE]",
}
"""Name → form. X,Y,Z are mm, but towards the sun; the last part is one number, or R,G,B."""


ONE, DAYLIGHT = [1.0], [3.0]
UPRIGHT = 0.999  # cosine to the vertical from which a panel's height points to the back instead of up


def light(text: str) -> dict:
    """The scene's field for a light in short.

    Raises DomainError: when the name or its parts are not of a known form.
    """
    name, *parts = text.split(":")
    if name not in FORMS:
        raise DomainError(f"--light: expected one of {', '.join(FORMS.values())}, got {text!r}.")
    try:
        return _READERS[name](*[_numbers(part) for part in parts])
    except _Unfit as error:
        raise DomainError(f"--light: expected {FORMS[name]} with {error}, got {text!r}.") from None
    except (TypeError, ValueError):
        raise DomainError(f"--light: expected {FORMS[name]}, got {text!r}.") from None


class _Unfit(ValueError):
    """Numbers of the right form that make no light; says what they should be."""


def _numbers(part: str) -> list[float]:
    return [float(number) for number in part.split(",")]


def _vector(numbers: list[float]) -> list[float]:
    x, y, z = numbers
    return [x, y, z]


def _colour(numbers: list[float]) -> list[float]:
    return numbers * 3 if len(numbers) == 1 else _vector(numbers)


def _single(numbers: list[float]) -> float:
    (number,) = numbers
    return number


def _studio(intensity: list[float] = ONE) -> dict:
    return {"type": "studio", "intensity": _single(intensity)}


def _point(position: list[float], intensity: list[float] = ONE) -> dict:
    return {"type": "point", "position_mm": _vector(position), "intensity_w_per_sr": _colour(intensity)}


def _sun(direction: list[float], irradiance: list[float] = DAYLIGHT) -> dict:
    return {
        "type": "directional",
        "direction": _vector(direction),
        "irradiance_w_per_m2": _colour(irradiance),
    }


def _sky(radiance: list[float] = ONE) -> dict:
    return {"type": "environment", "radiance": _colour(radiance)}


def _spot(position: list[float], direction: list[float], intensity: list[float] = ONE) -> dict:
    return {**_point(position, intensity), "type": "spot", "direction": _vector(direction)}


def _ball(position: list[float], radius: list[float], radiance: list[float] = ONE) -> dict:
    return {
        "type": "sphere",
        "position_mm": _vector(position),
        "radius_mm": _single(radius),
        "radiance": _colour(radiance),
    }


def _panel(
    position: list[float], direction: list[float], edges: list[float], radiance: list[float] = ONE
) -> dict:
    width, height = edges
    if not (width > 0 and height > 0):
        raise _Unfit("a width and a height above 0")
    (dx, dy, dz), length = direction, math.hypot(*direction)
    if not (0 < length < math.inf):
        raise _Unfit("a direction other than 0,0,0")
    towards = (dx / length, dy / length, dz / length)
    upright = (0.0, 0.0, -1.0) if abs(towards[1]) > UPRIGHT else (0.0, 1.0, 0.0)
    across = _cross(upright, towards)
    scale = 1 / math.hypot(*across)
    across = [scale * number for number in across]
    along = _cross(towards, across)  # width × height is where it shines
    return {
        "type": "rectangle",
        "position_mm": _vector(position),
        "width_mm": [width * number for number in across],
        "height_mm": [height * number for number in along],
        "radiance": _colour(radiance),
    }


def _cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


_READERS = {
    "studio": _studio,
    "point": _point,
    "sun": _sun,
    "sky": _sky,
    "spot": _spot,
    "ball": _ball,
    "panel": _panel,
}
