"""Keyword blocks of Abaqus and CalculiX input files, and the node and element sets that they define."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.files import check_included, read_text
from cmsreduce.read.printed_numbers import whole_number

__all__ = [
    "Block",
    "DeckSets",
    "blocks",
    "deck_sets",
    "element_nodes",
    "element_sections",
    "longest_start",
    "preload_step",
]

# Keywords whose data lines may stand in a file of their own.
_OF_FILES = ("NODE", "ELEMENT")
# Ids of one line of a set: a damaged number would fill the memory.
_LONGEST_RANGE = 10**7


@dataclass
class Block:
    """A keyword with its options and its data lines, each with its file and its number there."""

    keyword: str
    options: dict[str, str]
    where: str
    path: Path
    data: list[tuple[Path, int, str]] = field(default_factory=list)

    @property
    def rows(self) -> Iterator[list[str]]:
        """Fields of each data line, without blanks, in capitals."""
        for *_, line in self.data:
            yield [text.strip().upper() for text in line.split(",")]

    def option(self, name: str) -> str:
        """Value of an option in capitals; empty without it."""
        return self.options.get(name, "").upper()


@dataclass(frozen=True)
class DeckSets:
    """Nodes and elements by the name of their set, in capitals; names of Abaqus instances are left out.

    Parameters
    ----------
    nodes, elements : mapping of str to (tuple of int)
        Ids in order of the file, each once.
    topology : mapping of int to (tuple of int)
        Nodes of each element.
    """

    nodes: Mapping[str, tuple[int, ...]]
    elements: Mapping[str, tuple[int, ...]]
    topology: Mapping[int, tuple[int, ...]]

    def nodes_of(self, name: str) -> tuple[int, ...]:
        """Nodes of a set of nodes, or of the elements of a set, or the node itself."""
        if name in self.nodes:
            return self.nodes[name]
        if name in self.elements:
            return tuple(
                dict.fromkeys(node for element in self.elements[name] for node in self.topology.get(element, ()))
            )
        number = whole_number(name)
        return () if number is None else (number,)


def blocks(path: Path, chain: tuple[Path, ...] = ()) -> Iterator[Block]:
    """Keyword blocks of a file and of the files it includes.

    Raises
    ------
    ReadError
        If a file is missing, includes itself, or lies in too many others.
    """
    check_included(path, chain)
    block: Block | None = None
    lines = _lines(path)
    for number, line in lines:
        if not line.startswith("*"):
            if block is not None:
                block.data.append((path, number, line))
            continue
        if block is not None:
            yield block
        head, *rest = (part.strip() for part in line[1:].split(","))
        block = Block(" ".join(head.upper().split()), _options(rest), f"{path}, line {number}: *{head}", path)
        # A keyword line that ends with a comma goes on.
        while line.endswith(","):
            _, line = next(lines, (0, ""))
            block.options |= _options(line.split(","))
        if block.keyword == "INCLUDE":
            yield from blocks(_included(block, (*chain, path)), (*chain, path))
            block = None
        elif block.keyword in _OF_FILES and "INPUT" in block.options:
            beside = _included(block, (*chain, path))
            check_included(beside, (*chain, path))
            block.data += ((beside, number, line) for number, line in _lines(beside))
    if block is not None:
        yield block


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a file with their numbers, without blank ones and comments."""
    lines = ((number, line.strip()) for number, line in enumerate(read_text(path).splitlines(), start=1))
    return ((number, line) for number, line in lines if line and not line.startswith("**"))


def _included(block: Block, chain: tuple[Path, ...]) -> Path:
    """File that a block in the last of a chain of files names: beside that file, or beside the first."""
    name = block.options.get("INPUT", "")
    tried = list(dict.fromkeys(deck.parent / name for deck in (chain[-1], chain[0])))
    if not name:
        raise ReadError(f"{block.where} names no file; write *{block.keyword}, INPUT=FILE")
    # Path.exists raises where a name is too long for any file.
    if (found := next((path for path in tried if os.path.exists(path)), None)) is None:  # noqa: PTH110
        looked = " or ".join(map(str, tried))
        raise ReadError(f"{block.where}: the file '{name}' is missing: there is no {looked}; copy it there")
    return found


def _options(parts: list[str]) -> dict[str, str]:
    pairs = (part.partition("=") for part in parts if part.strip())
    return {" ".join(key.upper().split()): value.strip().strip('"') for key, _, value in pairs}


