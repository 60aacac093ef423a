"""Bodies of a pipeline: from the body as its files have it to a body in the scene's units, proven."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble import Ports, body_points, body_ports, modal_substructure, physical_substructure
from cmsreduce.config import Pipeline
from cmsreduce.errors import DofMapError
from cmsreduce.linalg.eigen import DEPENDENT, only_motions, rigid_body_modes
from cmsreduce.linalg.sparse import motions_held
from cmsreduce.mechanics import Determined, check_connected, hold_undetermined
from cmsreduce.model import (
    Damping,
    FEModel,
    Finding,
    GeometricStiffness,
    ModalComponent,
    Proof,
    Scene,
    Substructure,
    in_units,
    rigid_body_shapes,
)
from cmsreduce.pipeline.bodies.body_damping import DampingHealth, damping_health
from cmsreduce.pipeline.bodies.body_health import BodyHealth, body_health
from cmsreduce.pipeline.bodies.body_proofs import definite, prove_body
from cmsreduce.pipeline.bodies.from_keys import body_as_read, recovered_body, tied_body
from cmsreduce.pipeline.bodies.parameters import body_corners, body_terms
from cmsreduce.pipeline.bodies.stiffening import body_stiffening
from cmsreduce.read import (
    RowOrderProof,
    prove_mass_order,
    prove_row_order,
)
from cmsreduce.verify import rigid_motions_proof

__all__ = ["FlexibleBody", "copy_of", "probing_loads", "read_flexible"]

# Bodies up to this number of dofs are factorised for their health before every reduction, as `inspect` does.
_THOROUGH = 3000
# Below this number of dofs a search for mechanisms costs less than the proof that there are none.
_LARGE = 2000
_FREE = 6


@dataclass(frozen=True, eq=False)
class FlexibleBody:
    """A body as read and checked, with the points where the scene acts on it.

    Parameters
    ----------
    body : FEModel
        In the scene's units.
    ports : Ports
        Inputs and outputs of the scene on the body.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    checks : tuple of Finding
        Checks of the files.
    notes : tuple of str
        Facts that could not be proven.
    stiffening : GeometricStiffness, optional
        Geometric stiffness of the body, if the pipeline asks for it.
    proofs : tuple of Proof
        Facts about the body with their state, proven or not.
    negative : mapping of ``stiffness`` and ``mass`` to int or None, optional
        Motions of negative energy, where they are counted.
    damping : DampingHealth, optional
        Findings on its damping matrix, if it has one.
    determined : Determined, optional
        The body with the motions that nothing determines.
    original : FlexibleBody, optional
        The body that this one is a copy of, at another place of the scene.
    """

    body: FEModel
    ports: Ports
    rigid: NDArray[np.float64]
    checks: tuple[Finding, ...]
    notes: tuple[str, ...]
    stiffening: GeometricStiffness | None = None
    proofs: tuple[Proof, ...] = ()
    negative: Mapping[str, int | None] | None = None
    damping: DampingHealth | None = None
    determined: Determined | None = None
    original: FlexibleBody | None = None

    @property
    def undamped(self) -> FEModel:
        """The body without its damping, for questions of geometry."""
        terms = tuple(term for term in self.body.terms if term.letter in "KM")
        return replace(self.body, damping=Damping(), D=None, terms=terms)

    @cached_property
    def health(self) -> BodyHealth:
        """Health of the matrices and of the geometry; without factorisations if the body is large."""
        if self.original is not None:
            return self.original.health
        return body_health(self.body, self.rigid, thorough=self.body.n <= _THOROUGH, negative=self.negative)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything that the reduction of the body depends on."""
        digest = hashlib.sha256()
        body, ports = self.body, self.ports
        arrays: list[NDArray[Any]] = [body.dofs.node, body.dofs.component, ports.interface, ports.static_loads]
        arrays += [np.array(self.rigid.shape), np.array([body.rounding, body.noise])]
        for A in (body.K, body.M, body.D, *(sp.csc_array(term.matrix) for term in body.terms)):
            if A is not None:
                arrays += [A.indptr, A.indices, A.data]
        if body.second_order is not None:
            arrays += [body.second_order.r_phi, body.second_order.phi_phi]
        if body.nodes is not None:
            arrays += [body.nodes.id, body.nodes.xyz, body.nodes.frame]
        varied = [(term.parameter, term.letter, term.power) for term in body.terms]
        digest.update(repr((varied, body.corners)).encode() if varied else b"")
        for array in arrays:
            digest.update(str((array.shape, array.dtype.str)).encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def substructure(self, scene: Scene, modes: ModalComponent | None = None) -> Substructure:
        """The body as it is assembled, in the amplitudes of some modes or in its dofs."""
        points = body_points(scene, self.body)
        if modes is None:
            return physical_substructure(self.body, points, self.rigid)
        return modal_substructure(modes, points)


def read_flexible(pipeline: Pipeline, name: str, scene: Scene) -> FlexibleBody:
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
    part = pipeline.components[name]
    as_read, unproven, changed = body_as_read(name, part, part.units_in(scene.units))
    # The rows are proven on the matrices as they are read; ties and units change them.
    proof, order = prove_row_order(as_read), prove_mass_order(as_read)
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
        interface = _acting(pipeline, converted, scene).interface
        proven = only_motions(converted.K, _rigid_shapes(converted), converted.stiffness_rounding, interface)
    named = [label for label, keys in part.interfaces.items() if keys.dofs is not None and keys.tie is None]
    determined = hold_undetermined(converted, named, proven)
    body = determined.body
    if not part.in_modes:
        # A mode that no other one excites shares neither stiffness nor mass with them.
        check_connected(body)
    if body is not converted:
        large, proven = False, None
    rounding = body.stiffness_rounding
    rigid = rigid_body_modes(body.K, body.M, _rigid_shapes(body), rounding, name, proven, prove=not large)
    _check_grounded(body, rigid)
    negative = definite(body, proven)
    geometry = None if part.geometry is None else part.geometry.file
    proved = prove_body(as_read, converted, geometry, proof, order, negative)
    notes = [*changed, *_mechanisms(body, rigid)]
    if proof.status != "proven":
        notes.append(f"{name}: the row order is not proven ({proof.remark or proof.status})")
    if body.damping.law == "none" and body.D is None:
        notes.append(f"{name}: no damping is given; its resonances are infinite")
    notes += [note for note in (unused, determined.note) if note]
    added, unproven_terms = body_terms(pipeline, body, as_read)
    terms = (*body.terms, *added)
    if terms:
        body = replace(body, terms=terms, corners=body_corners(terms, scene, name))
        determined = replace(determined, body=body)
        notes += unproven_terms
    if any(term.gyroscopic for term in terms):
        notes.append(
            f"{name}: mode sets, rankings of single bodies, frequency_error and zeros leave its gyroscopic forces "
            "out; responses, searches by errors and complex modes have them"
        )
    ports = _ports(pipeline, determined, rigid, scene)
    stiffening, remarks = body_stiffening(pipeline, body, as_read, rigid)
    # A dof that is held because nothing moves it may take a rigid motion with it, such as the spin of a straight bar.
    shown = None
    if proof.status == "proven" and proof.motions and not determined.held:
        # Rows along a plane or a line do not show all six.
        shown = min(proof.motions, _shown_motions(body))
    every = (*proved.proofs, rigid_motions_proof(body, rigid.shape[1], shown))
    proofs = tuple(replace(each, subject=name) for each in every)
    damping = damping_health(body, rigid, reduced=pipeline.reduce_of(name) is not None)
    return FlexibleBody(
        body, ports, rigid, proved.checks, (*notes, *remarks), stiffening, proofs, negative, damping, determined
    )


def copy_of(original: FlexibleBody, pipeline: Pipeline, name: str, scene: Scene) -> FlexibleBody:
    """The body of a component whose files and keys are those of another one: only its ports are its own.

    Parameters
    ----------
    original : FlexibleBody
        The other body, read and proven.
    pipeline : Pipeline
        The pipeline.
    name : str
        Name of the component.
    scene : Scene
        The scene.

    Raises
    ------
    SceneError
        If an actuator or a sensor of the scene does not fit the body.
    """
    assert original.determined is not None
    determined = replace(original.determined, body=original.body.named(name))
    return replace(
        original,
        body=determined.body,
        ports=_ports(pipeline, determined, original.rigid, scene),
        notes=(f"{name}: the same body as {original.body.name}, read and proven once",),
        proofs=tuple(replace(each, subject=name) for each in original.proofs),
        determined=determined,
        original=original,
    )


def probing_loads(flexible: FlexibleBody, scene: Scene, *, joints: bool) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Unit loads used to measure the static flexibility that a basis misses.

    Parameters
    ----------
    flexible : FlexibleBody
        The body.
    scene : Scene
        Sensors, actuators.
    joints : bool
        Also load the i-set, interfaces and actuators, whose static shapes most mode sets have.

    Returns
    -------
    names : tuple of str
        Such as ``sensor 'gyro'``; a sensor or an interface of several motions has one load for each of them.
    loads : (n, s) float64
        Loads along the motions.
    """
    # Dense, for static solutions that are dense, too: one column a motion that is measured, driven or joined. The
    # static shapes of a basis are as many.
    body, found = flexible.body, []
    bare = replace(scene, actuators=(), sensors=())
    for sensor in scene.sensors:
        ports = body_ports(body, replace(bare, sensors=(sensor,)))
        rows = sp.csr_array(sp.vstack([ports.displacements, ports.rates])).toarray()
        found += [(f"sensor '{sensor.name}'", row) for row in rows]
    if joints:
        for actuator in scene.actuators:
            ports = body_ports(body, replace(bare, actuators=(actuator,)), ("actuators",))
            found += [(f"actuator '{actuator.name}'", load) for load in ports.loads.T]
        units = {
            face: sp.eye_array(body.n, format="csr")[body.interface_rows(face)].toarray() for face in body.interfaces
        }
        found += [(f"interface '{face}'", row) for face, rows in units.items() for row in rows]
    names = tuple(name for name, _ in found)
    return names, np.column_stack([load for _, load in found]) if found else np.empty((body.n, 0))


def _check_grounded(body: FEModel, rigid: NDArray[np.float64]) -> None:
    """Refuse a body that is declared grounded and has as many motions without force as a free one."""
    if body.grounded and 0 < _shown_motions(body) <= rigid.shape[1]:
        raise DofMapError(
            f"body '{body.name}': `grounded: true` says that the ground holds the body, but its stiffness has "
            f"{rigid.shape[1]} motions without force, as a free body has, and they are not the rigid motions of the "
            "geometry. Likely cause: its rows are shuffled or of another set. Give the order of the rows as a list of "
            "node.component under `rows:`, and remove `grounded: true` if nothing holds the body"
        )


def _mechanisms(body: FEModel, rigid: NDArray[np.float64]) -> list[str]:
    """Note on motions without energy that are no rigid motions of the geometry."""
    # Constraints that hold only what has no stiffness leave the motions of the geometry free.
    whole = _shown_motions(body)
    if not rigid.shape[1] > whole > 0:
        return []
    return [
        f"{body.name}: K leaves {rigid.shape[1] - whole} motions without energy beyond the {whole} rigid ones: a hinge "
        "or release inside the body. If it has none, elements are missing"
    ]


def _ports(pipeline: Pipeline, determined: Determined, rigid: NDArray[np.float64], scene: Scene) -> Ports:
    """Inputs and outputs of the scene on a body."""
    body = determined.body
    ports = _acting(pipeline, body, scene)
    _check_ports(determined, ports)
    if not body.interfaces and motions_held(rigid, ports.interface) < rigid.shape[1]:
        # No joint and no actuator holds the body: it has no constraint modes.
        return ports.as_loads()
    return ports


def _acting(pipeline: Pipeline, body: FEModel, scene: Scene) -> Ports:
    """Inputs and outputs of the scene on a body, as its reduction asks for them."""
    keys = pipeline.reduce_of(body.name)
    return body_ports(body, scene, () if keys is None else keys.residuals)


def _check_ports(determined: Determined, ports: Ports) -> None:
    """Refuse actuators and sensors on motions without stiffness and mass."""
    units = sp.csr_array(sp.eye_array(determined.body.n, format="csr")[ports.interface])
    determined.check_untouched(units, "what acts")
    determined.check_untouched(sp.csr_array(ports.loads.T), "what acts")
    determined.check_untouched(ports.displacements, "what is measured")
    determined.check_untouched(ports.rates, "what is measured")


def _rigid_shapes(body: FEModel) -> NDArray[np.float64] | None:
    return None if body.nodes is None else rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))


def _shown_motions(body: FEModel) -> int:
    """Rigid motions that move the rows of a body in different ways; 0 without coordinates."""
    shapes = _rigid_shapes(body)
    if shapes is None:
        return 0
    lengths = np.linalg.norm(shapes, axis=0)
    return int(np.linalg.matrix_rank(shapes / np.where(lengths > 0, lengths, 1.0), DEPENDENT))
