"""Roles of matrices by their content: which is the stiffness, which is the mass."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.config import BodyDraft
from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable, Nodes, rigid_body_shapes
from cmsreduce.read import (
    FORMATS,
    LOUD,
    QUIET,
    Geometry,
    LabelledMatrix,
    file_kind,
    matrix_names,
    quiet_share,
    read_matrix,
)

__all__ = ["Candidate", "LeftOut", "matrices_of", "stiffness_and_mass"]

_SUFFIXES = {"k": ".sti", "m": ".mas"}
_WORDS = {"k": "stiffness", "m": "mass"}
_DAMPING_NAMES = ("d", "c")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A square matrix, with the evidence for what it is.

    Parameters
    ----------
    matrix : LabelledMatrix
        The matrix (n, n).
    name : str
        Its name in the file; empty if it has none.
    quiet : float
        Share of its rows in which translations cost no force, by the best table of rows.
    massive : bool
        True if no entry of its diagonal is negative, and some are positive.
    """

    matrix: LabelledMatrix
    name: str
    quiet: float
    massive: bool

    @property
    def source(self) -> tuple[Path, str]:
        """File and name."""
        return self.matrix.path, self.name

    @property
    def words(self) -> str:
        """Name and file in words."""
        return f"{self.name} in {self.matrix.path}" if self.name else str(self.matrix.path)

    def moves_all_of(self, stiff: Sequence[Candidate]) -> bool:
        """True if its diagonal is positive in every row of a stiffness; dashpots leave most rows alone."""
        n, mass = self.matrix.A.shape[0], self.matrix.A.diagonal()
        return any(one.matrix.A.shape[0] == n and (mass[one.matrix.A.diagonal() > 0] > 0).all() for one in stiff)

    def called(self, letter: str) -> bool:
        """True if the matrix, or else its file, has the name of a stiffness (k) or of a mass (m)."""
        stem = self.matrix.path.stem.lower()
        file = not self.name and (self.matrix.path.suffix.lower() == _SUFFIXES[letter] or _WORDS[letter][:4] in stem)
        return file or _called(self.name or stem, letter)


@dataclass(frozen=True)
class LeftOut:
    """A variable that is not among the matrices of a body.

    Parameters
    ----------
    words : str
        The reason.
    length : int, optional
        Length of a vector that may be a lumped mass, 0 for another variable that is no matrix: such are of interest
        only where a matrix is missing. None for a matrix.
    """

    words: str
    length: int | None = None


def _called(name: str, letter: str) -> bool:
    # A matrix in a struct of MATLAB has the name of its field.
    return name.lower().rpartition(".")[2].startswith((letter, _WORDS[letter][:4]))


def matrices_of(
    path: Path, rows: Path | None, geometries: Iterable[Geometry]
) -> tuple[list[Candidate], tuple[LeftOut, ...]]:
    """Square matrices of a file, with the evidence that each known table of rows gives.

    Parameters
    ----------
    path : Path
        The file.
    rows : Path, optional
        List of the nodes of its rows.
    geometries : iterable of Geometry
        Decks and meshes that it may belong to.

    Returns
    -------
    matrices : list of Candidate
    left_out : tuple of LeftOut
        Reasons why others, with the name of a stiffness, a mass or a damping, are not among them.

    Raises
    ------
    ReadError
        If its only matrix cannot be read.
    """
    named = FORMATS[file_kind(path).matrices].named
    names: list[str | None] = [None]
    left_out: list[LeftOut] = []
    no_matrix: set[str] = set()
    if named:
        every = matrix_names(path, unusable=True)
        square = [info for info in every if info.rows == info.cols > 0]
        # Programs write scalars as matrices of one row.
        names = [info.name for info in square if info.rows > 1 or len(square) <= 2]
        no_matrix = {
            info.name for info in every if not info.rows and any(_called(info.name, letter) for letter in "km")
        }
        names += sorted(no_matrix)
        left_out += [
            LeftOut(
                f"{path}: '{info.name}' is {info.rows} x {info.cols}; save a lumped mass as a diagonal matrix "
                "(numpy.diag)",
                max(info.rows, info.cols),
            )
            for info in every
            if min(info.rows, info.cols) == 1 < max(info.rows, info.cols) and _called(info.name, "m")
        ]
    found = []
    for each in names:
        try:
            matrix = read_matrix(path, each, dofs=rows)
        except ReadError as error:
            if len(names) == 1:
                raise
            # One of several names in a file, such as a complex matrix of a response.
            if each and (each.lower() in _DAMPING_NAMES or any(_called(each, letter) for letter in "km")):
                left_out.append(LeftOut(str(error), 0 if each in no_matrix else None))
            continue
        if not matrix.A.shape[0]:
            left_out.append(LeftOut(f"{path}: matrix '{matrix.name}' is empty"))
        elif matrix.A.shape[0] == matrix.A.shape[1]:
            tables = [table for one in geometries for table in _translations(matrix, one)]
            shares = [quiet_share(matrix.A, T) for T in tables or _patterns(matrix)]
            diagonal = matrix.A.diagonal()
            massive = bool((diagonal >= 0).all() and (diagonal > 0).any())
            found.append(Candidate(matrix, each or "", max(shares, default=0.0), massive))
    return found, tuple(left_out)


