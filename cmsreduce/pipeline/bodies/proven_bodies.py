"""Bodies as read and proven, before a scene acts on them: what their files and the keys that read them determine."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.config import Pipeline
from cmsreduce.errors import DofMapError
from cmsreduce.linalg.eigen import DEPENDENT, only_motions, rigid_body_modes
from cmsreduce.mechanics import check_connected, hold_undetermined, rows_alone
from cmsreduce.model import ARITHMETIC, DofTable, Failure, FEModel, Finding, Proof, Scene, in_units, rigid_body_shapes
from cmsreduce.pipeline.bodies.body_health import BodyHealth, body_health
from cmsreduce.pipeline.bodies.body_proofs import definite, prove_body
from cmsreduce.pipeline.bodies.from_keys import body_as_read, recovered_body, tied_body
from cmsreduce.pipeline.bodies.plausible_units import implausible_units, solid_material
from cmsreduce.pipeline.bodies.scene_ports import scene_ports
from cmsreduce.pipeline.bodies.wireframe import cells_of
from cmsreduce.pipeline.evidence import statement_of
from cmsreduce.read import RowOrderProof, files_read, prove_mass_order, prove_row_order, sha256_of, texts_kept
from cmsreduce.verify import rigid_motions_proof

__all__ = ["THOROUGH", "ProvenBody", "hash_of", "matrices_hash", "needs_files", "proven_body"]

THOROUGH = 3000
"""Bodies up to this number of dofs are factorised for their health before every reduction, as `inspect` does."""

# Below this number of dofs a search for mechanisms costs less than the proof that there are none.
_LARGE = 2000
# Share of a unit translation outside the motions that K leaves free, up to which K leaves it free, too.
_AT_REST = 1e-6
# Of the kinetic energy of a motion: more than this beside the rigid motions of the geometry is another motion.
_OTHER = 1e-3
_FREE = 6
# Fields of a body that its own constructor fills.
_SOUND = "_sound"


@dataclass(frozen=True, eq=False)
class ProvenBody:
    """A body as read and proven, in the scene's units and with its ties.

    Parameters
    ----------
    parts : mapping of str to object
        Fields of the body, an `FEModel`.
    undetermined, held, lost
        As in `Determined`.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    checks : tuple of Finding
        Checks of the files.
    proofs : tuple of Proof
        Facts about the body with their state, proven or not.
    notes : tuple of str
        Facts that could not be proven.
    negative : mapping of ``stiffness`` and ``mass`` to int or None
        Motions of negative energy, where they are counted.
    health : BodyHealth
        Health of the matrices and of the geometry; without factorisations if the body is large.
    matrices : str
        Hash of matrices and nodes.
    files : mapping of str to str
        Absolute path and hash of every file that was read.
    failures : tuple of Failure
        Diagnostics that failed.
    as_read : FEModel, optional
        The body as its files have it, where matrices of the scene refer to its rows.
    """

    parts: Mapping[str, Any]
    undetermined: sp.csc_array
    held: tuple[str, ...]
    lost: tuple[tuple[str, tuple[str, ...]], ...]
    rigid: NDArray[np.float64]
    checks: tuple[Finding, ...]
    proofs: tuple[Proof, ...]
    notes: tuple[str, ...]
    negative: Mapping[str, int | None]
    health: BodyHealth
    matrices: str
    files: Mapping[str, str]
    failures: tuple[Failure, ...] = ()
    as_read: FEModel | None = None

    @cached_property
    def body(self) -> FEModel:
        """The body; its matrices were checked when it was read."""
        sound = tuple(A for A in (self.parts["K"], self.parts["M"], self.parts["D"]) if A is not None)
        return FEModel(**self.parts, _sound=sound)

    @property
    def outdated(self) -> bool:
        """True if the proof has to be made anew: a diagnostic failed, or a file that a deck includes has changed."""
        return bool(self.failures) or any(
            not Path(path).is_file() or sha256_of(Path(path)) != found for path, found in self.files.items()
        )


def proven_body(pipeline: Pipeline, name: str, scene: Scene) -> ProvenBody:
    """Read a flexible body of a pipeline, prove its rows, and convert it to the scene's units.

    Parameters
    ----------
    pipeline : Pipeline
        The pipeline.
    name : str
        Name of the component.
    scene : Scene
        The scene that the body is for.

    Raises
    ------
    CmsReduceError
        As `read_body` does.
    """
    with files_read() as files:
        found = _proven(pipeline, name, scene)
    return replace(found, files={str(path): files[path] for path in sorted(files)})


def _proven(pipeline: Pipeline, name: str, scene: Scene) -> ProvenBody:
    part = pipeline.components[name]
    geometry = None if part.geometry is None else part.geometry.file
    with texts_kept():
        as_read, unproven, changed, known_order = body_as_read(name, part, part.units_in(scene.units))
        stated = (None, None) if geometry is None else statement_of(geometry, as_read)
        # A deck with materials says which density is right.
        cells = cells_of(as_read) if stated[0] is None else None
    # The rows are proven on the matrices as they are read; ties and units change them.
    proof, order = prove_row_order(as_read), known_order or prove_mass_order(as_read)
    if unproven:
        proof = RowOrderProof("labelled", remark=unproven)
    free = proof.status == "proven" and proof.motions == _FREE
    grown, unused = recovered_body(as_read, part)
    tied = tied_body(grown, part, free)
    converted = in_units(tied, scene.units)
    # One factorisation proves that a large body has stiffness and mass in every motion but its rigid ones.
    large = converted.n > _LARGE
    proven = None
    if large:
        acting = scene_ports(pipeline, converted, scene).interface
        proven = only_motions(converted.K, _rigid_shapes(converted), converted.stiffness_rounding, acting)
    named = [label for label, keys in part.interfaces.items() if keys.dofs is not None and keys.tie is None]
    determined = hold_undetermined(converted, named, proven)
    body = determined.body
    if body is not converted:
        large, proven = False, None
    # A mode that no other one excites shares neither stiffness nor mass with them.
    pieces = "" if part.in_modes else check_connected(body, proven)
    rounding = body.stiffness_rounding
    rigid = rigid_body_modes(body.K, body.M, _rigid_shapes(body), rounding, name, proven, prove=not large)
    _check_grounded(body, rigid)
    negative = definite(body, proven, as_read)
    units = part.units_in(scene.units)
    solid = None if cells is None else solid_material(as_read, cells, order)
    density = "" if solid is None else solid.to_compare(units)
    proved = prove_body(as_read, converted, stated, proof, order, negative, density)
    notes = [*changed, *_mechanisms(body, rigid), *_held_turning(body, rigid)]
    if doubtful := implausible_units(as_read, units, solid):
        notes.append(f"{name}: {doubtful}")
    if proof.status != "proven":
        notes.append(f"{name}: the row order is not proven ({proof.remark or proof.status})")
    alone = rows_alone(body)[1]
    notes += [note for note in (unused, determined.note, pieces, alone and f"{name}: {alone}") if note]
    # A later run, in another folder, draws the elements of these files.
    found = tuple(replace(source, path=str(Path(source.path).absolute())) for source in body.sources)
    parts = {field.name: getattr(body, field.name) for field in fields(body) if field.name != _SOUND}
    counted, uncertain = _counted_motions(body, rigid, proof, bool(determined.held))
    notes += [uncertain] if uncertain else []
    every = (*proved.proofs, counted)
    return ProvenBody(
        {**parts, "sources": found},
        determined.motions,
        determined.held,
        determined.lost,
        rigid,
        proved.checks,
        tuple(replace(each, subject=name) for each in every),
        tuple(notes),
        negative,
        body_health(body, rigid, thorough=body.n <= THOROUGH, negative=negative, undetermined=determined.motions),
        matrices_hash(body),
        {},
        as_read=as_read if needs_files(pipeline, name) else None,
    )


def needs_files(pipeline: Pipeline, name: str) -> bool:
    """True if matrices of the scene, or wheels, refer to the rows of a body as its files have them."""
    part, parameters = pipeline.components[name], pipeline.scene.parameters.values()
    own = part.geometric_stiffness is not None or part.gyroscopic is not None or bool(part.wheels)
    return own or any(name in matrices for keys in parameters for matrices in keys.matrices().values())


def matrices_hash(body: FEModel) -> str:
    """Hash of matrices, dofs, nodes and rounding of a body."""
    arrays: list[NDArray[Any]] = [body.dofs.node, body.dofs.component, np.array([body.rounding, body.noise])]
    for A in (body.K, body.M, body.D):
        if A is not None:
            arrays += [A.indptr, A.indices, A.data]
    if body.second_order is not None:
        arrays += [body.second_order.r_phi, body.second_order.phi_phi]
    if body.nodes is not None:
        arrays += [body.nodes.id, body.nodes.xyz, body.nodes.frame]
    return hash_of(b"", arrays)


def hash_of(label: bytes, arrays: Iterable[NDArray[Any]]) -> str:
    """Hash of some arrays with their shapes and types."""
    digest = hashlib.sha256(label)
    for array in arrays:
        digest.update(str((array.shape, array.dtype.str)).encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _counted_motions(body: FEModel, rigid: NDArray[np.float64], rows: RowOrderProof, held: bool) -> tuple[Proof, str]:
    """Proof of the number of rigid motions, and a note where it has none; ``held`` if dofs that nothing moves are."""
    shown = None
    if rows.status == "proven" and rows.motions:
        # Rows along a plane or a line do not show all six.
        shown = min(rows.motions, _shown_motions(body))
        # A dof that is held because nothing moves it may take a rigid motion with it, as the spin of a straight bar.
        if held and rigid.shape[1] < shown:
            shown = None
    counted = rigid_motions_proof(body, rigid.shape[1], shown)
    if shown is not None or counted.state != "unproven":
        return counted, ""
    more = "" if body.nodes is not None else ", or give `geometry:`"
    return counted, (
        f"{body.name}: {counted.remark} to {counted.digits:.0f} digits; if the body is held, these are its softest "
        f"modes, which are lost: write the stiffness in double precision{more}"
    )


def _check_grounded(body: FEModel, rigid: NDArray[np.float64]) -> None:
    """Refuse a body that is declared grounded and has as many motions without force as a free one."""
    few = " the file has too few digits for its softest motions, or" if body.stiffness_rounding > ARITHMETIC else ""
    if body.grounded and 0 < _shown_motions(body) <= rigid.shape[1]:
        raise DofMapError(
            f"body '{body.name}': `grounded: true` says that the ground holds the body, but its stiffness has "
            f"{rigid.shape[1]} motions without force, as a free body has, and they are not the rigid motions of the "
            f"geometry. Likely cause:{few} its rows are shuffled or of another set. "
            f"{'Write the stiffness in double precision, or give' if few else 'Give'} the order of the rows as a list "
            "of node.component under `rows:`, and remove `grounded: true` if nothing holds the body"
        )


def _mechanisms(body: FEModel, rigid: NDArray[np.float64]) -> list[str]:
    """Note on motions without energy that are no rigid motions of the geometry."""
    # Constraints that hold only what has no stiffness leave the motions of the geometry free.
    whole, shapes = _shown_motions(body), _rigid_shapes(body)
    if shapes is None or not whole or not rigid.shape[1]:
        return []
    momentum = body.rigid_momentum
    others = rigid - shapes @ np.linalg.lstsq(shapes.T @ momentum, momentum.T @ rigid)[0]
    # The modes are orthonormal in mass.
    count = int((np.linalg.eigvalsh(others.T @ (body.M @ others)) > _OTHER).sum())
    if not count:
        return []
    kept = f"beyond the {whole} rigid ones" if rigid.shape[1] > whole else "that are no rigid motions of the body"
    return [
        f"{body.name}: K leaves {count} motions without energy {kept}: a hinge or release inside the body. If it has "
        "none, elements are missing, or the file has too few digits for its softest motions, as for a thin plate"
    ]


def _held_turning(body: FEModel, rigid: NDArray[np.float64]) -> list[str]:
    """Note on a body that is declared grounded, and resists rotation alone, as no support does."""
    if not body.grounded or body.nodes is None or not rigid.shape[1]:
        return []
    # Supports of all nodes across a plane resist rotation out of it, which would move rows that there are not.
    absent = np.setdiff1d((1, 2, 3), body.dofs.component)
    ids = np.unique(body.dofs.node[(body.dofs.component > 0) & (body.dofs.component <= 3)])
    dofs = DofTable(np.repeat(ids, absent.size), np.tile(absent, ids.size).astype(np.int8))
    size = np.repeat([1.0, float(np.ptp(body.nodes.xyz, axis=0).max()) or 1.0], 3)
    across, shapes = rigid_body_shapes(dofs, body.nodes, body.nodes.xyz.mean(axis=0)) / size, body.rigid_shapes
    inside = la.null_space(np.linalg.qr(np.vstack([np.zeros((6, 6)), across]), mode="r"), rcond=_AT_REST)
    if rigid.shape[1] >= _rank(shapes / size @ inside):
        return []
    translations = shapes[:, :3]
    resisted = translations - rigid @ (rigid.T @ (body.M @ translations))
    if abs(resisted).max() > _AT_REST:
        return []
    return [
        f"{body.name}: its stiffness resists rotation of the whole body and no translation, as no support does: a "
        "spring or a constraint (MPC, *EQUATION) joins points that do not coincide, and keeps the body from "
        "turning. Join points at one place, or by a rigid element, and write the matrices again"
    ]


def _rigid_shapes(body: FEModel) -> NDArray[np.float64] | None:
    return None if body.nodes is None else body.rigid_shapes


def _shown_motions(body: FEModel) -> int:
    """Rigid motions that move the rows of a body in different ways; 0 without coordinates."""
    shapes = _rigid_shapes(body)
    if shapes is None:
        return 0
    return _rank(shapes)


def _rank(shapes: NDArray[np.float64]) -> int:
    """Number of shapes (n, k) that are independent of each other."""
    lengths = np.linalg.norm(shapes, axis=0)
    return int(np.linalg.matrix_rank(shapes / np.where(lengths > 0, lengths, 1.0), DEPENDENT))
