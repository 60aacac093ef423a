"""Walks through the grammar of the pipeline file: the keys that are allowed at a place, and the places of a key."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import AliasChoices, BaseModel
from pydantic.fields import FieldInfo

from cmsreduce.config.keys import Keys, Pipeline

__all__ = ["field_at", "is_mapping_of_values", "known_keys", "models_at", "places_of"]


def _plain_kinds(kind: Any) -> list[Any]:
    """Types of an annotation or union."""
    if get_origin(kind) is Annotated:
        return _plain_kinds(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return [plain for arm in get_args(kind) for plain in _plain_kinds(arm)]
    return [kind]


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _field_names(name: str, field: FieldInfo) -> list[str]:
    """Names of a key in the file, the usual one first."""
    if isinstance(field.validation_alias, AliasChoices):
        return [str(choice) for choice in field.validation_alias.choices]
    return [field.alias or name]


def _step(kind: Any, key: str | int) -> list[Any]:
    if _is_model(kind):
        return [
            plain
            for name, field in kind.model_fields.items()
            if key in _field_names(name, field)
            for plain in _plain_kinds(field.annotation)
        ]
    arguments = get_args(kind)
    if get_origin(kind) is dict:
        return _plain_kinds(arguments[1])
    if get_origin(kind) is tuple and isinstance(key, int):
        variadic = len(arguments) == 2 and arguments[1] is Ellipsis
        return _plain_kinds(arguments[0 if variadic else min(key, len(arguments) - 1)])
    return []


def _kinds_at(keys: Sequence[str | int], grammar: type[Keys]) -> list[Any]:
    """Types of the value at keys; names that the validator adds to the keys are skipped."""
    kinds: list[Any] = [grammar]
    for key in keys:
        kinds = [further for kind in kinds for further in _step(kind, key)] or kinds
    return kinds


def models_at(keys: Sequence[str | int], grammar: type[Keys] = Pipeline) -> list[type[Keys]]:
    """Mappings of the grammar that are allowed at keys."""
    return [kind for kind in _kinds_at(keys, grammar) if _is_model(kind) and issubclass(kind, Keys)]


def is_mapping_of_values(keys: Sequence[str | int]) -> bool:
    """True if keys lead to a mapping from the user's own names to single values."""
    mappings = [kind for kind in _kinds_at(keys, Pipeline) if get_origin(kind) is dict]
    return bool(mappings) and not any(_is_model(value) for kind in mappings for value in _step(kind, ""))


def known_keys(keys: Sequence[str | int], grammar: type[Keys] = Pipeline) -> list[str]:
    """Keys that are allowed in the mapping at keys."""
    return [
        _field_names(name, field)[0] for model in models_at(keys, grammar) for name, field in model.model_fields.items()
    ]


def field_at(keys: Sequence[str | int], grammar: type[Keys] = Pipeline) -> FieldInfo | None:
    """Description and examples of the last of some keys."""
    for end in range(len(keys), 0, -1):
        above, key = keys[: end - 1], keys[end - 1]
        for model in models_at(above, grammar):
            for name, field in model.model_fields.items():
                if key in _field_names(name, field):
                    return field
        # Items of a list, and names that the validator adds, share the description of the key above.
        if isinstance(key, str) and any(_step(kind, key) for kind in _kinds_at(above, grammar)):
            return None
    return None


def _walk(model: type[Keys], path: str, above: tuple[type[Keys], ...]) -> Iterator[tuple[str, str]]:
    for name, field in model.model_fields.items():
        key = _field_names(name, field)[0]
        yield key, path
        for kind in _plain_kinds(field.annotation):
            inner = _plain_kinds(get_args(kind)[1]) if get_origin(kind) is dict else [kind]
            for below in inner:
                if _is_model(below) and below not in above:
                    at = f"{path}.{key}" if path else key
                    at = f"{at}.NAME" if get_origin(kind) is dict else at
                    yield from _walk(below, at, (*above, below))


def places_of(key: str, grammar: type[Keys] = Pipeline) -> list[str]:
    """Mappings of the grammar that have a key, outermost first; NAME stands for the user's own name."""
    places = {place for known, place in _walk(grammar, "", (grammar,)) if known == key}
    return sorted(places, key=lambda place: (place.count("."), place))
