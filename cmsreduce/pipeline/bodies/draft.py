"""Draft pipeline of one body: its matrices, a place where it could be joined, and its first elastic frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.config import BodyDraft, Component
from cmsreduce.errors import CmsReduceError, ReadError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.mechanics import hold_undetermined
from cmsreduce.model import FEModel, rigid_body_shapes
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.read import (
    GEOMETRY_FORMATS,
    MatrixSource,
    detect_format,
    matrix_names,
    read_body,
    read_head,
    superelement_damping,
    superelement_matrices,
)
from cmsreduce.verify import rigid_motions

__all__ = ["draft_body"]

# A larger body takes more than a minute to factorise; only the run computes its first frequency.
_QUICK = 20_000
_FREE = 6
_AXES = "xyz"
_HEAD = 1 << 20  # bytes that tell a superelement from a deck


def draft_body(name: str, files: Sequence[Path]) -> BodyDraft:
    """Describe a body from its files, for the draft of a pipeline.

    Parameters
    ----------
    name : str
        Name of the body, for messages.
    files : sequence of Path
        Matrices and the deck or mesh they came from, in any order; or the ``.asm`` or ``.pch`` of a NASTRAN external
        superelement, whose matrices are in a file of the same stem.

    Returns
    -------
    BodyDraft
        With a remark if the files do not fit together.

    Raises
    ------
    ReadError
        If a file is missing or damaged, or the names do not tell the stiffness from the mass.
    """
    for path in files:
        if not path.is_file():
            raise ReadError(f"{path}: there is no such file")
    with_matrices = [path for path in files if _holds_matrices(path)]
    # Matrices alone may be those of a superelement whose other files lie beside them.
    beside = [path.with_suffix(end) for path in files for end in (".asm", ".pch")] if len(files) == 1 else []
    shown = [*files, *(path for path in beside if path.is_file())]
    superelement = next((path for path in shown if _has_geometry(path, "superelement")), None)
    if superelement is not None:
        keys = Component.model_validate({"extseout": superelement})
        assert keys.extseout is not None and keys.stiffness is not None and keys.geometry is not None
        file = next(iter(with_matrices), keys.stiffness.file)
        if not _holds_matrices(file):
            raise ReadError(
                f"{superelement}: the matrices of this superelement are missing: there is no {keys.extseout}.op4 or "
                ".op2, and there are no DMIG entries in its punch file; name the file of the matrices beside this one"
            )
        found = superelement_matrices(file)
        stiffness, mass = ((file, source.matrix or "") for source in (found.stiffness, found.mass))
        if file.with_suffix("") != keys.extseout:
            return _checked(name, BodyDraft(stiffness, mass, superelement))
        damped = superelement_damping(name, found) != (None, None)
        return _checked(name, BodyDraft(stiffness, mass, keys.geometry.file, keys.extseout, damped=damped))
    square = [(path, info) for path in with_matrices for info in matrix_names(path) if info.rows == info.cols]
    # Programs write scalars as matrices of one row.
    matrices = [(path, info.name) for path, info in square if info.rows > 1 or len(square) == 2]
    # A punch file, or OP2, may have the grids beside the matrices.
    shapes = [path for path in files if path not in with_matrices] or [
        path for path in with_matrices if _has_geometry(path, "bulk") or _has_geometry(path, "op2")
    ]
    if len(shapes) > 1:
        raise ReadError(f"several decks or meshes: {', '.join(map(str, shapes))}; give the one the matrices came from")
    stiffness, mass = _one(matrices, "stiffness", "k", ".sti"), _one(matrices, "mass", "m", ".mas")
    pairs = [(stiffness, mass), *_pairs_after(stiffness, matrices)]
    drafts = (_checked(name, BodyDraft(*pair, shapes[0] if shapes else None)) for pair in pairs)
    first = next(drafts)
    return first if not first.remark else next((draft for draft in drafts if not draft.remark), first)


def _pairs_after(
    stiffness: tuple[Path, str], matrices: Sequence[tuple[Path, str]]
) -> Iterator[tuple[tuple[Path, str], tuple[Path, str]]]:
    """The pairs KAA#2 and MAA#2, and so on, of a file that holds those of several superelements."""
    path, (stem, _, number) = stiffness[0], stiffness[1].partition("#")
    for k in range(int(number or 0) + 1, len(matrices) if number else 0):
        pair = (path, f"{stem}#{k}"), (path, f"M{stem[1:]}#{k}")
        if set(pair) <= set(matrices):
            yield pair


