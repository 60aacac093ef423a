"""Messages on errors in a pipeline file, each with its place and key, and with known names like an unknown one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic_core import ErrorDetails

from cmsreduce.config.grammar import field_at, known_keys, models_at, places_of
from cmsreduce.config.keys import Keys, Pipeline
from cmsreduce.config.located import Entry, Location, find
from cmsreduce.errors import ConfigError, closest

__all__ = [
    "Problem",
    "config_error",
    "located",
    "problems_of",
]

# More messages would push the first one off the screen, and that one often causes the others.
_MOST_REPORTED = 10

_WITH_UNIT = re.compile(r"[-+\d.]+\s*[^\d\s]")
_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "tuple_type": "a list",
    "dict_type": "a mapping of names",
    "model_type": "a mapping",
    "none_required": "nothing",
    "path_type": "a file name",
    "finite_number": "a finite number",
}


@dataclass(frozen=True)
class Problem:
    """One error in a pipeline file.

    Parameters
    ----------
    where : Location
        File and line, or the override.
    text : str
        Key, what was found, what is expected.
    """

    where: Location
    text: str

    def __str__(self) -> str:
        return f"{self.where}: {self.text}"


# Characters of one line of a message: a file may have a key of any length.
_LONGEST_LINE = 600


def config_error(problems: Sequence[Problem]) -> ConfigError:
    """Exception that lists problems, one a line, in the order of the lines of each file."""
    files = list(dict.fromkeys(problem.where.source for problem in problems))
    ordered = sorted(problems, key=lambda problem: (files.index(problem.where.source), problem.where.line or 0))
    lines = list(dict.fromkeys(_cut(str(problem)) for problem in ordered))
    more = len(lines) - _MOST_REPORTED
    return ConfigError("\n".join([*lines[:_MOST_REPORTED], *([f"... and {more} more"] if more > 0 else [])]))


def _cut(line: str) -> str:
    return line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]} ..."


def path_text(keys: Sequence[str | int]) -> str:
    """Keys as in messages: ``scene.articulation.spin[2]``."""
    text = ""
    for key in keys:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else key
    return text


def located(root: Entry, keys: Sequence[str | int], message: str) -> Problem:
    """Add to a message the place where its key was written."""
    entry, followed = find(root, keys)
    return Problem(entry.where, f"key '{path_text(followed)}': {message}" if followed else message)


def problems_of(
    root: Entry, errors: Sequence[ErrorDetails], grammar: type[Keys] = Pipeline, whole: str = "the pipeline"
) -> list[Problem]:
    """Messages on the errors of the validator.

    Parameters
    ----------
    root : Entry
        The tree that was validated.
    errors : sequence of ErrorDetails
    grammar : type of Keys
        Grammar of the file.
    whole : str
        Name of the file's contents in messages.
    """
    places = [error["loc"] for error in errors]

    def follows_from_another(error: ErrorDetails) -> bool:
        # The validator also reports a list as empty if its only item was refused.
        loc = error["loc"]
        return error["type"] == "too_short" and any(len(place) > len(loc) == _shared(place, loc) for place in places)

    return [_problem_of(root, error, grammar, whole) for error in errors if not follows_from_another(error)]


def _shared(a: tuple[int | str, ...], b: tuple[int | str, ...]) -> int:
    """Count the keys that two places have in common from the start."""
    return next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))


def _problem_of(root: Entry, error: ErrorDetails, grammar: type[Keys], whole: str) -> Problem:
    loc = error["loc"]
    kind = error["type"]
    if kind == "missing":
        return _missing(root, loc, grammar, whole)
    if kind == "extra_forbidden":
        return _unknown(root, loc, grammar)
    return located(root, loc, _wording(error, grammar))


def _missing(root: Entry, loc: tuple[int | str, ...], grammar: type[Keys], whole: str) -> Problem:
    entry, followed = find(root, loc[:-1])
    lacking = str(loc[-1])
    example = _example(loc, grammar)
    who = f"key '{path_text(followed)}'" if followed else whole
    near = closest(lacking, entry.value) if isinstance(entry.value, dict) else None
    hint = f"; is '{near}' meant to be it?" if near and near not in known_keys(loc[:-1], grammar) else ""
    return Problem(entry.where, f"{who} lacks '{lacking}'" + (f", e.g. {lacking}: {example}" if example else "") + hint)


def _unknown(root: Entry, loc: tuple[int | str, ...], grammar: type[Keys]) -> Problem:
    entry, followed = find(root, loc)
    known, word = known_keys(loc[:-1], grammar), str(loc[-1])
    for model in models_at(loc[:-1], grammar):
        if word in model.removed:
            return Problem(entry.where, f"key '{path_text(followed)}' has been removed. {model.removed[word]}")
    meant = closest(word, known)
    places = [place for place in places_of(word, grammar) if place]
    if meant:
        guess = f": did you mean '{meant}'?"
    elif places:
        guess = f" here: it belongs under {' or '.join(f'{place!r}' for place in places[:2])}."
    else:
        guess = "."
    return Problem(entry.where, f"key '{path_text(followed)}' is unknown{guess} Known keys: {', '.join(known)}")


def _wording(error: ErrorDetails, grammar: type[Keys]) -> str:
    context: Mapping[str, Any] = error.get("ctx", {})
    kind, found = error["type"], _found(error["input"])
    if kind in ("value_error", "assertion_error"):
        return str(context["error"])
    if kind == "literal_error":
        choices = str(context["expected"]).replace("'", "").replace(" or ", ", ").split(", ")
        meant = closest(str(error["input"]), choices)
        guess = f", did you mean '{meant}'?" if meant else ";"
        return f"found {found}{guess} expected {' or '.join(choices)}"
    limits = {"greater_than": "gt", "greater_than_equal": "ge", "less_than": "lt", "less_than_equal": "le"}
    if kind in limits:
        sign = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}[limits[kind]]
        return f"found {found}, expected a number {sign} {context[limits[kind]]:g}{_for_example(error['loc'], grammar)}"
    if kind in ("too_short", "string_too_short"):
        return f"is empty{_for_example(error['loc'], grammar)}"
    if kind in _EXPECTED:
        known = known_keys(error["loc"], grammar) if kind == "model_type" else []
        keys = f" with keys {', '.join(known)}" if known else ""
        # A number is in the units that the file states for the scene or the body.
        bare = " without a unit" if kind in ("float_type", "int_type") and _WITH_UNIT.match(str(error["input"])) else ""
        return f"found {found}, expected {_EXPECTED[kind]}{bare}{keys}{_for_example(error['loc'], grammar)}"
    return f"{error['msg']}, found {found}"


def _for_example(loc: tuple[int | str, ...], grammar: type[Keys]) -> str:
    example = _example(loc, grammar)
    return f", e.g. {example}" if example else ""


def _example(loc: tuple[int | str, ...], grammar: type[Keys]) -> str:
    field = field_at(loc, grammar)
    return _flow(field.examples[0]) if field is not None and field.examples else ""


def _flow(value: object) -> str:
    """Write a value as YAML in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)


def _found(value: object) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return f"the number {value}"
    if isinstance(value, (str, Path)):
        return f"the text '{value}'"
    return "a mapping" if isinstance(value, Mapping) else "a list"
