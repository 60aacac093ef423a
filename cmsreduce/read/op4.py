"""Matrices of NASTRAN OUTPUT4 files, read through pyYeti: printed or binary, dense or sparse, either byte order."""

from __future__ import annotations

import sys
import warnings
from array import array
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module, util
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.read.cards import real_number
from cmsreduce.read.labelled_matrix import LabelledMatrix, StoredMatrix, canonical, mirrored
from cmsreduce.read.library_errors import reading
from cmsreduce.read.op4_layout import FORMS, TYPES, Op4Header, op4_headers

__all__ = ["stored_matrices"]

_SYMMETRIC = 6
# Numbers that are looked through for zeros together: 8 MB, much beside one string and little beside a dense file.
_AT_ONCE = 1_000_000


def stored_matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of an OP4 file.

    Parameters
    ----------
    path : Path
        File of 32 or 64-bit integers, single or double precision, dense, sparse, or sparse with big matrices.

    Returns
    -------
    list of StoredMatrix
        In the order of the file; loading one raises ReadError if a number in it does not parse.

    Raises
    ------
    ReadError
        If the file is truncated or damaged; all of it is walked over first.
    """
    headers = op4_headers(path)
    names = [_pyyeti_name(header.name, k) for k, header in enumerate(headers)]
    return [_stored(path, header, names[k], names[:k].count(names[k])) for k, header in enumerate(headers)]


def _pyyeti_name(name: str, position: int) -> str:
    """What pyYeti calls a matrix: in lower case, and by position where the name is no identifier."""
    lower = name.replace(" ", "").replace("\0", "").lower()
    return lower if lower.isidentifier() else f"m{position}"


def _stored(path: Path, header: Op4Header, pyyeti_name: str, occurrence: int) -> StoredMatrix:
    digits = f", {round(-np.log10(2 * header.rounding))} digits" if header.ascii else ""
    return StoredMatrix(
        header.name or pyyeti_name,
        f"{TYPES[header.type]}{digits}",
        FORMS.get(header.form, f"form {header.form}"),
        lambda: (header.rows, header.cols, None),
        lambda: _load(path, header, pyyeti_name, occurrence),
    )


def _load(path: Path, header: Op4Header, pyyeti_name: str, occurrence: int) -> LabelledMatrix:
    """Read one matrix; ``occurrence`` counts the ones of that name before it."""
    reader = _pyyeti_op4().OP4()
    _collect_strings(reader)
    with reading(path, f"OP4 matrix '{header.name}'"), warnings.catch_warnings():
        # It warns of names that are no Python identifiers; here names are looked up, never made into variables.
        warnings.simplefilter("ignore", RuntimeWarning)
        _, matrices, _, _ = reader.listload(str(path), [pyyeti_name], sparse=True)
        A = matrices[occurrence]
    if header.form == _SYMMETRIC:
        A = mirrored(A)
    return LabelledMatrix(A, header.name or pyyeti_name, path, "op4", header.rounding)


@cache
def _pyyeti_op4() -> Any:
    """Module of pyYeti that reads these files, by itself: its package loads pandas, which takes 25 times as long."""
    whole = "pyyeti.nastran.op4"
    package = util.find_spec("pyyeti")
    places = [] if package is None else package.submodule_search_locations or []
    files = [file for place in places if (file := Path(place, "nastran", "op4.py")).is_file()]
    spec = util.spec_from_file_location("cmsreduce.read.pyyeti_op4", files[0]) if files else None
    if whole in sys.modules or spec is None or spec.loader is None:
        return import_module(whole)
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class _Strings:
    """Strings of numbers down a column, as they come, run on end to end; the zeros of dense files are soon dropped."""

    def __init__(self) -> None:
        self._starts, self._counts, self._columns, self._values = array("q"), array("q"), array("q"), array("d")
        self._kept: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []

    def add(self, row: int, column: int, values: Sequence[float] | NDArray[np.number]) -> None:
        """Take a string that starts at a row, both counted from zero."""
        self._starts.append(row)
        self._counts.append(len(values))
        self._columns.append(column)
        if isinstance(values, np.ndarray):
            self._values.frombytes(values.astype(np.float64).tobytes())
        else:
            # As an array first: one number after the other takes twice as long.
            self._values.extend(array("d", values))
        if len(self._values) >= _AT_ONCE:
            self._drop_zeros()

    def assemble(self, rows: int, columns: int) -> sp.csc_array:
        """Sparse array of all strings."""
        self._drop_zeros()
        row, column, values = (np.concatenate(parts) for parts in zip(*self._kept, strict=True))
        return canonical(row, column, values, (rows, columns))

    def _drop_zeros(self) -> None:
        starts, counts, columns = (np.array(part, np.int64) for part in (self._starts, self._counts, self._columns))
        values = np.array(self._values, np.float64)
        kept = np.flatnonzero(values)
        # Row of the first number of each string, less the place of that number among all.
        ahead = starts - (np.cumsum(counts) - counts)
        string = np.repeat(np.arange(counts.size), counts)[kept]
        self._kept.append((kept + ahead[string], columns[string], values[kept]))
        for part in (self._starts, self._counts, self._columns, self._values):
            del part[:]


def _collect_strings(reader: Any) -> None:
    """Let pyYeti's reader hand over whole strings of numbers.

    Its own lists hold three Python objects for each number, and take the zeros of dense files as entries.
    """
    choose = reader._get_funcs

    def chosen(kind: str, *arguments: Any) -> tuple[Callable[..., Any], tuple[Callable[..., Any], ...]]:
        read, _ = choose(kind, *arguments)
        put = _put_printed if kind == "ascii" else _Strings.add
        return read, (lambda rows, columns: _Strings(), put, lambda rows, columns, found: found.assemble(rows, columns))

    reader._get_funcs = chosen


def _put_printed(found: _Strings, row: int, column: int, text: str, count: int, width: int) -> None:
    """Take a string of printed numbers of one width."""
    numbers = [text[at : at + width] for at in range(0, count * width, width)]
    try:
        found.add(row, column, [float(number) for number in numbers])
    except ValueError:
        # Fortran drops the letter of an exponent of three digits, and may write D for E.
        values = [real_number(number) for number in numbers]
        if None in values:
            bad = numbers[values.index(None)].strip()
            place = f"column {column + 1}, row {row + values.index(None) + 1}"
            raise ValueError(f"'{bad}' in {place} is not a number") from None
        found.add(row, column, [value for value in values if value is not None])
