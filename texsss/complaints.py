"""What is wrong with plain data, in one sentence of the user's words and not of the validator's."""

from collections.abc import Iterator
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError

from texsss.specs import LIGHTS, Model

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


def one_sentence(error: ValidationError, data: Any) -> str:
    """The first fault of `data` with its field, what was expected and what came; others are counted."""
    problems = error.errors(include_url=False)
    places = [_place(problem, data) for problem in problems]
    first = places[0]
    # of something that may be this or that, what went deepest was meant
    here = [k for k, place in enumerate(places) if place[: len(first)] == first]
    deepest = max((places[k] for k in here), key=len)
    meant = [problems[k] for k in here if places[k] == deepest]
    value = meant[0]["input"]
    # a number that is too large is no misspelt name, a list that is too short no misunderstood number
    bounds = [problem for problem in meant if problem["type"] in BOUNDS or _item_missing(problem)]
    if bounds and isinstance(value, int | float | list | tuple):
        meant = bounds
    field = ".".join(map(str, deepest)) + ": " if deepest else ""
    # a part of which something is wrong may be called wrong as a whole, too
    others = len({p for p in places if p[: len(first)] != first and first[: len(p)] != p})
    more = f" ({others} more)" if others else ""
    return f"Scene: {field}{_told(meant, deepest, value)}{more}."


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
        near = get_close_matches(str(place[-1]), sorted(set(_fields(Model))), 1, 0.75)
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


def _fields(root: type[Model]) -> Iterator[str]:
    for model in _models(root):
        yield from model.model_fields