def _translations(matrix: LabelledMatrix, geometry: Geometry) -> list[NDArray[np.float64]]:
    """Translations in the rows of a matrix, for each table of a geometry that it may have."""
    n = matrix.A.shape[0]
    tables = [matrix.dofs] if matrix.dofs is not None else [each for each in geometry.rows.values() if len(each) == n]
    return [_shapes(table, geometry.nodes) for table in tables]


def _shapes(dofs: DofTable, nodes: Nodes | None) -> NDArray[np.float64]:
    if nodes is not None and len(nodes) and (nodes.index(dofs.node[dofs.component > 0]) >= 0).all():
        return rigid_body_shapes(dofs, nodes)[:, :3]
    return np.asarray(dofs.component[:, None] == np.arange(1, 4), dtype=np.float64)


def _patterns(matrix: LabelledMatrix) -> list[NDArray[np.float64]]:
    """Translations where no geometry names the rows: by the labels, or two, three or six dofs at every node."""
    if matrix.dofs is not None:
        return [_shapes(matrix.dofs, None)]
    n = matrix.A.shape[0]
    row, axes = np.arange(n)[:, None], np.arange(3)
    return [np.asarray(row % count == axes, dtype=np.float64) for count in (2, 3, 6) if n % count == 0]


def stiffness_and_mass(
    name: str,
    every: Sequence[Candidate],
    geometry: Geometry | None,
    notes: tuple[str, ...],
    command: str,
    left_out: Sequence[LeftOut] = (),
) -> BodyDraft:
    """Stiffness and mass among the matrices of a body.

    Parameters
    ----------
    name : str
        Name of the body.
    every : sequence of Candidate
        Its matrices.
    geometry : Geometry, optional
        Its deck or mesh.
    notes : tuple of str
        What is known of its files already.
    command : str
        What to type where the content does not tell; it ends a message.
    left_out : sequence of LeftOut
        Reasons why variables with such names are not among them.

    Raises
    ------
    ReadError
        If a matrix is missing, or no matrix is clearly one of the two.
    """
    # Rigid elements do not act yet in matrices of sets that hold dependent dofs. Files that fit no deck are compared
    # all the same: the draft says that they do not fit.
    fitting = (_fitting(every, geometry, dependent) for dependent in (False, True))
    candidates = next(filter(None, fitting), list(every))
    stiff = [one for one in candidates if one.quiet >= QUIET]
    heavy = [one for one in candidates if one.quiet <= LOUD and one.massive]
    if stiff and not heavy:
        # Corners of quadratic triangles have no share of a uniform load: the entries of their rows add up to zero.
        heavy = [one for one in candidates if one.quiet < QUIET and one.massive and one.moves_all_of(stiff)]
    sizes = () if heavy else {one.matrix.A.shape[0] for one in every}
    missed = [one.words for one in left_out if not one.length or one.length in sizes]
    held = ", ".join(one.words for one in every) + "".join(f" (left out: {reason})" for reason in missed)
    if stiff and not heavy and len(stiff) == len(candidates):
        same = _twice(stiff)
        raise ReadError(
            f"no mass among the matrices found: {held}. Translations cost no force in any of them, as in a "
            f"stiffness{same}; name the mass too: {command}"
        )
    if heavy and not stiff and len(heavy) == len(candidates) and not _by_name(heavy):
        raise ReadError(
            f"no stiffness among the matrices found: {held}. Translations cost force in all rows of each, as in a "
            f"mass{_twice(heavy)}; name the stiffness too, and the deck or mesh that both came from: {command}"
        )
    K, M = _pair(stiff, candidates) or (_chosen(stiff or candidates, "k"), _chosen(heavy or candidates, "m"))
    if K is M:
        # Supports or ties in most rows hide what the other matrix is, and leave its name.
        M = next((one for one in candidates if one is not K and one.called("m")), None)
    if K is None or M is None or K is M:
        what = _WORDS["k" if K is None else "m"]
        raise ReadError(
            f"no matrix is clearly the {what}; matrices found: {held}. Their content does not tell, so the name of the "
            f"matrix, or that of its file, should begin with K or M. Name the two alone: {command}"
        )
    notes = (
        *notes,
        *(f"left out: {one.words}" for one in left_out if one.length is None),
        *_rivals(K, stiff or candidates, "k"),
        *_rivals(M, heavy or candidates, "m"),
    )
    if stiff and heavy and K.called("m") and M.called("k"):
        notes = (
            *notes,
            f"the names are exchanged: {K.words} is the stiffness, since a translation costs no force, and {M.words} "
            "is the mass; they are taken by their content",
        )
    shape = None if geometry is None else geometry.path
    return BodyDraft(name, K.source, M.source, shape, notes=notes, damping=_damping(K, every))


