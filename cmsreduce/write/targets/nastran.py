"""NASTRAN: a reduced body as a superelement of OP4 matrices, DMIG entries, and a deck of its interface grids."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import SCALAR
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.files import atomic_path, of_one_stem, put_lines
from cmsreduce.write.targets.superelement import Superelement, superelement

__all__ = ["NASTRAN_MARK", "entries", "nastran_files", "write_nastran"]

NASTRAN_MARK = "$ Superelement of "
"""Beginning of the deck."""

_LARGE = 9.9999999995e99  # its exponent has three digits in print
_SYMMETRIC = 6  # form of a matrix in OP4 and DMIG
_LARGEST_ID = 99_999_999  # eight digits, a field of a card
# Axes that differ from the basic ones by less are the basic ones: round-off of products.
_BASIC = 1e-12

_MATRICES = {"K": "KAA", "M": "MAA", "D": "BAA", "loss": "K4AA"}
_DMIG = {"KAA": "K2GG", "MAA": "M2GG", "BAA": "B2GG", "K4AA": "K42GG"}
"""Case control that adds each matrix to the model."""


def nastran_files(path: Path) -> tuple[Path, ...]:
    """Matrices, DMIG entries and deck of one stem."""
    return of_one_stem(path, ".op4", ".pch", ".bdf")


def write_nastran(path: Path, component: ComponentFile) -> tuple[Path, ...]:
    """Write a body as a superelement for NASTRAN: ``.op4``, ``.pch`` and ``.bdf`` of one stem.

    Rows are the interface dofs by node and component, each in its node's displacement frame, then one scalar point for
    each mode with the interfaces held. The OP4 file (binary, double precision) is exact; DMIG entries have ten digits.

    Parameters
    ----------
    path : Path
        Name of the files without its suffix; each file is complete or absent.
    component : ComponentFile
        The body.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    WriteError
        If the body has no interfaces or too few modes to move them, or a file cannot be written.
    """
    from pyyeti.nastran import op4

    body = superelement(component)
    points = _scalar_points(component, body)
    matrices = {name: getattr(body, letter) for letter, name in _MATRICES.items() if getattr(body, letter) is not None}
    labels = [*zip(body.interface.node.tolist(), body.interface.component.tolist(), strict=True)]
    labels += [(point, SCALAR) for point in points]
    exact, punch, deck = nastran_files(path)
    # First the file with the mark: if the process is killed, the next one knows the others as its own.
    put_lines(deck, _cards(component, body, points, list(matrices), punch.name))
    with atomic_path(exact) as temporary:
        op4.write(str(temporary), matrices, forms=dict.fromkeys(matrices, _SYMMETRIC))
    put_lines(punch, entries(matrices, labels))
    return exact, punch, deck


def _scalar_points(component: ComponentFile, body: Superelement) -> list[int]:
    first = int(body.interface.node.max()) + 1
    if first + body.omega.size - 1 > _LARGEST_ID:
        raise WriteError(
            f"component '{component.name}': node {first - 1} leaves no ids of eight digits for {body.omega.size} "
            "scalar points; number its interface nodes lower"
        )
    return list(range(first, first + body.omega.size))


def entries(matrices: Mapping[str, NDArray[np.float64]], labels: list[tuple[int, int]]) -> Iterator[str]:
    """DMIG cards of wide fields, lower triangles column by column; a label is a node and a component."""
    for name, matrix in matrices.items():
        yield f"DMIG    {name:<8}{0:8d}{6:8d}{2:8d}{0:8d}"
        for column, (node, component) in enumerate(labels):
            rows = [row for row in range(column, len(labels)) if matrix[row, column] != 0]
            if rows:
                yield f"DMIG*   {name:<16}{node:16d}{component:16d}"
            for row in rows:
                yield f"*       {labels[row][0]:16d}{labels[row][1]:16d}{_double(matrix[row, column])}"


def _double(value: float) -> str:
    return _wide(value).replace("E", "D")


def _wide(value: float) -> str:
    """Sixteen characters, a field of a card; numbers below 1e-99 are zero, and from 1e100 on nine digits remain."""
    return f"{value:16.8E}" if abs(value) > _LARGE else f"{value if abs(value) > 1e-99 else 0.0:16.9E}"


def _cards(
    component: ComponentFile, body: Superelement, points: list[int], matrices: list[str], punch: str
) -> Iterator[str]:
    """Interface grids with their frames, scalar points, and the sets that order the rows."""
    node, parts = body.interface.node, body.interface.component
    yield f"{NASTRAN_MARK}{component.name}: {len(body.interface)} interface dofs, {len(points)} modal coordinates"
    yield f"$ Units {component.units.name}"
    yield f"$ To use it, include {punch} in the bulk data and ask in case control for:"
    for name in matrices:
        yield f"$   {_DMIG[name]} = {name}"
    for point, omega in zip(points, body.omega, strict=True):
        yield f"$ {point}: {omega / (2 * np.pi):.6g} Hz with the interfaces held"
    yield "BEGIN BULK"
    grids = np.unique(node[parts != SCALAR])
    for number, grid in enumerate(grids, 1):
        yield from _grid(component, int(grid), number)
    for point in [*np.unique(node[parts == SCALAR]).tolist(), *points]:
        yield f"SPOINT  {point:8d}"
    for grid in grids:
        digits = "".join(str(part) for part in parts[node == grid])
        yield f"ASET1   {digits:>8}{grid:8d}"
    for point in [*np.unique(node[parts == SCALAR]).tolist(), *points]:
        yield f"ASET1   {0:8d}{point:8d}"
    yield "ENDDATA"


def _grid(component: ComponentFile, grid: int, number: int) -> Iterator[str]:
    """A grid in basic coordinates, with a frame of its own if its displacement axes are not the basic ones."""
    at = int(np.flatnonzero(component.arrays["nodes/id"] == grid)[0])
    xyz, axes = component.arrays["nodes/xyz"][at], component.arrays["nodes/frame"][at]
    own = abs(axes - np.eye(3)).max() > _BASIC
    if own:
        points = np.concatenate([np.zeros(3), axes[2], axes[0]])
        fields = "".join(_wide(value) for value in points)
        yield f"CORD2R* {number:16d}{0:16d}{fields[:32]}"
        for start in range(32, len(fields), 64):
            yield f"*       {fields[start : start + 64]}"
    x, y, z = (_wide(value) for value in xyz)
    yield f"GRID*   {grid:16d}{0:16d}{x}{y}"
    yield f"*       {z}{number if own else 0:16d}"