def _has_geometry(path: Path, format: str) -> bool:
    head = read_head(path, _HEAD, str(path)).decode("latin-1")
    return GEOMETRY_FORMATS[format].detect(head)


def _holds_matrices(path: Path) -> bool:
    try:
        detect_format(path)
    except ReadError:
        return False
    return True


def _one(matrices: Sequence[tuple[Path, str]], what: str, letter: str, suffix: str) -> tuple[Path, str]:
    """The matrix whose own name, or the name of its file, begins with the letter."""

    def named(text: str) -> bool:
        return text.lower().startswith((letter, what[:4]))

    by_name = [(path, name) for path, name in matrices if named(name)]
    by_file = [(path, name) for path, name in matrices if path.suffix.lower() == suffix or named(path.stem)]
    for found in (by_name, by_file):
        if len(found) == 1:
            return found[0]
    if len(by_name) > 1:
        return by_name[0]
    held = ", ".join(f"{name or '(unnamed)'} in {path}" for path, name in matrices) or "none"
    raise ReadError(
        f"no matrix is clearly the {what}: its name, or that of its file, should begin with {letter.upper()}; "
        f"matrices found: {held}. `cmsreduce new NAME` without files writes a start to fill in by hand"
    )


def _checked(name: str, draft: BodyDraft) -> BodyDraft:
    stiffness, mass = (MatrixSource(path, matrix or None) for path, matrix in (draft.stiffness, draft.mass))
    try:
        body = read_body(name, stiffness=stiffness, mass=mass, geometry=draft.geometry)
        if body.nodes is None:
            remark = "no deck, listing (.f06) or mesh is given, so that the place of no node is known"
            return replace(draft, **_places(body), remark=remark)
        draft = replace(draft, **_places(body))
        return replace(draft, elastic_hz=_first_elastic(body))
    except CmsReduceError as error:
        return replace(draft, remark=str(error))


def _places(body: FEModel) -> dict[str, Any]:
    """A place where the body could be joined: the b-set of its deck, or else the first grid with most dofs."""
    b_set = body.sets.get("b", np.empty(0, np.int64))
    chosen = 0 < b_set.size < body.n
    rows = b_set if chosen else np.arange(body.n)
    components = {
        int(node): set(body.dofs.component[rows[body.dofs.node[rows] == node]].tolist())
        for node in dict.fromkeys(body.dofs.node[rows].tolist())
        if body.nodes is None or node in body.nodes.id
    }
    node = max(components, key=lambda each: len(components[each]))
    axes = [axis for axis, component in zip(_AXES, (1, 2, 3), strict=True) if component in components[node]]
    far = body.dofs.node[body.dofs.component == 1 + _AXES.index(axes[0])]
    away = np.arange(far.size, dtype=np.float64)
    if body.nodes is not None:
        far = far[body.nodes.index(far) >= 0]
        at = body.nodes.xyz[body.nodes.index(far)]
        away = np.linalg.norm(at - body.nodes.xyz[body.nodes.id == node], axis=1)
    return {
        "interface": "{set: b}" if chosen else f"{{node: {node}}}",
        "node": node,
        "far": int(far[away.argmax()]),
        "axes": "".join(axes),
    }


def _first_elastic(body: FEModel) -> float | None:
    """First elastic frequency in Hz of a body that floats and is small enough."""
    if body.n > _QUICK:
        return None
    # The run holds what nothing moves, such as the directions that a boundary grid does not have.
    body = hold_undetermined(body).body
    assert body.nodes is not None
    shapes = rigid_body_shapes(body.dofs, body.nodes)
    if rigid_body_modes(body.K, body.M, shapes, body.stiffness_rounding, body.name).shape[1] != _FREE:
        return None
    return _beside_rigid_motions(body, shapes)


@diagnostic("the first elastic frequency of '{}'", about=lambda body, shapes: body.name)
def _beside_rigid_motions(body: FEModel, shapes: NDArray[np.float64]) -> float | None:
    return rigid_motions(body, shapes).elastic_hz
