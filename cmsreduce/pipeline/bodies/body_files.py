"""Files of bodies, sorted by content: which matrix is the stiffness, which is the mass, and of which deck."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
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
    FileKind,
    Geometry,
    LabelledMatrix,
    file_kind,
    matrix_names,
    quiet_share,
    read_geometry,
    read_matrix,
    sha256_of,
)

__all__ = ["bodies_of_files", "body_names", "deck_beside"]

_SUFFIXES = {"k": ".sti", "m": ".mas"}
# An input file of CalculiX has more than its results; what else has nodes comes in alphabetical order.
_SUFFIXES_OF_DECKS = (".inp", ".bdf", ".dat", ".nas")
_WORDS = {"k": "stiffness", "m": "mass"}


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A square matrix, with the evidence for what it is."""

    matrix: LabelledMatrix
    name: str
    quiet: float
    massive: bool

    @property
    def source(self) -> tuple[Path, str]:
        return self.matrix.path, self.name

    @property
    def words(self) -> str:
        return f"{self.name} in {self.matrix.path}" if self.name else str(self.matrix.path)

    def called(self, letter: str) -> bool:
        """True if the matrix, or else its file, has the name of a stiffness (k) or of a mass (m)."""
        stem = self.matrix.path.stem.lower()
        # A matrix in a struct of MATLAB has the name of its field.
        name = self.name.lower().rpartition(".")[2] or stem
        file = not self.name and (self.matrix.path.suffix.lower() == _SUFFIXES[letter] or _WORDS[letter][:4] in stem)
        return file or name.startswith((letter, _WORDS[letter][:4]))


def bodies_of_files(name: str, files: Sequence[Path]) -> list[BodyDraft]:
    """Sort files into bodies, one for each deck or mesh.

    Parameters
    ----------
    name : str
        Name of the body if there is one, for messages too.
    files : sequence of Path
        Matrices, decks and meshes. The files of several bodies stand together on the command line, or have the same
        stem, or fit one deck only.

    Returns
    -------
    list of BodyDraft
        With its files, and notes on what their content says against their names.

    Raises
    ------
    ReadError
        If a file is missing, damaged or of no use, or a body lacks a matrix; the message ends with what to type.
    """
    kinds = _kinds(files)
    every_shape = [path for path, kind in kinds.items() if kind.geometry]
    # A deck says more than the tables of an OP2 file beside it.
    every_shape = [path for path in every_shape if kinds[path].geometry != "op2"] or every_shape
    sources = [path for path, kind in kinds.items() if kind.matrices and not (kind.geometry and _has_others(kinds))]
    shapes, notes = _each_once(every_shape)
    stems = {path.stem.lower() for path in sources}
    if len(shapes) < len(every_shape) and {path.stem.lower() for path in every_shape} <= stems:
        # Bodies of one mesh, each with matrices of its own.
        shapes, notes = every_shape, ()
    rows = _rows(kinds, len(shapes))
    geometries = {path: read_geometry(path) for path in shapes}
    matrices = {path: _matrices(path, rows, geometries.values()) for path in sources}
    command = f"cmsreduce new {name} STIFFNESS MASS DECK"
    if not any(matrices.values()):
        given = ", ".join(f"{path} ({kind.words})" for path, kind in kinds.items())
        raise ReadError(f"no square matrix in the files given: {given}; name the stiffness and the mass: {command}")
    if len(shapes) < 2:
        every, copies = _each_once(sources)
        shape = geometries[shapes[0]] if shapes else None
        own = [one for path in every for one in matrices[path]]
        return [replace(_body(name, own, shape, notes + copies, command), rows=rows)]
    owners = {path: _owner(path, matrices[path], geometries, list(kinds)) for path in sources}
    bodies = []
    for path, label in zip(shapes, body_names(shapes), strict=True):
        every, copies = _each_once([source for source in sources if owners[source] == path])
        if not every:
            others = ", ".join(map(str, shapes))
            raise ReadError(
                f"{path}: no matrices are given for this deck (decks: {others}); name the matrices of each body before "
                f"its deck: cmsreduce new {name} K1 M1 DECK1 K2 M2 DECK2"
            )
        own = [one for source in every for one in matrices[source]]
        bodies.append(_body(label, own, geometries[path], notes + copies, command))
        notes = ()
    return bodies


def deck_beside(matrices: Sequence[Path]) -> Path | None:
    """Deck or mesh of the stem of some matrices, in their folder; None if there is none."""
    for path in matrices:
        beside = sorted(path.parent.glob(f"{glob.escape(path.stem)}.*"), key=_deck_first)
        for other in beside:
            if other not in matrices and other.is_file() and file_kind(other).geometry:
                return other
    return None


