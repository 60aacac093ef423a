"""The line of the pipeline file that an error of a later stage is about."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from cmsreduce.config.keys import Pipeline
from cmsreduce.config.located import Entry, find
from cmsreduce.config.problems import located
from cmsreduce.errors import CmsReduceError

__all__ = ["naming_the_line"]

Keys = tuple[str | int, ...]

# Words of messages for what has a name, and the mapping of the file that holds it.
_MAPPINGS = {
    "body": ("components",),
    "component": ("components",),
    "joint": ("scene", "joints"),
    "actuator": ("scene", "actuators"),
    "sensor": ("scene", "sensors"),
}
_NAMED = re.compile(rf"\b({'|'.join(_MAPPINGS)}) '([\w-]+)'(?:, interface '([\w-]+)')?")


@contextmanager
def naming_the_line(pipeline: Pipeline) -> Iterator[None]:
    """Put file and line of the key that an error is about before its message, where the message names one.

    Parameters
    ----------
    pipeline : Pipeline
        Read from a file; errors of one that is given as a mapping stay as they are.
    """
    try:
        yield
    except CmsReduceError as error:
        place = "" if pipeline.tree is None else _place(pipeline.tree, str(error))
        if place and not str(error).startswith(place.partition(":")[0] + ":"):
            error.args = (f"{place}: {error}", *error.args[1:])
        raise


def _place(tree: Entry, message: str) -> str:
    """Place of the key whose file the message begins with, whose text it quotes, or that it names first."""
    keys = _key_of_file(tree, message)
    if keys:
        problem = located(tree, keys, "")
        return "" if problem.where.line is None else str(problem).rstrip(": ")
    where = next((entry.where for entry in _named(tree, message) if entry.where.line is not None), None)
    return "" if where is None else str(where)


def _key_of_file(tree: Entry, message: str) -> Keys:
    found = [
        keys[:-1] if keys[-1] == "file" else keys
        for keys, entry in _texts(tree, ())
        if keys[0] != "output"
        and re.match(rf"{re.escape(str(entry.where.folder / str(entry.value)))}(?:[,:] |:\d)", message)
    ]
    if len(found) < 2:
        return found[0] if found else ()
    # Several matrices of one file: the message may quote the name of one.
    named = [keys for keys in found if f"'{find(tree, [*keys, 'matrix'])[0].value}'" in message]
    return named[0] if len(named) == 1 else found[0][:2]


def _named(tree: Entry, message: str) -> Iterator[Entry]:
    if (quoted := re.match("'([^']+)'", message)) is not None:
        yield from (entry for keys, entry in _texts(tree, ()) if keys[0] == "scene" and entry.value == quoted[1])
    for found in _NAMED.finditer(message):
        keys = (*_MAPPINGS[found[1]], found[2], *(("interfaces", found[3]) if found[3] else ()))
        entry, followed = find(tree, keys)
        if followed == keys:
            yield entry


def _texts(entry: Entry, keys: Keys) -> Iterator[tuple[Keys, Entry]]:
    if isinstance(entry.value, str):
        yield keys, entry
    for key, item in entry.below():
        yield from _texts(item, (*keys, key))
