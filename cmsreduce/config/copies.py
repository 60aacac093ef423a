"""One body at many places: components that are `like` another one, written out before the pipeline is validated."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from cmsreduce.config.located import Adapt, Entry, merge
from cmsreduce.config.problems import Problem, config_error, located
from cmsreduce.errors import not_among

__all__ = ["copies_written_out", "without_repetitions"]

# Keys that say which body it is: with another one of them, it is another body.
_THE_BODY = (
    *("rigid", "extseout", "reduced", "modes", "states", "stiffness", "mass"),
    *("geometry", "rows", "units", "grounded"),
)


def copies_written_out(root: Entry, adapt: Adapt) -> Entry:
    """Give each component with `like` the keys of the component that it names; its own keys win.

    Parameters
    ----------
    root : Entry
        The pipeline, with includes and overrides merged in.
    adapt : callable
        As for `merge`: a component is merged over the other one as a file is over a file that it includes.

    Raises
    ------
    ConfigError
        If `like` names no component, one that is a copy itself, or stands beside a key that makes another body.
    """
    components = root.value.get("components") if isinstance(root.value, dict) else None
    if components is None or not isinstance(components.value, dict):
        return root
    problems = [each for name in components.value for each in _problems(root, components.value, name)]
    if problems:
        raise config_error(problems)
    written = {name: _written_out(name, components.value, adapt) for name in components.value}
    assert isinstance(root.value, dict)
    return Entry({**root.value, "components": Entry(written, components.where)}, root.where)


def without_repetitions(found: Iterable[tuple[Sequence[str | int], Any]], root: Entry) -> list[bool]:
    """For each fault, given by its keys and its kind: False if it is one of a copy that the original has, too."""
    listed = [(tuple(keys), kind) for keys, kind in found]

    def of_original(keys: tuple[str | int, ...]) -> tuple[str | int, ...]:
        original = _original_of(root, keys[1]) if len(keys) > 1 and keys[0] == "components" else None
        return keys if original is None else ("components", original, *keys[2:])

    return [of_original(keys) == keys or (of_original(keys), kind) not in listed for keys, kind in listed]


def _original_of(root: Entry, name: str | int) -> str | None:
    components = root.value["components"].value if isinstance(root.value, dict) and "components" in root.value else None
    entry = components.get(str(name)) if isinstance(components, dict) else None
    return None if entry is None else _like(entry)


def _like(entry: Entry) -> str | None:
    """Name of the component that another one is like, if it is written as a name."""
    like = entry.value.get("like") if isinstance(entry.value, dict) else None
    return like.value if like is not None and isinstance(like.value, str) else None


def _problems(root: Entry, components: dict[str, Entry], name: str) -> list[Problem]:
    keys, original = components[name].value, _like(components[name])
    if original is None or not isinstance(keys, dict):
        return []
    at = ("components", name, "like")
    if original == name:
        return [located(root, at, "a component cannot be like itself: name another one, or give it matrices")]
    if original not in components:
        others = [other for other in components if other != name and _like(components[other]) is None]
        return [located(root, at, not_among("component", original, others))]
    chain = [name, original]
    while (further := _like(components[chain[-1]]) if chain[-1] in components else None) is not None:
        if further in chain:
            circle = " -> ".join([*chain, further])
            return [located(root, at, f"components are like each other in a circle: {circle}; one needs matrices")]
        chain.append(further)
    if len(chain) > 2:
        return [located(root, at, f"'{original}' is a copy itself: write `like: {chain[-1]}`")]
    return [
        located(
            root,
            ("components", name, key),
            f"'{name}' is like '{original}', which has its own {key}: take this key out, or take `like` out for "
            "another body",
        )
        for key in _THE_BODY
        if key in keys
    ]


def _written_out(name: str, components: dict[str, Entry], adapt: Adapt) -> Entry:
    entry = components[name]
    original = _like(entry)
    if original is None:
        return entry
    # An override replaces a component of the file, but not the one that it is like.
    return merge(components[original], replace(entry, whole=False), adapt, ("components", name))
