"""Draft pipeline of one body: its matrices, a place where it could be joined, and its first elastic frequency."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.config import BodyDraft
from cmsreduce.errors import CmsReduceError, DofMapError, ReadError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.linalg.sparse import factorise
from cmsreduce.mechanics import hold_undetermined
from cmsreduce.model import FEModel, rigid_body_shapes
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.read import MatrixSource, detect_format, matrix_names, prove_row_order, read_body
from cmsreduce.verify import rigid_motions

__all__ = ["draft_body"]

# A larger body takes more than a minute to factorise; only the run computes its first frequency.
_QUICK = 20_000
_FREE = 6
_AXES = "xyz"


def draft_body(name: str, files: Sequence[Path]) -> BodyDraft:
    """Describe a body from its files, for the draft of a pipeline.

    Parameters
    ----------
    name : str
        Name of the body, for messages.
    files : sequence of Path
        Matrices and the deck or mesh they came from, in any order; or the ``.asm`` of a NASTRAN external superelement.

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
    superelement = next((path for path in files if path.suffix.lower() == ".asm"), None)
    if superelement is not None:
        stem = superelement.with_suffix("")
        return _checked(
            name, BodyDraft((stem.with_suffix(".op4"), "KXX"), (stem.with_suffix(".op4"), "MXX"), extseout=stem)
        )
    # CalculiX writes lists beside its matrices, which are read with them.
    beside = {
        path.with_suffix(suffix) for path in files if path.suffix.lower() == ".sti" for suffix in (".dof", ".12d")
    }
    files = [path for path in files if path not in beside]
    matrices = [(path, info.name) for path in files if _holds_matrices(path) for info in matrix_names(path)]
    shapes = [path for path in files if not _holds_matrices(path)]
    if len(shapes) > 1:
        raise ReadError(f"several decks or meshes: {', '.join(map(str, shapes))}; give the one the matrices came from")
    stiffness, mass = _one(matrices, "stiffness", "k", ".sti"), _one(matrices, "mass", "m", ".mas")
    return _checked(name, BodyDraft(stiffness, mass, shapes[0] if shapes else None))


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
    # Abaqus names its files after the job and the matrix: JOB_STIF1.mtx, JOB_MASS1.mtx.
    by_end = [(path, name) for path, name in matrices if re.search(rf"{what[:4]}\d*$", path.stem, re.IGNORECASE)]
    for found in (by_end, by_name, by_file):
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
    geometry = draft.geometry if draft.extseout is None else draft.extseout.with_suffix(".asm")
    stiffness, mass = (MatrixSource(path, matrix or None) for path, matrix in (draft.stiffness, draft.mass))
    try:
        try:
            body = read_body(name, stiffness=stiffness, mass=mass, geometry=geometry)
        except DofMapError:
            body = _held(name, stiffness, mass, geometry)
            draft = replace(draft, grounded=True)
        if body.nodes is None:
            return replace(draft, remark="no deck or mesh is given, so that no grid can be named for the mount")
        determined = hold_undetermined(body)
        body = determined.body
        draft = replace(draft, **_places(body, ~determined.moved))
        return replace(draft, elastic_hz=_first_elastic(body))
    except CmsReduceError as error:
        return replace(draft, remark=str(error))


def _held(name: str, stiffness: MatrixSource, mass: MatrixSource, geometry: Path | None) -> FEModel:
    """The body as one that the ground holds, if that proves its rows; else the error of a body that floats."""
    try:
        body = read_body(name, stiffness=stiffness, mass=mass, geometry=geometry, grounded=True)
        if prove_row_order(body).status == "proven" and _free_motions(body).shape[1] < _FREE:
            return body
    except CmsReduceError:
        pass
    return read_body(name, stiffness=stiffness, mass=mass, geometry=geometry)


def _places(body: FEModel, moves: NDArray[np.bool_]) -> dict[str, Any]:
    """A place where the body could be joined: the b-set of its deck, or else the first grid with most dofs.

    ``moves`` (n,) is false for rows that move without stiffness and mass.
    """
    assert body.nodes is not None
    b_set = body.sets.get("b", np.empty(0, np.int64))
    chosen = 0 < b_set.size < body.n
    rows = b_set if chosen else np.flatnonzero(moves)
    components = {
        int(node): set(body.dofs.component[rows[body.dofs.node[rows] == node]].tolist())
        for node in dict.fromkeys(body.dofs.node[rows].tolist())
        if node in body.nodes.id
    }
    node = max(components, key=lambda each: len(components[each]))
    axes = [axis for axis, component in zip(_AXES, (1, 2, 3), strict=True) if component in components[node]]
    alike = moves & np.isin(body.dofs.component, [1 + _AXES.index(axis) for axis in axes])
    known, count = np.unique(body.dofs.node[alike], return_counts=True)
    seen = np.flatnonzero(np.isin(body.nodes.id, known[count == len(axes)]))
    away = np.linalg.norm(body.nodes.xyz[seen] - body.nodes.xyz[body.nodes.id == node], axis=1)
    return {
        "interface": "{set: b}" if chosen else f"{{node: {node}}}",
        "node": node,
        "far": int(body.nodes.id[seen[away.argmax()]]),
        "axes": "".join(axes),
    }


def _first_elastic(body: FEModel) -> float | None:
    """First elastic frequency in Hz of a body that is small enough."""
    if body.n > _QUICK:
        return None
    return _beside_rigid_motions(body, _free_motions(body))


def _free_motions(body: FEModel) -> NDArray[np.float64]:
    """Motions without force; none are looked for in a large body."""
    if body.nodes is None or body.n > _QUICK:
        return np.empty((body.n, 0))
    shapes = rigid_body_shapes(body.dofs, body.nodes)
    return rigid_body_modes(body.K, body.M, shapes, body.stiffness_rounding, body.name)


@diagnostic("the first elastic frequency of '{}'", about=lambda body, rigid: body.name)
def _beside_rigid_motions(body: FEModel, rigid: NDArray[np.float64]) -> float | None:
    if rigid.shape[1]:
        return rigid_motions(body, rigid).elastic_hz
    solve = factorise(body.K, what="the stiffness")
    # The softest motion has the largest mass for its stiffness; reduced integration leaves motions without mass.
    inverse = spla.LinearOperator(body.K.shape, solve, dtype=np.float64)
    start = np.random.default_rng(1).standard_normal(body.n)
    softest = spla.eigsh(body.M, 1, body.K, Minv=inverse, which="LA", return_eigenvectors=False, v0=start, tol=1e-6)
    return float(softest[0] ** -0.5) / (2 * np.pi)
