"""Files of bodies, sorted by content: the matrices of each deck or mesh."""

from __future__ import annotations

import glob
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cmsreduce.config import BodyDraft
from cmsreduce.errors import ReadError
from cmsreduce.pipeline.drafts.matrix_roles import Candidate, matrices_of, stiffness_and_mass
from cmsreduce.read import (
    FORMATS,
    GEOMETRY_FORMATS,
    FileKind,
    Geometry,
    LabelledMatrix,
    file_kind,
    read_geometry,
    read_rows,
    read_unmarked,
    sha256_of,
)

__all__ = ["bodies_of_files", "body_names", "deck_beside"]

# An input file of CalculiX has more than its results; what else has nodes comes in alphabetical order.
_SUFFIXES_OF_DECKS = (".inp", ".bdf", ".dat", ".nas", ".fem")


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
    kinds, useless = _kinds(files)
    read = _read(kinds, useless)
    if not useless:
        return _bodies(name, kinds, read)
    # JOB.* names logs and results beside the deck; a file of another name may be the deck of a body.
    stems = {path.stem.lower() for path, kind in kinds.items() if kind.geometry}
    for path, _, error in useless:
        if path.stem.lower() not in stems:
            raise error
    left_out = tuple(f"left out: {words}" for _, words, _ in useless)
    try:
        found = _bodies(name, kinds, read)
    except ReadError as error:
        # The body may lack one of these files.
        raise ReadError(f"{error} ({'; '.join(left_out)})") from error
    return [replace(found[0], notes=(*found[0].notes, *left_out)), *found[1:]]


def _bodies(name: str, kinds: Mapping[Path, FileKind], read: Mapping[Path, Geometry]) -> list[BodyDraft]:
    """Bodies of files of use, some of which are read."""
    every_shape = _with_nodes(kinds)
    sources = [path for path, kind in kinds.items() if kind.matrices and not (kind.geometry and _has_others(kinds))]
    shapes, notes = _each_once(every_shape)
    stems = {path.stem.lower() for path in sources}
    if len(shapes) < len(every_shape) and {path.stem.lower() for path in every_shape} <= stems:
        # Bodies of one mesh, each with matrices of its own.
        shapes, notes = every_shape, ()
    lists = _lists(kinds, shapes)
    rows = lists[None]
    if rows is not None and kinds[rows].name == "dofs":
        # A broken list is refused once, and not with each matrix of a file.
        read_rows(rows)
    geometries = {path: read[path] if path in read else read_geometry(path) for path in shapes}
    found = {path: matrices_of(path, rows, geometries.values()) for path in sources}
    matrices = {path: own for path, (own, _) in found.items()}
    command = f"cmsreduce new {name} STIFFNESS MASS DECK"
    if not any(matrices.values()):
        reasons = [one.words for _, each in found.values() for one in each if not one.length]
        given = ", ".join(f"{path} ({kind.words})" for path, kind in kinds.items())
        given += "".join(f" (left out: {reason})" for reason in reasons)
        known = (GEOMETRY_FORMATS[kind.geometry] for kind in kinds.values() if kind.geometry in GEOMETRY_FORMATS)
        written = "".join(
            f". {words[0].upper()}{words[1:]}" for words in dict.fromkeys(each.matrices for each in known)
        )
        raise ReadError(
            f"no square matrix in the files given: {given}; name the stiffness and the mass: {command}{written}"
        )
    if len(shapes) < 2:
        every, copies = _each_once(sources)
        shape = geometries[shapes[0]] if shapes else None
        own = [one for path in every for one in matrices[path]]
        left_out = [reason for path in every for reason in found[path][1]]
        return [replace(stiffness_and_mass(name, own, shape, notes + copies, command, left_out), rows=rows)]
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
        left_out = [reason for source in every for reason in found[source][1]]
        body = stiffness_and_mass(label, own, geometries[path], notes + copies, command, left_out)
        bodies.append(replace(body, rows=lists[path]))
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


def _with_nodes(kinds: Mapping[Path, FileKind]) -> list[Path]:
    """Files that give the nodes: a deck says more than the tables of an OP2 file."""
    found = [path for path, kind in kinds.items() if kind.geometry]
    return [path for path in found if kinds[path].geometry != "op2"] or found


