"""A controller in state space, from a matrix file with A, B, C, D or from text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Controller
from cmsreduce.read.files import is_text, read_head, read_text, require_file
from cmsreduce.read.matrix import matrix_names, read_matrix

__all__ = ["read_controller"]

_LETTERS = ("A", "B", "C", "D")
_MOST_STATES = 5000
_COMMENTS = "#%"
_CONTENTS = (
    "give A (n x n), B (n x sensors), C (actuators x n) and D (actuators x sensors; zero if left out), as variables of "
    "a .mat file or in text: a line with the letter, then the rows"
)

Matrices = dict[str, NDArray[np.float64]]


def read_controller(path: Path, sensors: tuple[str, ...], actuators: tuple[str, ...]) -> Controller:
    """Read a controller whose inputs are the sensors of a scene and whose outputs are its actuators.

    Parameters
    ----------
    path : Path
        Matrix file of any format that names its matrices, or text: a line ``A``, the rows of A, and so on; ``#`` and
        ``%`` start a comment. A gain without states is D alone.
    sensors, actuators : tuple of str
        Channels in order; they give the sizes of the matrices.

    Raises
    ------
    ReadError
        If the file is missing, is no controller, has numbers that are not finite, or does not fit the channels.
    """
    require_file(path)
    head = read_head(path, 4096)
    lines = map(_bare, head.decode("latin-1").splitlines()) if is_text(head) else ()
    text_heading = _heading(next(filter(None, lines), ""))
    found = _from_text(path) if text_heading else _from_matrices(path)
    missing = [letter for letter in ("A", "B", "C") if letter not in found]
    # D alone is a gain without states.
    if missing and ("D" not in found or len(missing) < 3):
        states = "has states but lacks" if "D" in found else "lacks"
        raise ReadError(f"{path}: the controller {states} {', '.join(missing)}; {_CONTENTS}")
    n = found["A"].shape[0] if "A" in found else 0
    shapes = {"A": (n, n), "B": (n, len(sensors)), "C": (len(actuators), n), "D": (len(actuators), len(sensors))}
    for letter in found:
        if not np.isfinite(found[letter]).all():
            raise ReadError(f"{path}: {letter} holds a number that is not finite")
        if found[letter].shape != shapes[letter]:
            rows, cols = found[letter].shape
            expected = " x ".join(map(str, shapes[letter]))
            raise ReadError(
                f"{path}: {letter} is {rows} x {cols}, but must be {expected}: {n} states, inputs are the "
                f"{len(sensors)} sensors ({', '.join(sensors)}), outputs the {len(actuators)} actuators "
                f"({', '.join(actuators)})"
            )
    return Controller(*(found.get(letter, np.zeros(shapes[letter])) for letter in _LETTERS))


def _from_matrices(path: Path) -> Matrices:
    names = {info.name for info in matrix_names(path)}
    chosen = [letter for letter in _LETTERS if letter in names]
    if not chosen:
        there = f"it holds {', '.join(sorted(filter(None, names)))}" if any(names) else "it holds no named matrix"
        raise ReadError(f"{path}: this is no controller, {there}; {_CONTENTS}")
    found = {letter: read_matrix(path, letter, rectangular=True).A for letter in chosen}
    for letter, matrix in found.items():
        # A header may claim rows that the file leaves out; the matrix is made dense here.
        if max(matrix.shape) > _MOST_STATES:
            rows, cols = matrix.shape
            raise ReadError(f"{path}: {letter} is {rows} x {cols}; a controller has {_MOST_STATES} states at most")
    return {letter: matrix.toarray() for letter, matrix in found.items()}


def _from_text(path: Path) -> Matrices:
    rows: dict[str, list[list[float]]] = {}
    letter = ""
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        text = _bare(line)
        if not text:
            continue
        heading = _heading(text)
        if heading:
            if heading in rows:
                raise ReadError(f"{path}, line {number}: {heading} appears twice")
            letter, rows[heading] = heading, []
            continue
        try:
            values = [float(word) for word in text.replace(",", " ").split()]
        except ValueError:
            raise ReadError(f"{path}, line {number}: '{text[:40]}' is no row of numbers; {_CONTENTS}") from None
        if rows[letter] and len(values) != len(rows[letter][0]):
            raise ReadError(
                f"{path}, line {number}: this row of {letter} has {len(values)} numbers, those above have "
                f"{len(rows[letter][0])}"
            )
        rows[letter].append(values)
    return {
        each: np.array(values, dtype=np.float64).reshape(len(values), -1) for each, values in rows.items() if values
    }


def _heading(line: str) -> str:
    """Letter of the matrix that starts after a line; empty for other lines."""
    word = line.rstrip(":=").strip().upper()
    return word if word in _LETTERS else ""


def _bare(line: str) -> str:
    """The line without its comment."""
    for mark in _COMMENTS:
        line = line.partition(mark)[0]
    return line.strip()