def _deck_first(path: Path) -> tuple[bool, str]:
    return path.suffix.lower() not in _SUFFIXES_OF_DECKS, path.name


def _kinds(files: Sequence[Path]) -> dict[Path, FileKind]:
    """Kind of every file that is of use."""
    kinds: dict[Path, FileKind] = {}
    # CalculiX writes lists beside its matrices, which are read with them.
    beside = {path.with_suffix(end) for path in files if path.suffix.lower() == ".sti" for end in (".dof", ".12d")}
    files = [path for path in files if path not in beside]
    for path in files:
        kind = file_kind(path)
        # A dof list is found beside its matrix.
        if kind.name == "dofs":
            continue
        if kind.name == "rows":
            kinds[path] = kind
            continue
        if not (kind.matrices or kind.geometry):
            # Some meshes have no mark, and one is told by reading it.
            if kind.name != "unknown":
                said = kind.step or f"`cmsreduce inspect {path}` shows what is in it"
                raise ReadError(f"{path}: this is {kind.words}, which holds no matrix and no nodes: {said}")
            read_geometry(path)
            kind = FileKind("mesh", kind.words, "", "mesh")
        kinds[path] = kind
    return kinds


def _each_once(paths: Sequence[Path]) -> tuple[list[Path], tuple[str, ...]]:
    """Files of one body without copies, and a note on each copy."""
    first: dict[str, Path] = {}
    notes = []
    for path in paths:
        if (same := first.setdefault(sha256_of(path), path)) != path:
            notes.append(f"{path} has the same content as {same}, and is left out")
    return list(first.values()), tuple(notes)


def _rows(kinds: Mapping[Path, FileKind], decks: int) -> Path | None:
    """The list of the nodes of the rows, which holds for both matrices of the only body."""
    # HBMAT writes the same list beside each matrix.
    found, _ = _each_once([path for path, kind in kinds.items() if kind.name == "rows"])
    if len(found) > 1 or (found and decks > 1):
        raise ReadError(
            f"{', '.join(map(str, found))}: a list of the nodes of rows holds for the matrices of one body; draft each "
            "body by itself: cmsreduce new NAME STIFFNESS MASS DECK ROWS"
        )
    return next(iter(found), None)


def _has_others(kinds: Mapping[Path, FileKind]) -> bool:
    """True if matrices are in files of their own, so that those in a deck are loads or elements."""
    return any(kind.matrices and not kind.geometry for kind in kinds.values())


def _matrices(path: Path, rows: Path | None, geometries: Iterable[Geometry]) -> list[_Candidate]:
    """Square matrices of a file, with the evidence that each known table of rows gives."""
    named = FORMATS[file_kind(path).matrices].named
    names: list[str | None] = [None]
    if named:
        square = [info for info in matrix_names(path) if info.rows == info.cols > 0]
        # Programs write scalars as matrices of one row.
        names = [info.name for info in square if info.rows > 1 or len(square) <= 2]
    found = []
    for each in names:
        try:
            matrix = read_matrix(path, each, dofs=rows)
        except ReadError:
            if len(names) == 1:
                raise
            # One of several names in a file, such as a complex matrix of a response.
            continue
        if matrix.A.shape[0] == matrix.A.shape[1]:
            tables = [table for one in geometries for table in _translations(matrix, one)]
            shares = [quiet_share(matrix.A, T) for T in tables or _patterns(matrix)]
            diagonal = matrix.A.diagonal()
            massive = bool((diagonal >= 0).all() and (diagonal > 0).any())
            found.append(_Candidate(matrix, each or "", max(shares, default=0.0), massive))
    return found


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
    """Translations where no geometry names the rows: by the labels, or three or six dofs at every node."""
    if matrix.dofs is not None:
        return [_shapes(matrix.dofs, None)]
    n = matrix.A.shape[0]
    row, axes = np.arange(n)[:, None], np.arange(3)
    return [np.asarray(row % count == axes, dtype=np.float64) for count in (3, 6) if n % count == 0]


def _owner(path: Path, own: Sequence[_Candidate], geometries: Mapping[Path, Geometry], order: Sequence[Path]) -> Path:
    """Deck of a file of matrices: of its stem, the only one that it fits, or the next one on the command line."""
    stem = [shape for shape in geometries if shape.stem.lower() == path.stem.lower()]
    fits = [shape for shape, geometry in geometries.items() if any(_fits(one.matrix, geometry) for one in own)]
    for found in (stem, fits):
        if len(found) == 1:
            return found[0]
    shapes, at = list(geometries), order.index(path)
    after = [shape for shape in shapes if order.index(shape) > at]
    before = [shape for shape in shapes if order.index(shape) <= at]
    # Where decks come first, each is followed by its matrices.
    return before[-1] if order[0] in geometries and before else after[0] if after else before[-1]


