"""Bodies as read and proven, before a scene acts on them: what their files and the keys that read them determine."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.config import Pipeline
from cmsreduce.linalg.eigen import only_motions, rigid_body_modes
from cmsreduce.linalg.machine import begun
from cmsreduce.linalg.sparse import share_order
from cmsreduce.mechanics import check_connected, hold_undetermined, rows_alone
from cmsreduce.model import (
    Failure,
    FEModel,
    Finding,
    Proof,
    Scene,
    Units,
    in_units,
)
from cmsreduce.pipeline.bodies.body_health import BodyHealth, body_health
from cmsreduce.pipeline.bodies.free_motions import (
    check_grounded,
    counted_motions,
    geometric_motions,
    held_turning,
    mechanisms,
)
from cmsreduce.pipeline.bodies.from_keys import body_as_read, recovered_body, tied_body
from cmsreduce.pipeline.bodies.mass_proof import negative_mass, prove_mass
from cmsreduce.pipeline.bodies.plausible_units import Material, implausible_units, solid_material
from cmsreduce.pipeline.bodies.scene_ports import scene_ports
from cmsreduce.pipeline.bodies.stiffness_proof import negative_stiffness, prove_stiffness
from cmsreduce.pipeline.bodies.wireframe import cells_of
from cmsreduce.pipeline.evidence import Evidence, evidence_of, statement_of
from cmsreduce.read import MassOrder, RowOrderProof, files_read, prove_row_order, sha256_of, texts_kept

__all__ = ["THOROUGH", "ProvenBody", "hash_of", "matrices_hash", "needs_files", "proven_body"]

THOROUGH = 3000
"""Bodies up to this number of dofs are factorised for their health before every reduction, as `inspect` does."""

# Below this number of dofs a search for mechanisms costs less than the proof that there are none.
_LARGE = 2000
# Above this number of dofs, proofs that take no factor of K come before it, not beside it: memory matters more than
# time.
_BESIDE = 400_000
# Fields of a body that its own constructor fills.
_SOUND = "_sound"
_Gathered = tuple[Evidence, Mapping[str, NDArray[np.int64]] | None]


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
    units = part.units_in(scene.units)
    with texts_kept():
        as_read, unproven, changed, known_order = body_as_read(name, part, units)
        # The rows are proven on the matrices as they are read; ties and units change them.
        proof = RowOrderProof("labelled", remark=unproven) if unproven else prove_row_order(as_read)
        grown, unused = recovered_body(as_read, part)
        converted = in_units(tied_body(grown, part, proof.free), scene.units)
        large = converted.n > _LARGE
        beside = large and as_read.n <= _BESIDE
        geometry = None if part.geometry is None else part.geometry.file
        gathering = begun(partial(_gathered, as_read, geometry, proof, known_order), beside=beside)
    proven = None
    if large:
        # The mass takes the order of the stiffness.
        share_order(converted.K)
    proving_mass = begun(partial(_mass_proven, as_read, converted, gathering, units), beside=beside)
    # One factorisation proves that a large body has stiffness and mass in every motion but its rigid ones.
    if large:
        acting = scene_ports(pipeline, converted, scene).interface
        proven = only_motions(converted.K, geometric_motions(converted), converted.stiffness_rounding, acting)
    named = [label for label, keys in part.interfaces.items() if keys.dofs is not None and keys.tie is None]
    determined = hold_undetermined(converted, named, proven)
    body = determined.body
    if body is not converted:
        large, proven = False, None
    # A mode that no other one excites shares neither stiffness nor mass with them.
    pieces = "" if part.in_modes else check_connected(body, proven)
    rounding = body.stiffness_rounding
    rigid = rigid_body_modes(body.K, body.M, geometric_motions(body), rounding, name, proven, prove=not large)
    check_grounded(body, rigid)
    of_stiffness = negative_stiffness(body, proven)
    checks, proofs = prove_stiffness(as_read, gathering.result()[0], of_stiffness)
    solid, of_mass, (mass_checks, mass_proof) = proving_mass.result()
    negative = {"stiffness": of_stiffness, "mass": of_mass}
    notes = [*changed, *mechanisms(body, rigid), *held_turning(body, rigid)]
    if doubtful := implausible_units(as_read, units, solid):
        notes.append(f"{name}: {doubtful}")
    if proof.status != "proven":
        notes.append(f"{name}: the row order is not proven ({proof.remark or proof.status})")
    alone = rows_alone(body)[1]
    notes += [note for note in (unused, determined.note, pieces, alone and f"{name}: {alone}") if note]
    # A later run, in another folder, draws the elements of these files.
    found = tuple(replace(source, path=str(Path(source.path).absolute())) for source in body.sources)
    parts = {field.name: getattr(body, field.name) for field in fields(body) if field.name != _SOUND}
    counted, uncertain = counted_motions(body, rigid, proof, bool(determined.held))
    notes += [uncertain] if uncertain else []
    every = (*proofs, mass_proof, counted)
    return ProvenBody(
        {**parts, "sources": found},
        determined.motions,
        determined.held,
        determined.lost,
        rigid,
        (*checks, *mass_checks),
        tuple(replace(each, subject=name) for each in every),
        tuple(notes),
        negative,
        body_health(body, rigid, thorough=body.n <= THOROUGH, negative=negative, undetermined=determined.motions),
        matrices_hash(body),
        {},
        as_read=as_read if needs_files(pipeline, name) else None,
    )


def _gathered(as_read: FEModel, geometry: Path | None, rows: RowOrderProof, order: MassOrder | None) -> _Gathered:
    """Evidence for a body, and its cells where no deck states its mass."""
    stated = (None, None) if geometry is None else statement_of(geometry, as_read)
    # A deck with materials says which density is right.
    cells = cells_of(as_read) if stated[0] is None else None
    return evidence_of(as_read, rows, stated, order), cells


def _mass_proven(
    as_read: FEModel, converted: FEModel, gathering: Future[_Gathered], units: Units
) -> tuple[Material | None, int | None, tuple[tuple[Finding, ...], Proof]]:
    """Material of a solid whose deck states none, motions of negative mass, and proof of the mass of a body."""
    evidence, cells = gathering.result()
    solid = None if cells is None else solid_material(as_read, cells, evidence.order)
    negative = negative_mass(converted, as_read)
    density = "" if solid is None else solid.to_compare(units)
    return solid, negative, prove_mass(as_read, converted, evidence, negative, density)


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
