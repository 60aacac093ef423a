"""Matrices of any registered format: the format is found by content, the matrix by name."""

from __future__ import annotations

import difflib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable
from cmsreduce.read.ansys import is_row_mapping, mapping_beside, read_row_mapping
from cmsreduce.read.calculix_abaqus import dof_list_beside, read_dof_list
from cmsreduce.read.file_kind import FORMATS, GEOMETRY_FORMATS, HEAD, file_kind, matrix_format
from cmsreduce.read.files import read_head, reading, require_file
from cmsreduce.read.formats import MatrixFormat, MatrixInfo, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, complex_refused
from cmsreduce.read.matrices import HARWELL_BOEING
from cmsreduce.read.nastran import DMIG, OP2

__all__ = ["detect_format", "matrix_names", "read_matrix", "read_rows"]


def detect_format(path: Path) -> str:
    """Find the format of a matrix file from its content; the file's extension does not matter.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    str
        A key of ``FORMATS``. Text 'i j value' is ``calculix`` where its first entries lie in the upper triangle, else
        ``abaqus``; both are read alike.

    Raises
    ------
    ReadError
        If the file is missing, empty, or of no known format.
    """
    require_file(path)
    found = matrix_format(path, read_head(path, HEAD))
    if found is not None:
        return found.name
    kind = file_kind(path)
    if kind.name == "unknown":
        known = ", ".join(f"{format.name} ({format.words})" for format in FORMATS.values())
        hint = f"known are {known}; name one with `format:` if the file is one of them"
        raise ReadError(f"{path}: the file is {kind.words}; {hint}")
    step = GEOMETRY_FORMATS[kind.geometry].matrices if kind.geometry in GEOMETRY_FORMATS else kind.step
    raise ReadError(f"{path}: this is {kind.words}, which holds no matrix" + (f": {step}" if step else ""))


def read_matrix(
    path: Path,
    matrix: str | None = None,
    format: str | None = None,
    dofs: Path | None = None,
    *,
    rectangular: bool = False,
) -> LabelledMatrix:
    """Read one matrix of a file.

    Parameters
    ----------
    path : Path
        The file.
    matrix : str, optional
        Name of the matrix; capitals do not matter unless two names differ in them only. Of several matrices of one
        name, ``KAA#2`` is the second. Not needed where the file holds one matrix.
    format : str, optional
        A key of ``FORMATS``, in place of detection by content.
    dofs : Path, optional
        Dof list, one ``node.component`` a row. By default a text of entries takes the ``.dof`` file of its own stem.
        A matrix that carries labels is put in the order of the list. Or a mapping of ANSYS: the node of each block of
        rows, or that of HBMAT; a matrix of HBMAT with a mapping of its own stem is put in the order of the list.
    rectangular : bool
        Accept a DMIG that is marked rectangular, whose columns are not the dofs of its rows.

    Returns
    -------
    LabelledMatrix
        Both triangles of a symmetric matrix. It may be of any shape, and it may hold entries that are not finite:
        the body refuses them and names the dof.

    Raises
    ------
    ReadError
        If the file is missing, empty, truncated, damaged or of an unknown format; if the matrix is not in it, is
        complex, or is not named where there are several; if the dof list does not fit.
    """
    path = Path(path)
    chosen = _format_of(path, format)
    with reading(path, f"the file ({chosen.words})"):
        found = _choose(path, _numbered(chosen.read(path)), matrix, chosen)
    # In other formats loading shows whether there is an imaginary part.
    if found.numbers.startswith("complex") and chosen is OP2:
        raise complex_refused(path, found.name)
    if chosen is DMIG and found.form == "rectangular" and not rectangular:
        raise ReadError(
            f"{path}: DMIG matrix '{found.name}' is rectangular; stiffness and mass are square (form 1) or symmetric "
            "(form 6): name the matrix of the body, such as KAAX"
        )
    # Not-a-number in single precision warns when it is widened; the body names its dof.
    with reading(path, f"matrix '{found.name}'"), np.errstate(invalid="ignore"):
        loaded = found.load()
    beside = dof_list_beside(path) if chosen.dof_list and loaded.dofs is None else None
    list_path = dofs or beside
    if list_path is None:
        return loaded
    mapped = is_row_mapping(list_path)
    table = read_row_mapping(list_path, loaded.A.shape[0]) if mapped else read_rows(list_path)
    if mapped and chosen is HARWELL_BOEING and (own := mapping_beside(path)) is not None:
        # HBMAT writes a mapping with each matrix; that of another one may have another order.
        loaded = loaded.with_dofs(read_row_mapping(own, loaded.A.shape[0]), own)
    return loaded.with_dofs(table, list_path) if loaded.dofs is None else loaded.on(table)


