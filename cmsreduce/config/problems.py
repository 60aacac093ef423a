"""Messages on errors in a pipeline file, each with its place and key, and with known names like an unknown one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from cmsreduce.config.found import found_in, instead_of
from cmsreduce.config.grammar import field_at, known_keys, models_at, places_of
from cmsreduce.config.keys import Keys, Pipeline
from cmsreduce.config.located import Entry, Location, find
from cmsreduce.errors import ConfigError, closest

__all__ = [
    "Problem",
    "config_error",
    "located",
    "problems_of",
    "refuse_empty",
]

# More messages would push the first one off the screen, and that one often causes the others.
_MOST_REPORTED = 10

# What stands for no value, and what it does.
_NOTHING: tuple[tuple[object, str], ...] = (({}, "{} to take the defaults"), (None, "null to leave it out"))
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
    "multiple_of": "an even number",
}
_LIMITS = {
    "greater_than": ("above", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("below", "lt"),
    "less_than_equal": ("at most", "le"),
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


def refuse_empty(root: Entry, grammar: type[Keys] = Pipeline) -> None:
    """Refuse keys after which nothing is written, each with what it takes.

    Parameters
    ----------
    root : Entry
        The tree of a file.
    grammar : type of Keys
        Grammar of the file.

    Raises
    ------
    ConfigError
        One line for each such key.
    """
    problems = [
        Problem(find(root, keys)[0].where, f"key '{path_text(keys)}' has no value: {_instead(keys, grammar)}")
        for keys in _empty_keys(root, ())
    ]
    if problems:
        raise config_error(problems)


def _empty_keys(entry: Entry, keys: tuple[str | int, ...]) -> Iterator[tuple[str | int, ...]]:
    if entry.empty:
        yield keys
    for key, item in entry.below():
        yield from _empty_keys(item, (*keys, key))


def _instead(keys: Sequence[str | int], grammar: type[Keys]) -> str:
    """Say what may stand after a key: an example, ``{}`` for the defaults, or null."""
    field, example = field_at(keys, grammar), _example(keys, grammar)
    steps = ["write one after it" + (f", e.g. {keys[-1]}: {example}" if example else "")]
    if field is not None and not field.is_required():
        taken = TypeAdapter(field.rebuild_annotation())
        steps += [words for value, words in _NOTHING if _takes(taken, value)]
    return ", or ".join(steps)


def _takes(taken: TypeAdapter[Any], value: object) -> bool:
    try:
        taken.validate_python(value)
    except ValidationError:
        return False
    return True


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

    alike: dict[object, list[ErrorDetails]] = {}
    for error in errors:
        if not follows_from_another(error):
            # A value that may be of several kinds has an error of each.
            one_of_several = error["type"] == "literal_error" or bool(_expected(error, grammar))
            alike.setdefault(find(root, error["loc"])[1] if one_of_several else id(error), []).append(error)
    return [_problem_of(root, group, grammar, whole) for group in alike.values()]


def _shared(a: tuple[int | str, ...], b: tuple[int | str, ...]) -> int:
    """Count the keys that two places have in common from the start."""
    return next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))


def _problem_of(root: Entry, errors: Sequence[ErrorDetails], grammar: type[Keys], whole: str) -> Problem:
    loc, kind = errors[0]["loc"], errors[0]["type"]
    if kind == "missing":
        return _missing(root, loc, grammar, whole)
    if kind == "extra_forbidden":
        return _unknown(root, loc, grammar)
    return located(root, loc, _wording(errors, grammar))


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
    other = next((model.other_words[word] for model in models_at(loc[:-1], grammar) if word in model.other_words), None)
    meant = other or closest(word, known)
    places = [place for place in places_of(word, grammar) if place]
    if meant:
        guess = f": did you mean '{meant}'?"
    elif places:
        guess = f" here: it belongs under {' or '.join(f'{place!r}' for place in places[:2])}."
    else:
        guess = "."
    return Problem(entry.where, f"key '{path_text(followed)}' is unknown{guess} Known keys: {', '.join(known)}")


def _wording(errors: Sequence[ErrorDetails], grammar: type[Keys]) -> str:
    """Words on the errors of one value; one that may be of several kinds has an error of each."""
    error = errors[0]
    kind, found = error["type"], found_in(error["input"])
    if kind in ("value_error", "assertion_error"):
        return str(error["ctx"]["error"])
    if kind in ("too_short", "string_too_short"):
        return f"is empty{_for_example(error['loc'], grammar)}"
    choices = [choice for each in errors if each["type"] == "literal_error" for choice in _choices(each)]
    expected = [_expected(each, grammar) for each in errors if each["type"] != "literal_error"]
    wanted = " or ".join([*choices, *(one for one in expected if one)])
    if not wanted:
        return f"{error['msg']}, found {found}"
    meant = closest(str(error["input"]), choices)
    guess = f", did you mean '{meant}'?" if meant else ";" if choices else ","
    # A number is in the units that the file states for the scene or the body.
    numeric = {each["type"] for each in errors} & {"float_type", "int_type"}
    example = "" if choices else _example(error["loc"], grammar)
    step = instead_of(error["input"] if numeric else None, example, unit=False, whole="float_type" not in numeric)
    return f"found {found}{guess} expected {wanted}{step}"


def _choices(error: ErrorDetails) -> list[str]:
    return str(error["ctx"]["expected"]).replace("'", "").replace(" or ", ", ").split(", ")


def _expected(error: ErrorDetails, grammar: type[Keys]) -> str:
    """Kind or range of the value that stands at a place; empty for an error of another sort."""
    kind, context = error["type"], error.get("ctx", {})
    if kind in _LIMITS:
        words, limit = _LIMITS[kind]
        return f"a number {words} {context[limit]:g}"
    known = known_keys(error["loc"], grammar) if kind == "model_type" else []
    return _EXPECTED.get(kind, "") + (f" with keys {', '.join(known)}" if known else "")


def _for_example(loc: tuple[int | str, ...], grammar: type[Keys]) -> str:
    example = _example(loc, grammar)
    return f", e.g. {example}" if example else ""


def _example(loc: Sequence[int | str], grammar: type[Keys]) -> str:
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
