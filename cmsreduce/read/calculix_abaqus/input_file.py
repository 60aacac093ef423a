"""Nodes of an Abaqus or CalculiX input file (.inp)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.printed_numbers import printed_rounding

__all__ = ["Block", "is_abaqus_input", "keyword_blocks", "read_abaqus_input"]

_NODE_BLOCK = re.compile(r"^\*(NODE|PART|INSTANCE|HEADING|INCLUDE)\b", re.IGNORECASE | re.MULTILINE)
# Keywords that make, move or turn nodes in ways that are not read; each would give wrong geometry in silence.
_UNREAD = {
    "NGEN": "generated nodes",
    "NFILL": "generated nodes",
    "NCOPY": "copied nodes",
    "NMAP": "mapped nodes",
    "SYSTEM": "node coordinates in a local system",
    "TRANSFORM": "degrees of freedom in a local system",
}
_SAMPLE = 2000


@dataclass
class Block:
    """A keyword with its options and data lines."""

    keyword: str
    options: dict[str, str]
    where: str
    path: Path
    data: list[tuple[int, str]] = field(default_factory=list)


def is_abaqus_input(head: str) -> bool:
    """Whether text from the start of a file looks like an Abaqus or CalculiX input file."""
    return _NODE_BLOCK.search(head) is not None


def read_abaqus_input(path: Path) -> Nodes:
    """Read the nodes of an input file, of its parts, instances and included files.

    Parameters
    ----------
    path : Path
        Input file.

    Returns
    -------
    Nodes
        In order of the file, in basic (the assembly's system), moving along the basic axes.

    Raises
    ------
    ReadError
        If a node repeats with other coordinates (instances that share numbers), nodes are generated, turned or given
        in a local system, or there are none.
    """
    parts: dict[str, dict[int, tuple[float, ...]]] = {}
    nodes: dict[int, tuple[float, ...]] = {}
    target = nodes
    instance: Block | None = None
    for block in keyword_blocks(path, ()):
        if block.keyword in _UNREAD:
            raise ReadError(
                f"{block.where}: {_UNREAD[block.keyword]} are not read; give the geometry as a mesh with plain nodes, "
                "such as a flattened input file or .frd"
            )
        if block.keyword == "PART":
            target = parts.setdefault(block.options.get("NAME", "").upper(), {})
        elif block.keyword == "INSTANCE":
            instance, target = block, dict(parts.get(block.options.get("PART", "").upper(), {}))
        elif block.keyword == "END PART":
            target = nodes
        elif block.keyword == "END INSTANCE" and instance is not None:
            _merge(nodes, _placed(target, instance), instance.where)
            instance, target = None, nodes
        elif block.keyword == "NODE":
            _merge(target, _node_lines(block), block.where)
    if not nodes:
        raise ReadError(f"{path}: there are no nodes in it (no *NODE in the assembly)")
    points = np.array(list(nodes.values()))
    spread = points[:: max(1, len(points) // _SAMPLE)]
    return Nodes.in_basic(list(nodes), points, float(printed_rounding(spread).max()))


def keyword_blocks(path: Path, chain: tuple[Path, ...] = ()) -> Iterator[Block]:
    """Keyword blocks of a file and of the files it includes."""
    if path.resolve() in chain:
        raise ReadError(f"{path} includes itself")
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise ReadError(f"{path}: cannot be read: {error.strerror or error}") from error
    block: Block | None = None
    for number, line in enumerate(lines, start=1):
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        if not line.startswith("*"):
            if block is not None:
                block.data.append((number, line))
            continue
        if block is not None:
            yield block
        head, *rest = (part.strip() for part in line[1:].split(","))
        options = {key.strip().upper(): value.strip() for key, _, value in (part.partition("=") for part in rest)}
        block = Block(" ".join(head.upper().split()), options, f"{path}, line {number}: *{head}", path)
        if block.keyword == "INCLUDE":
            yield from keyword_blocks(path.parent / options.get("INPUT", ""), (*chain, path.resolve()))
            block = None
    if block is not None:
        yield block


def _node_lines(block: Block) -> dict[int, tuple[float, ...]]:
    """Nodes of one *NODE block: id, x, y, z, absent coordinates zero."""
    if block.options.get("SYSTEM", "R").upper()[:1] != "R":
        raise ReadError(f"{block.where}: cylindrical and spherical coordinates are not read; write rectangular ones")
    path, data = block.path, block.data
    if "INPUT" in block.options:
        path = block.path.parent / block.options["INPUT"]
        try:
            data = list(enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1))
        except OSError as error:
            raise ReadError(f"{block.where}: {path} cannot be read: {error.strerror or error}") from error
    out: dict[int, tuple[float, ...]] = {}
    for number, line in data:
        if not line.strip() or line.startswith("**"):
            continue
        fields = [text.strip() for text in line.split(",")]
        try:
            xyz = tuple(float(text.upper().replace("D", "E") or 0) for text in (*fields[1:4], "", "", ""))[:3]
            out[int(fields[0])] = xyz
        except ValueError:
            raise ReadError(f"{path}, line {number}: '{line.strip()}' is no node: id, x, y, z") from None
    return out


def _placed(nodes: dict[int, tuple[float, ...]], instance: Block) -> dict[int, tuple[float, ...]]:
    """Nodes of an instance moved, then turned, by its data lines."""
    try:
        numbers = [[float(text) for text in line.split(",") if text.strip()] for _, line in instance.data]
    except ValueError:
        raise ReadError(f"{instance.where}: its placement is not made of numbers") from None
    if not numbers:
        return nodes
    xyz = np.array(list(nodes.values())).reshape(-1, 3) + (numbers[0] + [0.0, 0.0, 0.0])[:3]
    if len(numbers) > 1:
        if len(numbers[1]) != 7:
            raise ReadError(f"{instance.where}: a rotation needs two points and an angle in degrees, 7 numbers")
        xyz = _turned(xyz, numbers[1])
    return {id: tuple(map(float, row)) for id, row in zip(nodes, xyz, strict=True)}


def _turned(xyz: NDArray[np.float64], rotation: Sequence[float]) -> NDArray[np.float64]:
    """Points turned about the axis through two points (Rodrigues)."""
    start, end = np.array(rotation[:3]), np.array(rotation[3:6])
    axis = (end - start) / np.linalg.norm(end - start)
    angle, arm = np.radians(rotation[6]), xyz - start
    along = (arm @ axis)[:, None] * axis
    turned: NDArray[np.float64] = start + along + np.cos(angle) * (arm - along) + np.sin(angle) * np.cross(axis, arm)
    return turned


def _merge(into: dict[int, tuple[float, ...]], more: dict[int, tuple[float, ...]], where: str) -> None:
    """Add nodes; one id may not stand for two places."""
    for id, xyz in more.items():
        if into.setdefault(id, xyz) != xyz:
            raise ReadError(
                f"{where}: node {id} stands at two places, {into[id]} and {xyz}; where instances share node numbers, "
                "write the model flat (one numbering), then give its geometry and matrices"
            )
