"""YAML as a tree in which each entry has its file and line, for messages."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from cmsreduce.config.yaml_syntax import refuse_syntax
from cmsreduce.errors import ConfigError

__all__ = ["LARGEST_NUMBER", "LARGEST_WHOLE", "Adapt", "Entry", "Location", "Text", "find", "merge", "parse", "plain"]

LARGEST_NUMBER = 1e100
"""Largest number of a pipeline: the square of a length times a mass must not overflow."""
LARGEST_WHOLE = 2**63 - 1
"""Largest whole number: in the arrays of all later stages they have 64 bits."""

_TAG = "tag:yaml.org,2002:"
# Dates and the lone '=' have tags of their own in YAML; a pipeline means the characters.
_TEXT_TAGS = {_TAG + name for name in ("str", "timestamp", "value")}
_NUMBER_TAGS = {_TAG + name for name in ("int", "float", "bool")}
# A pipeline nests about ten levels; the parser and this reader recurse once a level.
_DEEPEST = 50
# Entries after aliases and merges are written out: a few lines with aliases of aliases make billions.
_MOST_ENTRIES = 200_000
# Characters: the parser reads some ten thousand a second, and a pipeline has a few thousand.
_LONGEST_FILE, _LONGEST_SCALAR = 500_000, 2_000
_VERSION = re.compile(r"\s*%YAML[ \t]+(?!1\.2\b)(\S{1,20})")
# Texts that are held with their trees: a sweep reads one pipeline with many overrides.
_HELD = 100


@dataclass(frozen=True)
class Location:
    """Place of an entry in a file or override.

    Parameters
    ----------
    source : str
        File as the user named it, or the override in full.
    line : int, optional
        Line from 1; None for an override.
    folder : Path
        Folder that file names in it are relative to.
    """

    source: str
    line: int | None
    folder: Path

    def __str__(self) -> str:
        return self.source if self.line is None else f"{self.source}:{self.line}"


class Text(str):
    """A text with the folder of its file."""

    folder: Path

    @classmethod
    def at(cls, text: str, folder: Path) -> Text:
        """Text written in a file of this folder."""
        made = cls(text)
        made.folder = folder
        return made


Value = dict[str, "Entry"] | list["Entry"] | str | int | float | bool | None


@dataclass(frozen=True, eq=False)
class Entry:
    """A value and the place of its key.

    Parameters
    ----------
    value : mapping of str to Entry, list of Entry, or scalar
        The value as written.
    where : Location
        Place of the key, or of the item of a list.
    whole : bool
        True if the value replaces a mapping instead of being merged into it.
    empty : bool
        True if nothing is written after the key.
    """

    value: Value
    where: Location
    whole: bool = False
    empty: bool = False

    def below(self) -> Iterable[tuple[str | int, Entry]]:
        """Entries of a mapping or list, each with its key or number."""
        if isinstance(self.value, dict):
            return self.value.items()
        return enumerate(self.value) if isinstance(self.value, list) else ()


Adapt = Callable[[tuple[str, ...], Entry, Entry], Entry]
"""``adapt(keys, base, over)``: the base that a mapping is merged into."""


@lru_cache(maxsize=_HELD)
def parse(text: str, source: str, folder: Path, in_override: bool = False) -> Entry:
    """Read one YAML 1.2 document, without objects or keys given twice.

    Parameters
    ----------
    text : str
        The document.
    source : str
        Name of its file for messages, or the override whose value it is.
    folder : Path
        Folder that file names in it are relative to.
    in_override : bool
        True for the value of an override, which has no lines.

    Raises
    ------
    ConfigError
        Naming file, line, column and what is wrong.
    """
    if not in_override and len(text) > _LONGEST_FILE:
        raise ConfigError(
            f"{source}: the file has {len(text)} characters, a pipeline has {_LONGEST_FILE} at most: large "
            "data belongs in files that the pipeline names"
        )
    if (stated := _VERSION.match(text)) is not None:
        raise ConfigError(
            f"{source}:1: the file says that it is YAML {stated[1]}, in which words such as `y` and `no` and numbers "
            "such as `1:30` and `010` mean something else; a pipeline is YAML 1.2: take the line out"
        )
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer = _ShallowComposer
    try:
        node = yaml.compose(text)
    except MarkedYAMLError as error:
        refuse_syntax(error, text, source, in_override)
    except YAMLError as error:
        raise ConfigError(f"{source}: this is not YAML text: {' '.join(str(error).split())}") from None
    reader = _Reader(yaml, source, folder, in_override)
    where = reader.location(node.start_mark.line if node is not None else 0)
    return Entry(None, where) if node is None else Entry(reader.value(node, "", ()), where)


class _ShallowComposer(Composer):
    """Refuses a document that nests deeper than the parser can recurse."""

    _depth = 0

    def compose_node(self, parent: object, index: object) -> Node:
        self._depth += 1
        if self._depth > _DEEPEST:
            mark = self.parser.peek_event().start_mark
            raise MarkedYAMLError(None, None, f"more than {_DEEPEST} lists or mappings inside each other", mark)
        try:
            found: Node = super().compose_node(parent, index)
            return found
        finally:
            self._depth -= 1


def _named(path: str) -> str:
    """The key of a value; that of an override is in its source."""
    return f"key '{path}'" if path else "the value"


@dataclass
class _Reader:
    """Turns the nodes of one document into entries."""

    yaml: YAML
    source: str
    folder: Path
    in_override: bool
    entries: int = 0

    def location(self, line: int) -> Location:
        return Location(self.source, None if self.in_override else line + 1, self.folder)

    def value(self, node: Node, path: str, above: tuple[int, ...]) -> Value:
        if id(node) in above:
            raise ConfigError(f"{self.location(node.start_mark.line)}: key '{path}' contains itself through an alias")
        self.entries += 1
        # Aliases may nest deeper than the text does.
        if self.entries > _MOST_ENTRIES or len(above) > _DEEPEST:
            raise ConfigError(
                f"{self.location(node.start_mark.line)}: with its aliases and merges written out, the file has more "
                f"than {_MOST_ENTRIES} entries or {_DEEPEST} levels: write fewer aliases of aliases"
            )
        above = (*above, id(node))
        if isinstance(node, MappingNode):
            return self.mapping(node, path, above)
        if isinstance(node, SequenceNode):
            return [
                Entry(self.value(item, f"{path}[{k}]", above), self.location(item.start_mark.line))
                for k, item in enumerate(node.value)
            ]
        return self.scalar(node, path)

    def mapping(self, node: MappingNode, path: str, above: tuple[int, ...]) -> dict[str, Entry]:
        own: dict[str, Entry] = {}
        merged: dict[str, Entry] = {}
        for key, item in node.value:
            where = self.location(key.start_mark.line)
            if not isinstance(key, ScalarNode):
                raise ConfigError(
                    f"{where}: a key of '{path or 'the file'}' is a list or mapping; keys are plain words"
                )
            if key.tag == _TAG + "merge":
                merged = {**merged, **self.merged(item, path, above)}
                continue
            name = str(key.value)
            if len(name) > _LONGEST_SCALAR:
                raise ConfigError(f"{where}: a key of '{path or 'the file'}' has {len(name)} characters")
            inner = f"{path}.{name}" if path else name
            if name in own:
                first = "" if self.in_override else f", first in line {own[name].where.line}"
                raise ConfigError(f"{where}: key '{inner}' is given twice{first}")
            empty = isinstance(item, ScalarNode) and item.tag == _TAG + "null" and not item.value
            if empty and name.replace(".", "").isdigit() and own:
                before = list(own.values())[-1].value
                raise ConfigError(
                    f"{where}: '{path}' has a decimal comma before {name}: numbers have a point, such as "
                    f"{before if isinstance(before, int) else 5}.{name}"
                )
            own[name] = Entry(self.value(item, inner, above), where, empty=empty)
        return {**merged, **own}

    def merged(self, node: Node, path: str, above: tuple[int, ...]) -> dict[str, Entry]:
        sources = node.value if isinstance(node, SequenceNode) else [node]
        found: dict[str, Entry] = {}
        for source in sources:
            if id(source) in above:
                raise ConfigError(f"{self.location(node.start_mark.line)}: '<<' in '{path}' takes in itself")
            if not isinstance(source, MappingNode):
                raise ConfigError(f"{self.location(node.start_mark.line)}: '<<' in '{path}' takes a mapping")
            # The first of several merged mappings wins, by the rule of YAML.
            found = {**self.mapping(source, path, (*above, id(source))), **found}
        return found

    def scalar(self, node: Node, path: str) -> str | int | float | bool | None:
        text = str(node.value)
        if len(text) > _LONGEST_SCALAR and not self.in_override:
            where = self.location(node.start_mark.line)
            raise ConfigError(f"{where}: key '{path}' has {len(text)} characters, {_LONGEST_SCALAR} at most are read")
        if node.tag in _TEXT_TAGS:
            if isinstance(node, ScalarNode) and node.style == '"' and min(text, default=" ") < " ":
                where = self.location(node.start_mark.line)
                raise ConfigError(
                    f"{where}: key '{path}': a backslash in double quotes starts a sign of its own, as in {text!r}: "
                    "write the path with / or in single quotes"
                )
            return Text.at(text, self.folder)
        if node.tag == _TAG + "null":
            return None
        where = self.location(node.start_mark.line)
        if node.tag not in _NUMBER_TAGS:
            tag = str(node.tag).replace(_TAG, "!!")
            raise ConfigError(f"{where}: {_named(path)} has the tag {tag}; a pipeline is plain YAML, without tags")
        try:
            number: int | float | bool = self.yaml.constructor.construct_object(node)
        except (ValueError, YAMLError):
            raise ConfigError(f"{where}: {_named(path)}: '{text}' is not a number") from None
        # No node, count or thread has such a number: where a whole number is expected, it is refused by its key.
        if isinstance(number, int) and abs(number) > LARGEST_WHOLE:
            number = float(number) if abs(number) < sys.float_info.max else math.inf
        if math.isfinite(number) and abs(number) > LARGEST_NUMBER:
            raise ConfigError(f"{where}: {_named(path)}: {number:g} is beyond the largest number, {LARGEST_NUMBER:g}")
        return number


def plain(entry: Entry) -> object:
    """Values without their places; each text keeps its folder."""
    if isinstance(entry.value, dict):
        return {key: plain(item) for key, item in entry.value.items()}
    if isinstance(entry.value, list):
        return [plain(item) for item in entry.value]
    return entry.value


def find(root: Entry, keys: Sequence[str | int]) -> tuple[Entry, tuple[str | int, ...]]:
    """Innermost entry along keys, and the keys on the way to it.

    Keys that are not in the tree are skipped: the validator adds names of its own.
    """
    entry, followed = root, list[str | int]()
    for key in keys:
        below = _below(entry.value, key)
        if below is not None:
            entry = below
            followed.append(key)
    return entry, tuple(followed)


def _below(value: Value, key: str | int) -> Entry | None:
    if isinstance(value, dict) and isinstance(key, str):
        return value.get(key)
    if isinstance(value, list) and isinstance(key, int) and 0 <= key < len(value):
        return value[key]
    return None


def merge(base: Entry, over: Entry, adapt: Adapt, keys: tuple[str, ...] = ()) -> Entry:
    """Deep merge: mappings key by key unless ``over`` is whole, everything else replaced by ``over``.

    An override may name an item of a list by its number, from 0.

    Parameters
    ----------
    base, over : Entry
        ``over`` wins; its keys come after those of ``base``.
    adapt : callable
        Writes out the short form of ``base`` and drops the alternatives that ``over`` replaces.
    keys : tuple of str
        Keys that lead to both in their trees.
    """
    if over.whole or not isinstance(over.value, dict):
        return over
    if isinstance(base.value, list) and over.where.line is None and all(key.isdecimal() for key in over.value):
        return Entry(_merge_items(base.value, over.value, adapt, keys), base.where)
    base = adapt(keys, base, over)
    if not isinstance(base.value, dict):
        return over
    joined = dict(base.value)
    for key, item in over.value.items():
        joined[key] = merge(joined[key], item, adapt, (*keys, key)) if key in joined else item
    # An override has one key. If the mapping lacks others, the message must name the place in the file.
    return Entry(joined, base.where if over.where.line is None else over.where)


def _merge_items(items: list[Entry], over: dict[str, Entry], adapt: Adapt, keys: tuple[str, ...]) -> list[Entry]:
    joined = list(items)
    for key, item in over.items():
        if int(key) >= len(joined):
            path = ".".join(keys)
            raise ConfigError(f"{item.where}: '{path}' has {len(joined)} items, counted from 0: there is no {key}")
        joined[int(key)] = merge(joined[int(key)], item, adapt, (*keys, key))
    return joined