def _fits(matrix: LabelledMatrix, geometry: Geometry) -> bool:
    if matrix.dofs is not None:
        known = geometry.nodes.index(matrix.dofs.node[matrix.dofs.component > 0])
        return bool(known.size and (known >= 0).all())
    return any(len(table) == matrix.A.shape[0] for table in geometry.rows.values())


def body_names(shapes: Sequence[Path]) -> list[str]:
    """Names of bodies from the stems of their files, each once."""
    labels: list[str] = []
    for path in shapes:
        base = re.sub(r"[^A-Za-z0-9_-]+", "_", path.stem).strip("-") or "body"
        base = f"{base}_body" if base.lower() == "system" else base
        labels.append(next(name for k in range(len(shapes)) if (name := f"{base}{k + 1 if k else ''}") not in labels))
    return labels


def _body(
    name: str, every: Sequence[_Candidate], geometry: Geometry | None, notes: tuple[str, ...], command: str
) -> BodyDraft:
    """Stiffness and mass among the matrices of a body."""
    sizes = [len(table) for table in geometry.rows.values()] if geometry is not None else []
    fitting = [
        one for one in every if geometry is None or one.matrix.dofs is not None or one.matrix.A.shape[0] in sizes
    ]
    # Files that fit no deck are compared all the same: the draft says that they do not fit.
    candidates = fitting or list(every)
    stiff = [one for one in candidates if one.quiet >= QUIET]
    heavy = [one for one in candidates if one.quiet <= LOUD and one.massive]
    held = ", ".join(one.words for one in every)
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
    if K is None or M is None or K is M:
        what = _WORDS["k" if K is None else "m"]
        raise ReadError(
            f"no matrix is clearly the {what}; matrices found: {held}. Their content does not tell, so the name of the "
            f"matrix, or that of its file, should begin with K or M. Name the two alone: {command}"
        )
    notes = (*notes, *_rivals(K, stiff or candidates, "k"), *_rivals(M, heavy or candidates, "m"))
    if stiff and heavy and K.called("m") and M.called("k"):
        notes = (
            *notes,
            f"the names are exchanged: {K.words} is the stiffness, since a translation costs no force, and {M.words} "
            "is the mass; they are taken by their content",
        )
    shape = None if geometry is None else geometry.path
    return BodyDraft(name, K.source, M.source, shape, notes=notes, damping=_damping(K, every))


def _damping(K: _Candidate, every: Sequence[_Candidate]) -> tuple[Path, str] | None:
    """Matrix D, or C, beside K in one file of named matrices."""
    beside = {one.name: one.source for one in every if one.matrix.path == K.matrix.path and one is not K}
    prefix, dot, own = K.name.rpartition(".")
    called = [prefix + dot + letter for letter in "dDcC"] if own.lower() == "k" else []
    return next((beside[name] for name in called if name in beside), None)


def _rivals(chosen: _Candidate, found: Sequence[_Candidate], letter: str) -> tuple[str, ...]:
    """Note on other matrices with the content and the name of the chosen one."""
    others = ", ".join(one.words for one in found if one is not chosen and one.called(letter))
    if not others:
        return ()
    return (f"taken as the {_WORDS[letter]}: {chosen.words}; by content and name these could be it, too: {others}",)


def _twice(found: Sequence[_Candidate]) -> str:
    """Remark that two matrices are one."""
    for k, one in enumerate(found):
        for other in found[:k]:
            A, B = one.matrix.A, other.matrix.A
            if A.shape == B.shape and A.nnz == B.nnz and not abs(A - B).sum():
                return f", and {other.words} has the same numbers as {one.words}"
    return ""


def _by_name(found: Sequence[_Candidate]) -> bool:
    return any(one.called("k") for one in found) and any(one.called("m") for one in found)


def _pair(stiff: Sequence[_Candidate], every: Sequence[_Candidate]) -> tuple[_Candidate, _Candidate] | None:
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


def _chosen(found: Sequence[_Candidate], letter: str) -> _Candidate | None:
    """The only candidate, or the first with the name; the content has left no other difference."""
    if len(found) == 1:
        return found[0]
    return next((one for one in found if one.called(letter)), None)
