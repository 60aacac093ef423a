"""Draft pipelines from files: matrices by their content, units, places to join, joints, first elastic frequencies."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import scipy.linalg as la

from cmsreduce.config import BodyDraft, Component, body_pipeline, scene_pipeline
from cmsreduce.errors import CmsReduceError, DofMapError, ReadError
from cmsreduce.model import SI, FEModel, Units
from cmsreduce.pipeline.bodies import REDUCED_FILES, damping_health, material_of, plausible_units, reduced_body
from cmsreduce.pipeline.drafts.body_files import bodies_of_files, body_names, deck_beside
from cmsreduce.pipeline.drafts.coincident_nodes import hold, meetings
from cmsreduce.pipeline.drafts.first_mode import QUICK, first_elastic, free_motions, is_held
from cmsreduce.pipeline.drafts.mounts import (
    cells_of,
    joined,
    mounted,
    moving_along,
    proposed_places,
    translations_of,
)
from cmsreduce.read import (
    MatrixSource,
    file_kind,
    prove_row_order,
    read_body,
    superelement_damping,
    superelement_matrices,
)

__all__ = ["Draft", "draft_body", "draft_pipeline"]

_FREE = 6
_REDUCED = ("component", *REDUCED_FILES)
_NO_DECK = "no deck, listing (.f06) or mesh is given, so that the place of no node is known: cmsreduce new {}2 {} {}"


@dataclass(frozen=True)
class Draft:
    """A draft pipeline.

    Parameters
    ----------
    text : str
        Text of the pipeline file.
    warnings : tuple of str
        What does not fit yet, and what the content of the files says against their names.
    """

    text: str
    warnings: tuple[str, ...] = ()


def draft_pipeline(name: str, files: Sequence[Path]) -> Draft:
    """Write a pipeline for one body, or for several that are joined where they meet.

    Parameters
    ----------
    name : str
        Name of the study, and of the body if there is one.
    files : sequence of Path
        Matrices, the decks or meshes they came from and a list of the nodes of their rows, in any order; or the
        ``.asm`` or ``.pch`` of a NASTRAN external superelement, whose matrices are in a file of the same stem.

    Raises
    ------
    ReadError
        If a file is missing, damaged or of no use, or a body lacks a matrix.
    ConfigError
        If the name cannot stand in a file name.
    """
    found = _found(name, files)
    if len(found) == 1:
        body, draft = found[0]
        draft = draft if body is None else mounted(draft, body)
        return Draft(body_pipeline(name, draft), _warnings([draft]))
    drafts = [draft for _, draft in found]
    bodies = {draft.name: body for body, draft in found if body is not None and body.nodes is not None}
    lengths = {draft.name: (Units.parse(draft.units) if draft.units else SI).length for draft in drafts}
    places = {draft.name: proposed_places(draft, bodies[draft.name]) for draft in drafts if draft.name in bodies}
    meeting, apart = meetings(bodies, lengths, places)
    drafts = [joined(draft, bodies.get(draft.name), meeting) for draft in drafts]
    joints = [(f"{one.body}_{other.body}", str(one), str(other)) for one, other in meeting]
    sides = [side for pair in meeting for side in pair]
    held = all(hold(bodies[one], [side for side in sides if side.body == one]) for one in {s.body for s in sides})
    return Draft(scene_pipeline(name, drafts, joints, held), (*_warnings(drafts), *apart))


def draft_body(name: str, files: Sequence[Path]) -> BodyDraft:
    """Describe one body from its files; parameters and errors as of `draft_pipeline`.

    Returns
    -------
    BodyDraft
        With a remark if the files do not fit together. Of several bodies, the first.
    """
    body, draft = _found(name, files)[0]
    return draft if body is None else mounted(draft, body)


def _found(name: str, files: Sequence[Path]) -> list[tuple[FEModel | None, BodyDraft]]:
    """Bodies as far as they can be read, without interfaces."""
    for path in files:
        if path.is_dir():
            raise ReadError(f"{path}: this is a folder; name the files of the body in it")
        if not path.is_file():
            raise ReadError(f"{path}: there is no such file; `ls {path.parent}` shows those that there are")
    already = [path for path in files if file_kind(path).name in _REDUCED]
    if already:
        rest = [path for path in files if path not in already]
        labels = [name] if len(files) == 1 else body_names(already)
        found = [_read_reduced(label, path) for label, path in zip(labels, already, strict=True)]
        return [*found, *(_found(name, rest) if rest else ())]
    superelements = _superelements(files)
    # Files of a superelement belong to it, the matrices too.
    rest = [path for path in files if path.with_suffix("") not in superelements]
    alone = len(superelements) == 1 and not any(file_kind(path).geometry for path in rest)
    labels = [name] if alone else body_names(list(superelements))
    drafts = [
        _superelement(label, rows, files if alone else [path for path in files if path.with_suffix("") == stem])
        for label, (stem, rows) in zip(labels, superelements.items(), strict=True)
    ]
    if not superelements or (rest and not alone):
        drafts += bodies_of_files(name, rest)
    return [_read(draft) for draft in drafts]


def _superelements(files: Sequence[Path]) -> dict[Path, Path]:
    """Stem of every external superelement, and the file with the order of its rows."""
    # Matrices alone may be those of a superelement whose other files lie beside them.
    beside = [path.with_suffix(end) for path in files for end in (".asm", ".pch")] if len(files) == 1 else []
    found: dict[Path, Path] = {}
    for path in (*files, *(path for path in beside if path.is_file())):
        if path.with_suffix("") not in found and file_kind(path).geometry == "superelement":
            found[path.with_suffix("")] = path
    return found


def _superelement(name: str, superelement: Path, files: Sequence[Path]) -> BodyDraft:
    """Draft of an external superelement, whose matrices are given or in a file of the same stem."""
    keys = Component.model_validate({"extseout": superelement})
    assert keys.extseout is not None and keys.stiffness is not None and keys.geometry is not None
    file = next((path for path in files if file_kind(path).matrices), keys.stiffness.file)
    if not (file.is_file() and file_kind(file).matrices):
        raise ReadError(
            f"{superelement}: the matrices of this superelement are missing: there is no {keys.extseout}.op4 or .op2, "
            "and there are no DMIG entries in its punch file; name the file of the matrices beside this one"
        )
    found = superelement_matrices(file)
    stiffness, mass = ((file, source.matrix or "") for source in (found.stiffness, found.mass))
    if file.with_suffix("") != keys.extseout:
        return BodyDraft(name, stiffness, mass, superelement)
    damped = superelement_damping(name, found) != (None, None)
    return BodyDraft(name, stiffness, mass, keys.geometry.file, extseout=keys.extseout, damped=damped)


def _read_reduced(name: str, path: Path) -> tuple[None, BodyDraft]:
    """Draft of a body that is reduced already: its mount is an interface of its file, or its first node."""
    modal = reduced_body(name, path, SI)
    nodes, counts = np.unique(modal.dofs.node, return_counts=True)
    label, face = next(iter(modal.sets.items()), ("", None))
    node = int(nodes[counts.argmax()] if face is None or not face.nodes else face.nodes[0])
    words = f"one of {len(nodes)} nodes" if face is None else "an interface of the file"
    axes = translations_of(modal.dofs, node)
    others = moving_along(modal.dofs, axes)
    at = modal.nodes.xyz[modal.nodes.index(np.append(others, node))]
    stiff = la.eigvalsh(modal.K, modal.M)[int((~modal.K.any(axis=0)).sum()) :]
    return None, BodyDraft(
        name,
        (path, ""),
        (path, ""),
        interfaces=(("mount", f"{{set: {label}}}" if label else f"{{node: {node}}}", words),),
        point=str(node),
        far=int(others[np.linalg.norm(at[:-1] - at[-1], axis=1).argmax()]),
        axes=axes,
        elastic_hz=float(np.sqrt(max(stiff[0], 0.0)) / (2 * np.pi)) if stiff.size else None,
        damped=bool(modal.D.any()) or modal.damping.law != "none",
        reduced=path,
    )


def _read(draft: BodyDraft) -> tuple[FEModel | None, BodyDraft]:
    """The body of a draft, and the draft with its units and first frequency, or a remark."""
    stiffness, mass = (MatrixSource(path, matrix or None) for path, matrix in (draft.stiffness, draft.mass))
    read = partial(read_body, draft.name, stiffness=stiffness, mass=mass, geometry=draft.geometry, rows=draft.rows)
    try:
        try:
            body = read()
        except DofMapError as error:
            body = _held(read, error)
            draft = replace(draft, grounded=True)
        draft = _with_damping(draft, partial(read, grounded=draft.grounded))
        if body.nodes is None:
            return None, _without_places(draft, body)
        draft = replace(_with_units(draft, body), held=is_held(body))
        hz = first_elastic(body)
    except CmsReduceError as error:
        # A file beside the matrices may have what is missing.
        more = f"; {_no_deck(draft)}" if draft.geometry is None and _beside(draft) is not None else ""
        refused = replace(draft, remark=f"{error}{more}")
        # Its places are proposed for the nodes that have rows, to be there when the files are mended.
        with contextlib.suppress(CmsReduceError):
            body = read(rows_trusted=True)
            return (body, refused) if body.nodes is not None else (None, refused)
        with contextlib.suppress(CmsReduceError):
            return None, replace(_without_places(draft, read(geometry=None)), remark=refused.remark)
        return None, refused
    time = Units.parse(draft.units).time if draft.units else 1.0
    return body, replace(draft, elastic_hz=None if hz is None else hz / time)


def _with_damping(draft: BodyDraft, read: Callable[..., FEModel]) -> BodyDraft:
    """The draft; without its damping matrix and with a note if a run would refuse that one."""
    if draft.damping is None:
        return draft
    path, matrix = draft.damping
    try:
        body = read(damping_matrix=MatrixSource(path, matrix))
        if body.nodes is not None and body.n <= QUICK:
            damping_health(body, free_motions(body), reduced=True)
    except CmsReduceError as error:
        note = f"left out: '{matrix}' in {path} is no damping of this body: {error}"
        return replace(draft, damping=None, notes=(*draft.notes, note))
    return draft


def _without_places(draft: BodyDraft, body: FEModel) -> BodyDraft:
    """The draft of a body without geometry: its mount is the node with most dofs, and the last node is the far one."""
    remark = _no_deck(draft)
    nodes, counts = np.unique(body.dofs.node[body.dofs.component > 0], return_counts=True)
    if not nodes.size:
        return replace(draft, remark=remark)
    node = int(nodes[counts.argmax()])
    mount = (("mount", f"{{node: {node}}}", ""),)
    axes = translations_of(body.dofs, node)
    far = int(moving_along(body.dofs, axes).max(initial=node))
    return replace(draft, interfaces=mount, point=str(node), far=far, axes=axes, remark=remark)


def _beside(draft: BodyDraft) -> Path | None:
    return deck_beside([draft.stiffness[0], draft.mass[0]])


def _no_deck(draft: BodyDraft) -> str:
    """Remark that a draft has no deck, with what to type: the deck that lies beside the matrices, if there is one."""
    deck, matrices = _beside(draft), " ".join(dict.fromkeys([str(draft.stiffness[0]), str(draft.mass[0])]))
    return _NO_DECK.format(draft.name, *(("STIFFNESS MASS", "DECK") if deck is None else (matrices, deck)))


def _held(read: Callable[..., FEModel], refused: DofMapError) -> FEModel:
    """The body as one that the ground holds, if the order of its other rows is proven; else the first refusal."""
    try:
        body = read(grounded=True)
        proven = prove_row_order(body).status == "proven"
        # A body that floats is refused for another reason than its supports.
        proven = proven and (body.n > QUICK or free_motions(body).shape[1] < _FREE)
        # Nor is one that resists rotation alone, by a constraint between points apart.
        proven = proven and is_held(body)
    except CmsReduceError:
        proven = False
    if not proven:
        raise refused
    return body


def _with_units(draft: BodyDraft, body: FEModel) -> BodyDraft:
    """The draft with the units that the material shows; without solid elements they are only proposed."""
    material = material_of(body, cells_of(draft))
    if material is None:
        return draft
    units, reason = plausible_units(material)
    sure = units is not None and material.density is not None
    return replace(draft, units=units.name if sure and reason else "", units_remark=reason)  # type: ignore[union-attr]


def _warnings(drafts: Sequence[BodyDraft]) -> tuple[str, ...]:
    said = []
    for draft in drafts:
        said += list(draft.notes)
        if draft.remark:
            said.append(f"the files do not fit together yet: {draft.remark}")
        if draft.units_remark:
            said.append(f"units of '{draft.name}': {draft.units_remark}")
    return tuple(dict.fromkeys(said))
