"""Bodies of a pipeline with what the scene adds to them: damping, parameters, inputs and outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble import Ports, body_points, modal_substructure, physical_substructure, rows_on_body
from cmsreduce.config import Pipeline
from cmsreduce.linalg.sparse import motions_held
from cmsreduce.mechanics import Determined
from cmsreduce.model import (
    Damping,
    FEModel,
    Finding,
    GeometricStiffness,
    ModalComponent,
    Proof,
    Scene,
    Substructure,
    damping_in_units,
)
from cmsreduce.pipeline.bodies.body_damping import DampingHealth, damping_health
from cmsreduce.pipeline.bodies.body_health import BodyHealth, body_health
from cmsreduce.pipeline.bodies.parameters import body_corners, body_terms, refuse_undetermined
from cmsreduce.pipeline.bodies.proven_bodies import THOROUGH, ProvenBody, hash_of, matrices_hash, proven_body
from cmsreduce.pipeline.bodies.scene_ports import scene_ports
from cmsreduce.pipeline.bodies.stiffening import body_stiffening
from cmsreduce.read import files_read

__all__ = ["FlexibleBody", "copy_of", "in_scene", "probing_loads", "read_flexible"]


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
    known_health : BodyHealth, optional
        Health of the body, where it is known.
    matrices : str
        Hash of its matrices and nodes, where it is known.
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
    known_health: BodyHealth | None = None
    matrices: str = ""

    @property
    def undamped(self) -> FEModel:
        """The body without its damping, for questions of geometry."""
        terms = tuple(term for term in self.body.terms if term.letter in "KM")
        return replace(self.body, damping=Damping(), D=None, terms=terms)

    @property
    def viscous(self) -> FEModel:
        """The body with the forces on its rates that can make a root faster than its frequencies.

        Modal ratios below 1 and damping by alpha M do not.
        """
        _, beta = self.body.damping.rayleigh or (0.0, 0.0)
        return replace(self.body, damping=Damping(rayleigh=(0.0, beta)) if beta > 0 else Damping())

    @cached_property
    def health(self) -> BodyHealth:
        """Health of the matrices and of the geometry; without factorisations if the body is large."""
        if self.original is not None:
            return self.original.health
        if self.known_health is not None:
            return self.known_health
        return self.checked(thorough=self.body.n <= THOROUGH)

    def checked(self, *, thorough: bool) -> BodyHealth:
        """Health of the body itself, with or without factorisations."""
        undetermined = None if self.determined is None else self.determined.motions
        return body_health(self.body, self.rigid, thorough=thorough, negative=self.negative, undetermined=undetermined)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything that the reduction of the body depends on."""
        body, ports = self.body, self.ports
        added = [sp.csc_array(term.matrix) for term in body.terms]
        arrays: list[NDArray[Any]] = [ports.interface, ports.static_loads, np.array(self.rigid.shape)]
        arrays += [part for A in added for part in (A.indptr, A.indices, A.data)]
        varied = [(term.parameter, term.letter, term.power) for term in body.terms]
        label = [self.matrices or matrices_hash(body), varied, body.corners]
        return hash_of(repr(label).encode(), arrays)

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
    return in_scene(proven_body(pipeline, name, scene), pipeline, name, scene)


def in_scene(proven: ProvenBody, pipeline: Pipeline, name: str, scene: Scene) -> FlexibleBody:
    """Give a proven body its damping, what parameters add to it, and its ports in a scene.

    Parameters
    ----------
    proven : ProvenBody
        The body as read and proven.
    pipeline : Pipeline
        The pipeline.
    name : str
        Name of the component.
    scene : Scene
        The scene.

    Raises
    ------
    CmsReduceError
        If what acts on the body does not fit it, or its damping gives energy.
    """
    part, body, rigid = pipeline.components[name], proven.body, proven.rigid
    if part.damping is not None and part.damping.matrix is None and not part.in_modes:
        law = damping_in_units(part.damping.law(), part.units_in(scene.units), scene.units)
        body = body if law == body.damping else replace(body, damping=law)
    stiffening: GeometricStiffness | None = None
    notes, remarks = list(proven.notes), tuple[str, ...]()
    if body.damping.law == "none" and body.D is None:
        notes.append(f"{name}: no damping is given; its resonances are infinite")
    if rigid.shape[1] and (body.damping.rayleigh or (0.0, 0.0))[0] > 0 and (scene.joints or scene.ground):
        notes.append(
            f"{name}: alpha of its Rayleigh damping acts on its elastic modes alone, not on its rigid motions: held by "
            "joints or the ground it is damped less than by alpha M of the whole model, a cantilever a hundred times "
            "less. State dampers of the joints or modal ratios, or give its matrices with the supports (`grounded`)"
        )
    if proven.as_read is not None:
        with files_read():
            added, unproven = body_terms(pipeline, body, proven.as_read)
            terms = (*body.terms, *added)
            refuse_undetermined(terms, Determined(body, proven.undetermined, proven.held, proven.lost))
            body = replace(body, terms=terms, corners=body_corners(terms, scene, name)) if terms else body
            notes += unproven
            stiffening, remarks = body_stiffening(pipeline, body, proven.as_read, rigid)
    if any(term.gyroscopic for term in body.terms):
        notes.append(
            f"{name}: mode sets, rankings of single bodies, frequency_error and zeros leave its gyroscopic forces "
            "out; responses, searches by errors and complex modes have them"
        )
    determined = Determined(body, proven.undetermined, proven.held, proven.lost)
    return FlexibleBody(
        body,
        _ports(pipeline, determined, rigid, scene),
        rigid,
        proven.checks,
        (*notes, *remarks),
        stiffening,
        proven.proofs,
        proven.negative,
        damping_health(body, rigid, reduced=pipeline.reduce_of(name) is not None),
        determined,
        known_health=proven.health,
        matrices=proven.matrices,
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
    for sensor in scene.sensors:
        found += [(f"sensor '{sensor.name}'", row) for row in rows_on_body(body, sensor)]
    if joints:
        for actuator in scene.actuators:
            found += [(f"actuator '{actuator.name}'", row) for row in rows_on_body(body, actuator)]
        units = {
            face: sp.eye_array(body.n, format="csr")[body.interface_rows(face)].toarray() for face in body.interfaces
        }
        found += [(f"interface '{face}'", row) for face, rows in units.items() for row in rows]
    names = tuple(name for name, _ in found)
    return names, np.column_stack([load for _, load in found]) if found else np.empty((body.n, 0))


def _ports(pipeline: Pipeline, determined: Determined, rigid: NDArray[np.float64], scene: Scene) -> Ports:
    """Inputs and outputs of the scene on a body."""
    body = determined.body
    ports = scene_ports(pipeline, body, scene)
    _check_ports(determined, ports)
    if not body.interfaces and motions_held(rigid, ports.interface) < rigid.shape[1]:
        # No joint and no actuator holds the body: it has no constraint modes.
        return ports.as_loads()
    return ports


def _check_ports(determined: Determined, ports: Ports) -> None:
    """Refuse actuators and sensors on motions without stiffness and mass."""
    units = sp.csr_array(sp.eye_array(determined.body.n, format="csr")[ports.interface])
    determined.check_untouched(units, "what acts")
    determined.check_untouched(sp.csr_array(ports.loads.T), "what acts")
    determined.check_untouched(ports.displacements, "what is measured")
    determined.check_untouched(ports.rates, "what is measured")