def matrix_names(path: Path, format: str | None = None, *, unusable: bool = False) -> list[MatrixInfo]:
    """List the matrices of a file.

    Parameters
    ----------
    path : Path
        The file.
    format : str, optional
        A key of ``FORMATS``, in place of detection by content.
    unusable : bool
        List variables that are no matrix of numbers, too; reading one gives the reason.

    Returns
    -------
    list of MatrixInfo
        In the order of the file.

    Raises
    ------
    ReadError
        As ``read_matrix``, for errors that the headers show; the reason if no variable of the file is a matrix.
    """
    path = Path(path)
    chosen = _format_of(path, format)
    with reading(path, f"the file ({chosen.words})"):
        stored = chosen.read(path)
        _refuse_unusable(stored)
        return [one.info for one in _numbered(stored) if one.usable or unusable]


def read_rows(path: Path) -> DofTable:
    """Read the dof list that `rows:` names; a file of another kind is named as what it is.

    Parameters
    ----------
    path : Path
        The file, one node.component a line.

    Raises
    ------
    ReadError
        If the file is missing or empty, is of another kind, a line names no dof, or a dof appears twice.
    """
    try:
        return read_dof_list(path)
    except ReadError as error:
        if not path.is_file() or (kind := file_kind(path)).name in ("dofs", "table", "empty", "unknown"):
            raise
        first = "name it as `geometry:`; " if kind.geometry else ""
        step = f"{first}`rows:` takes a list of node.component, one a line, or a dof set of the deck, such as `a`"
        raise ReadError(f"{path}: this is {kind.words}, not a dof list: {step}") from error


def _format_of(path: Path, name: str | None) -> MatrixFormat:
    """The format that the user names, or the detected one."""
    if name is None:
        return FORMATS[detect_format(path)]
    if name not in FORMATS:
        near = difflib.get_close_matches(name, FORMATS, n=1)
        hint = f"did you mean '{near[0]}'? " if near else ""
        raise ReadError(f"{path}: there is no matrix format '{name}'; {hint}known are {', '.join(FORMATS)}")
    require_file(path)
    return FORMATS[name]


def _numbered(stored: list[StoredMatrix]) -> list[StoredMatrix]:
    """Matrices of one name get their number in it, as in KAA#1 and KAA#2; a file of superelements has one for each."""
    count, seen = Counter(one.name for one in stored), Counter[str]()
    found = []
    for one in stored:
        seen[one.name] += 1
        found.append(one if count[one.name] == 1 else replace(one, name=f"{one.name}#{seen[one.name]}"))
    return found


def _refuse_unusable(stored: list[StoredMatrix]) -> None:
    """Give the reason of the first variable that is no matrix, if a file has such variables alone."""
    if stored and not any(one.usable for one in stored):
        stored[0].load()


def _choose(path: Path, stored: list[StoredMatrix], wanted: str | None, format: MatrixFormat) -> StoredMatrix:
    """The matrix of a name, or the only one; an empty name is none."""
    usable = [one for one in stored if one.usable]
    names = [one.name for one in usable]
    listed = ", ".join(names)
    if not wanted:
        if len(usable) == 1:
            return usable[0]
        if not usable:
            _refuse_unusable(stored)
            raise ReadError(f"{path}: there is no matrix in it ({format.words})")
        raise ReadError(f"{path}: holds {len(usable)} matrices, name one with `matrix:`: {listed}")
    exact = [one for one in stored if one.name == wanted]
    found = exact or [one for one in stored if one.name.lower() == wanted.lower()]
    if len(found) == 1:
        return found[0]
    if len(found) > 1:
        same = ", ".join(one.name for one in found)
        raise ReadError(
            f"{path}: holds {len(found)} matrices whose names differ in capitals only: {same}; name one of them"
        )
    several = [one.info for one in usable if one.name.lower().rpartition("#")[0] == wanted.lower()]
    if several:
        sizes = ", ".join(f"{info.name} ({info.rows} x {info.cols})" for info in several)
        raise ReadError(f"{path}: holds {len(several)} matrices named '{wanted}': name one of {sizes}")
    if not format.named:
        raise ReadError(
            f"{path}: holds one matrix without a name, so there is no '{wanted}' in it; leave `matrix:` out"
        )
    lower = {name.lower(): name for name in names}
    near = difflib.get_close_matches(wanted.lower(), lower, n=1)
    hint = f" (did you mean {lower[near[0]]}?)" if near else ""
    held = f"{listed}: name one of these" if listed else "no matrix"
    raise ReadError(f"{path}: there is no matrix '{wanted}' in it{hint}; it holds {held}")