def _read(kinds: dict[Path, FileKind], useless: list[tuple[Path, str, ReadError]]) -> dict[Path, Geometry]:
    """Nodes of the files that count and have nothing else; those that cannot be read go to the files without a use.

    Raises
    ------
    ReadError
        If a deck cannot be read: a result of its name may be of another job.
    """
    read: dict[Path, Geometry] = {}
    while unread := [path for path in _with_nodes(kinds) if not kinds[path].matrices and path not in read]:
        for path in unread:
            try:
                read[path] = read_unmarked(path, kinds[path])
            except ReadError as error:
                kind = kinds.pop(path)
                if kind.name == "unknown":
                    useless.append((path, f"{path}, {kind.words}", error))
                elif _is_deck(path, kind):
                    raise
                else:
                    useless.insert(0, (path, str(error), error))
    for path in [path for path in _with_nodes(kinds) if kinds[path].matrices]:
        try:
            read[path] = read_geometry(path)
        except ReadError:
            # A punch file may stand between BEGIN BULK and ENDDATA.
            if not any(kind.geometry for other, kind in kinds.items() if other != path):
                raise
            kinds[path] = replace(kinds[path], geometry="")
    return read


def _is_deck(path: Path, kind: FileKind) -> bool:
    return path.suffix.lower() in _SUFFIXES_OF_DECKS and kind.name != "unknown"


def _kinds(files: Sequence[Path]) -> tuple[dict[Path, FileKind], list[tuple[Path, str, ReadError]]]:
    """Kind of every file of use by its first bytes, and files without a use, with words for a note and a refusal."""
    kinds: dict[Path, FileKind] = {}
    useless: list[tuple[Path, str, ReadError]] = []
    # CalculiX writes lists beside its matrices, which are read with them.
    beside = {path.with_suffix(end) for path in files if path.suffix.lower() == ".sti" for end in (".dof", ".12d")}
    files = [path for path in files if path not in beside]
    for path in files:
        kind = file_kind(path)
        if kind.name == "dofs" and any(_has_list(one, path) for one in files):
            continue
        if kind.name in ("dofs", "rows"):
            kinds[path] = kind
            continue
        if not (kind.matrices or kind.geometry):
            said = kind.step or f"`cmsreduce inspect {path}` shows what is in it"
            error = ReadError(f"{path}: this is {kind.words}, which holds no matrix and no nodes: {said}")
            # Some meshes have no mark, and one is told by reading it.
            if kind.name != "unknown":
                useless.append((path, f"{path}, {kind.words}", error))
                continue
            kind = FileKind("unknown", kind.words, "", "mesh", kind.step)
        kinds[path] = kind
    # A deck says more than a result or a mesh of its name, which is not read.
    decks = {path.with_suffix(""): path for path, kind in kinds.items() if kind.geometry and _is_deck(path, kind)}
    for path, kind in [*kinds.items()]:
        deck = decks.get(path.with_suffix(""))
        if deck is not None and kind.geometry and not kind.matrices and not _is_deck(path, kind):
            useless.append((path, f"{path}, {kind.words}", ReadError(f"{path}: {deck} counts in its place")))
            del kinds[path]
    return kinds, useless


def _has_list(path: Path, rows: Path) -> bool:
    """True if the reader of a matrix finds a dof list by itself: a text of entries has one of its own stem."""
    kind = file_kind(path).matrices if path.with_suffix("") == rows.with_suffix("") else ""
    return bool(kind) and FORMATS[kind].dof_list


def _each_once(paths: Sequence[Path]) -> tuple[list[Path], tuple[str, ...]]:
    """Files of one body without copies, and a note on each copy."""
    first: dict[str, Path] = {}
    notes = []
    for path in paths:
        if (same := first.setdefault(sha256_of(path), path)) != path:
            notes.append(f"{path} has the same content as {same}, and is left out")
    return list(first.values()), tuple(notes)


def _lists(kinds: Mapping[Path, FileKind], decks: Sequence[Path]) -> dict[Path | None, Path | None]:
    """The list of the rows of each deck of several, which has its stem, and that of the only body."""
    # HBMAT writes the same list beside each matrix.
    found, _ = _each_once([path for path, kind in kinds.items() if kind.name in ("dofs", "rows")])
    several = len(decks) > 1
    own: dict[Path | None, Path | None]
    own = {deck: next((one for one in found if one.stem == deck.stem), None) if several else None for deck in decks}
    rest = [path for path in found if path not in own.values()]
    if len(rest) > (not several):
        raise ReadError(
            f"{', '.join(map(str, rest))}: a list of rows holds for the matrices of one body; draft each body by "
            "itself, cmsreduce new NAME STIFFNESS MASS DECK ROWS, or give each list the name of a deck"
        )
    return {**own, None: next(iter(rest), None)}


def _has_others(kinds: Mapping[Path, FileKind]) -> bool:
    """True if matrices are in files of their own, so that those in a deck are loads or elements."""
    return any(kind.matrices and not kind.geometry for kind in kinds.values())


def _owner(path: Path, own: Sequence[Candidate], geometries: Mapping[Path, Geometry], order: Sequence[Path]) -> Path:
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
