"""What is wrong with plain data, in one sentence of the user's words and not of the validator's."""

from collections.abc import Iterator
from difflib import get_close_matches
from functools import cache
from typing import Any, NamedTuple

from pydantic import ValidationError

from texsss.lamps import LIGHTS
from texsss.specs import Model

MAPS = ("albedo", "normal", "roughness", "specular", "map", "mask", "opacity", "base")
"""Fields that may name a map."""

KINDS = {
    "float_type": "a number",
    "int_type": "an integer",
    "int_from_float": "an integer",
    "string_type": "a text",
    "tuple_type": "a list in [ ]",
    "list_type": "a list in [ ]",
    "dict_type": "names and values in { }",
    "bool_type": "true or false",
    "finite_number": "a finite number",
    "none_required": "null",
    "string_pattern_mismatch": "64 digits 0 to 9 or a to f, as an upload is named",
}
BOUNDS = {
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "at least {min_length} in the list",
    "too_long": "at most {max_length} in the list",
    "string_too_long": "at most {max_length} characters",
    "literal_error": "{expected}",
}


class Fault(NamedTuple):
    """What is wrong at one place of plain data: what was expected, what came; `kind` as pydantic has it."""

    place: tuple
    kind: str
    told: str


def faults(error: ValidationError, data: Any, most: int) -> tuple[list[Fault], int]:
    """What is wrong with `data` at the first `most` places, and at how many something is."""
    meant: dict[tuple, list] = {}
    for problem in error.errors(include_url=False):
        meant.setdefault(_place(problem, data), []).append(problem)
    # of something that may be this or that, what went deepest was meant; and a part of which something is
    # wrong may be called wrong as a whole, too
    whole = {place[:k] for place in meant for k in range(len(place))}
    places = [place for place in meant if place not in whole]
    return [_fault(place, meant[place]) for place in places[:most]], len(places)


def _fault(place: tuple, problems: list) -> Fault:
    value = problems[0]["input"]
    # a number that is too large is no misspelt name, a list that is too short no misunderstood number
    limits = BOUNDS.keys() - {"literal_error"}
    bounds = [problem for problem in problems if problem["type"] in limits or _item_missing(problem)]
    if bounds and isinstance(value, int | float | list | tuple):
        problems = bounds
    return Fault(place, problems[0]["type"], _told(problems, place, value))


def one_sentence(error: ValidationError, data: Any) -> str:
    """The first fault of `data` with its field, what was expected and what came; others are counted."""
    (first,), count = faults(error, data, 1)
    field = ".".join(map(str, first.place)) + ": " if first.place else ""
    more = f" ({count - 1} more)" if count > 1 else ""
    return f"Scene: {field}{first.told}{more}."


def _place(problem: Any, data: Any) -> tuple:
    """The field of a problem, without the names of alternatives that are mixed in.

    Items that a list lacks belong to the list.
    """
    place: list = []
    loc = problem["loc"]
    for k, part in enumerate(loc):
        there = isinstance(data, dict) and part in data
        there = there or (isinstance(data, list | tuple) and isinstance(part, int) and part < len(data))
        if there:
            data = data[part]
            place.append(part)
        elif k == len(loc) - 1 and problem["type"] == "missing" and isinstance(part, str):
            place.append(part)
    return tuple(place)


def _item_missing(problem: Any) -> bool:
    """Whether a list lacks items."""
    return problem["type"] == "missing" and isinstance(problem["loc"][-1], int)


def _told(problems: list, place: tuple, value: Any) -> str:
    """What was expected and what came."""
    first = problems[0]
    kind = first["type"]
    if kind == "extra_forbidden":
        near = get_close_matches(str(place[-1]), sorted(field_names()), 1, 0.75)
        return "there is no field of this name" + (f"; did you mean {near[0]}" if near else "")
    if kind == "value_error":
        return first["msg"].removeprefix("Value error, ")
    if _item_missing(first):
        wanted = 1 + max(problem["loc"][-1] for problem in problems)
        return f"expected {wanted} values in the list, got {len(value)}"
    if kind == "missing":
        return "expected a value, got none"
    if kind == "union_tag_not_found":
        return f'expected a "type", one of {", ".join(LIGHTS)}, got none'
    if kind == "union_tag_invalid":
        return f"expected a type of {', '.join(LIGHTS)}, got {first['ctx']['tag']!r}"
    wanted = " or ".join(dict.fromkeys(_wanted(problem, place) for problem in problems))
    if kind in ("too_short", "too_long"):
        return f"expected {wanted}, got {len(value)}"
    plain = isinstance(value, str | int | float | None)
    return f"expected {wanted}, got {value!r}" if plain else f"expected {wanted}"


def _wanted(problem: Any, place: tuple) -> str:
    kind = problem["type"]
    if kind == "string_type" and place[-1] in MAPS:
        return "the name of a map"
    if kind in ("model_type", "model_attributes_type"):
        name = problem.get("ctx", {}).get("class_name")
        names = next((model for model in _models(Model) if model.__name__ == name), None)
        fields = "type and what belongs to it" if names is None else ", ".join(names.model_fields)
        return f"{{ }} with {fields}"
    if kind in BOUNDS:
        return BOUNDS[kind].format(**problem.get("ctx", {}))
    return KINDS.get(kind) or problem["msg"].removeprefix("Input should be ")


def _models(root: type[Model]) -> Iterator[type[Model]]:
    for model in root.__subclasses__():
        yield model
        yield from _models(model)


@cache
def field_names() -> frozenset[str]:
    """Of all parts of a scene."""
    return frozenset(name for model in _models(Model) for name in model.model_fields)