def _fitting(every: Sequence[Candidate], geometry: Geometry | None, dependent: bool) -> list[Candidate]:
    """Matrices that have the rows of a set of the deck; of sets with dependent dofs only if these may be there."""
    if geometry is None:
        return list(every)
    m = geometry.sets.get("m")
    tables = [
        table
        for table in geometry.rows.values()
        if dependent or m is None or (table.rows(m.node, m.component) < 0).all()
    ]
    sizes = {len(table) for table in tables}
    return [one for one in every if one.matrix.dofs is not None or one.matrix.A.shape[0] in sizes]


def _damping(K: Candidate, every: Sequence[Candidate]) -> tuple[Path, str] | None:
    """Matrix D, or C, beside K in one file of named matrices."""
    beside = {one.name: one.source for one in every if one.matrix.path == K.matrix.path and one is not K}
    prefix, dot, own = K.name.rpartition(".")
    called = [prefix + dot + case(letter) for letter in _DAMPING_NAMES for case in (str.lower, str.upper)]
    called = called if own.lower() == "k" else []
    return next((beside[name] for name in called if name in beside), None)


def _rivals(chosen: Candidate, found: Sequence[Candidate], letter: str) -> tuple[str, ...]:
    """Note on other matrices with the content and the name of the chosen one."""
    others = ", ".join(one.words for one in found if one is not chosen and one.called(letter))
    if not others:
        return ()
    return (f"taken as the {_WORDS[letter]}: {chosen.words}; by content and name these could be it, too: {others}",)


def _twice(found: Sequence[Candidate]) -> str:
    """Remark that two matrices are one."""
    for k, one in enumerate(found):
        for other in found[:k]:
            A, B = one.matrix.A, other.matrix.A
            if A.shape == B.shape and A.nnz == B.nnz and not abs(A - B).sum():
                return f", and {other.words} has the same numbers as {one.words}"
    return ""


def _by_name(found: Sequence[Candidate]) -> bool:
    return any(one.called("k") for one in found) and any(one.called("m") for one in found)


def _pair(stiff: Sequence[Candidate], every: Sequence[Candidate]) -> tuple[Candidate, Candidate] | None:
    """First stiffness and its mass among matrices of several superelements, which are numbered alike in one file."""
    for K in stiff:
        name, numbered, number = K.name.rpartition("#")
        if numbered and K.called("k"):
            wanted = {f"{letter}{name[1:]}#{number}" for letter in "mM"}
            for M in every:
                same = M.matrix.path == K.matrix.path and M.matrix.A.shape == K.matrix.A.shape
                if M.name in wanted and M.massive and same:
                    return K, M
    return None


def _chosen(found: Sequence[Candidate], letter: str) -> Candidate | None:
    """The only candidate, or the first with the name; the content has left no other difference."""
    if len(found) == 1:
        return found[0]
    return next((one for one in found if one.called(letter)), None)