def preload_step(path: Path) -> str:
    """Place of the *STEP, PERTURBATION of a deck, whose matrices hold the stress of the step before; else empty."""
    try:
        return next((one.where for one in blocks(path) if one.keyword == "STEP" and "PERTURBATION" in one.options), "")
    except (ReadError, OSError):
        # Another reader says what is wrong with the file.
        return ""


def element_nodes(block: Block, count: int) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Id and nodes of each element of an *ELEMENT block, whose data lines continue as the nodes ask for."""
    found = (whole_number(text) for fields in block.rows for text in fields)
    numbers = [number for number in found if number is not None]
    for at in range(0, len(numbers) - count, count + 1):
        yield numbers[at], tuple(numbers[at + 1 : at + 1 + count])


def deck_sets(deck: Sequence[Block], nodes_of_type: Mapping[str, int]) -> DeckSets:
    """Sets of a deck: *NSET, *ELSET, and those that *NODE and *ELEMENT name.

    Parameters
    ----------
    deck : sequence of Block
        The deck.
    nodes_of_type : mapping of str to int
        Number of nodes by the start of an element's name; other elements have no nodes here.
    """
    nodes: dict[str, dict[int, None]] = {}
    elements: dict[str, dict[int, None]] = {}
    topology: dict[int, tuple[int, ...]] = {}
    for block in deck:
        if block.keyword == "NODE" and (name := block.option("NSET")):
            ids = (whole_number(fields[0]) for fields in block.rows)
            nodes.setdefault(name, {}).update(dict.fromkeys(id for id in ids if id is not None))
        elif block.keyword == "ELEMENT":
            known = longest_start(block.option("TYPE"), nodes_of_type)
            found = dict(element_nodes(block, nodes_of_type[known])) if known else {}
            topology |= found
            if name := block.option("ELSET"):
                elements.setdefault(name, {}).update(dict.fromkeys(found))
        elif block.keyword in ("NSET", "ELSET"):
            into = nodes if block.keyword == "NSET" else elements
            members = into.setdefault(block.option(block.keyword), {})
            members.update(dict.fromkeys(_members(block, into)))
            if block.keyword == "NSET" and (name := block.option("ELSET")):
                of = (node for element in elements.get(name, ()) for node in topology.get(element, ()))
                members.update(dict.fromkeys(of))
    return DeckSets(
        {name: tuple(ids) for name, ids in nodes.items()},
        {name: tuple(ids) for name, ids in elements.items()},
        topology,
    )


def _members(block: Block, known: Mapping[str, dict[int, None]]) -> Iterator[int]:
    """Ids of a set: numbers, names of other sets, or ranges with GENERATE."""
    for fields in block.rows:
        # A node of an assembly is written INSTANCE.NUMBER.
        items = [text.strip('"').rpartition(".")[2] for text in fields if text]
        if "GENERATE" in block.options:
            try:
                first, last, step = (*map(int, items), 1)[:3]
            except ValueError:
                raise ReadError(f"{block.where}: '{','.join(fields)}' is no range: first, last, step") from None
            if step < 1:
                raise ReadError(f"{block.where}: the step of a range is {step}; it is 1 or more")
            ids = range(first, (first if len(items) < 2 else last) + 1, step)
            if ids[:_LONGEST_RANGE] != ids:
                raise ReadError(f"{block.where}: '{','.join(fields)}' is a range of more than {_LONGEST_RANGE} ids")
            yield from ids
            continue
        for text in items:
            number = whole_number(text)
            yield from known.get(text, ()) if number is None else (number,)


def element_sections(
    deck: Sequence[Block], sets: DeckSets, keyword: str
) -> tuple[list[Block], NDArray[np.int64], NDArray[np.int64]]:
    """Sections of elements.

    Parameters
    ----------
    deck : sequence of Block
        The deck.
    sets : DeckSets
        Its sets.
    keyword : str
        Of the sections, such as SOLID SECTION.

    Returns
    -------
    sections : list of Block
        Those of this keyword.
    element, section : (e,) int64
        Elements of their sets in order of their numbers, and the position of the section of each; an element of
        several sections is there several times.
    """
    sections = [block for block in deck if block.keyword == keyword]
    members = [sets.elements.get(section.option("ELSET"), ()) for section in sections]
    element = np.array([number for each in members for number in each], dtype=np.int64)
    section = np.repeat(np.arange(len(sections)), [len(each) for each in members])
    order = np.argsort(element, kind="stable")
    return sections, element[order], section[order]


def longest_start(code: str, names: Mapping[str, object]) -> str:
    """The longest of some names that a code starts with: C3D10 is no C3D1, and C3D8R is a C3D8; empty for none."""
    return max((name for name in names if code.startswith(name)), key=len, default="")
