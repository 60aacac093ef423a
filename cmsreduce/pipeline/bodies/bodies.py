"""From the components of a pipeline file to bodies in the scene's units.

The mass matrix of a body against the masses that its deck states.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble import Ports, body_points, body_ports, modal_substructure, physical_substructure
from cmsreduce.config import Component, InterfaceKeys, MatrixFile, Pipeline
from cmsreduce.errors import SceneError
from cmsreduce.linalg.eigen import motions_held, only_motions, rigid_body_modes
from cmsreduce.mechanics import Determined, Tie, check_connected, hold_undetermined, rigid_mass, tie_nodes
from cmsreduce.model import (
    Check,
    Damping,
    FEModel,
    GeometricStiffness,
    Interface,
    ModalComponent,
    RigidBody,
    Scene,
    Substructure,
    Units,
    in_units,
    rigid_body_shapes,
    rigid_in_units,
)
from cmsreduce.pipeline.bodies.body_health import BodyHealth, body_health
from cmsreduce.pipeline.bodies.stiffening import body_stiffening
from cmsreduce.read import InterfaceSpec, MatrixSource, RowOrderProof, deck_mass, prove_row_order, read_body
from cmsreduce.verify import REALISABLE, inertia_excess, mass_disorder, rigid_mass_properties

__all__ = [
    "FlexibleBody",
    "against_deck",
    "probing_loads",
    "read_flexible",
    "read_rigid",
]

# Only a body that is free in all directions must show one mass in each of them.
_ALL_MOTIONS = 6
# A file's rounding adds up over a body's mass; a condensed body loses a few digits more, rows in disorder all of them.
_MASS_ALIKE, _MASS_FACTOR = 1e-6, 100.0

# Up to so many dofs every reduction begins with the factorisations that `inspect` does.
_LOOKED_AT = 3000
# Below this size looking for mechanisms costs less than proving that there are none.
_LARGE = 2000


@dataclass(frozen=True, eq=False)
class FlexibleBody:
    """A body read, checked, and looked at from the scene.

    Parameters
    ----------
    body : FEModel
        In the scene's units.
    ports : Ports
        Where the scene acts on it and measures it.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    checks : tuple of Check
        What was proven on the way.
    notes : tuple of str
        What could not be proven.
    stiffening : GeometricStiffness, optional
        What stress adds to its stiffness, if the pipeline asks for it.
    """

    body: FEModel
    ports: Ports
    rigid: NDArray[np.float64]
    checks: tuple[Check, ...]
    notes: tuple[str, ...]
    stiffening: GeometricStiffness | None = None

    @property
    def undamped(self) -> FEModel:
        """The body without its damping, for questions of geometry."""
        return replace(self.body, damping=Damping(), D=None)

    @cached_property
    def health(self) -> BodyHealth:
        """What its matrices and its geometry say of it, as far as that costs little."""
        return body_health(self.body, self.rigid, thorough=self.body.n <= _LOOKED_AT)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all that its reduction depends on."""
        digest = hashlib.sha256()
        body, ports = self.body, self.ports
        arrays: list[NDArray[Any]] = [body.dofs.node, body.dofs.component, ports.interface, ports.static_loads]
        arrays += [np.array(self.rigid.shape), np.array(body.rounding)]
        for A in (body.K, body.M, body.D):
            if A is not None:
                arrays += [A.indptr, A.indices, A.data]
        if body.nodes is not None:
            arrays += [body.nodes.id, body.nodes.xyz, body.nodes.frame]
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
    """Read a flexible body of a pipeline, prove its rows, restate it in the scene's units.

    Parameters
    ----------
    pipeline : Pipeline
        Whose component it is.
    name : str
        Name of the component.
    scene : Scene
        What it is for.

    Raises
    ------
    CmsReduceError
        As `read_body` does.
    """
    part = pipeline.components[name]
    as_read, proof, untied = _read(name, part, part.units_in(scene.units))
    named = [label for label, keys in part.interfaces.items() if keys.dofs is not None and keys.tie is None]
    whole = in_units(as_read, scene.units)
    # One factorisation tells of large bodies that nothing moves without stiffness or mass but the body as a whole.
    asked = whole.n > _LARGE
    proven = only_motions(whole.K, _rigid_shapes(whole), whole.rounding) if asked else None
    determined = hold_undetermined(whole, named, proven)
    body = determined.body
    check_connected(body)
    if body is not whole:
        asked, proven = False, None
    rigid = rigid_body_modes(body.K, body.M, _rigid_shapes(body), body.rounding, name, proven, prove=not asked)
    checks, notes = [], []
    if proof.status == "proven":
        checks.append(Check("row order: K times rigid motions", proof.residual, proof.tolerance))
        if proof.motions == _ALL_MOTIONS:
            limit = max(_MASS_ALIKE, _MASS_FACTOR * body.rounding)
            checks.append(Check("mass matrix: the same mass along x, y, z", mass_disorder(body), limit))
            checks += _realisable(body)
            checks += [] if part.geometry is None else against_deck(part.geometry.file, as_read)
    else:
        notes.append(f"{name}: the row order is not proven ({proof.remark or proof.status})")
    if body.damping.law == "none" and body.D is None:
        notes.append(f"{name}: no damping is given; its resonances are infinite")
    if determined.note:
        notes.append(determined.note)
    keys = pipeline.reduce_of(name)
    ports = body_ports(body, scene, () if keys is None else keys.residuals)
    _check_answerable(determined, ports)
    if not body.interfaces and motions_held(rigid, ports.interface) < rigid.shape[1]:
        # Nothing is joined to the body, and its actuators do not hold it: it has no constraint modes.
        ports = ports.as_loads()
    stiffening, remarks = body_stiffening(pipeline, body, untied, rigid)
    return FlexibleBody(body, ports, rigid, tuple(checks), (*notes, *remarks), stiffening)


def probing_loads(flexible: FlexibleBody, scene: Scene, *, joints: bool) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Loads whose static shapes a basis may lack, by name.

    Parameters
    ----------
    flexible : FlexibleBody
        Where they act.
    scene : Scene
        Sensors, actuators.
    joints : bool
        Whether to name those on the i-set too, which most mode sets hold: interfaces and actuators.

    Returns
    -------
    names : tuple of str
        Such as ``sensor 'gyro'``; a sensor or an interface of several motions has as many loads.
    loads : (n, s) float64
        Loads along the motions.
    """
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


def _rigid_shapes(body: FEModel) -> NDArray[np.float64] | None:
    return None if body.nodes is None else rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))


def _realisable(body: FEModel) -> list[Check]:
    """Whether any distribution of mass has the body's inertia."""
    R = _rigid_shapes(body)
    excess = None if R is None else inertia_excess(R.T @ (body.M @ R))
    if excess is None:
        return []
    return [Check("inertia: beyond what mass can have", excess, max(REALISABLE, _MASS_FACTOR * body.rounding))]


def read_rigid(pipeline: Pipeline, name: str, scene: Scene) -> RigidBody:
    """Make a rigid body of a pipeline, in the scene's units.

    Raises
    ------
    SceneError
        If an interface of it is given by nodes.
    """
    part = pipeline.components[name]
    assert part.rigid is not None
    faces = {}
    for label, keys in part.interfaces.items():
        if keys.position is None:
            raise SceneError(f"'{name}.{label}': a rigid body has no nodes; give the interface a `position: [x, y, z]`")
        frame = np.eye(3) if keys.frame is None else keys.frame.rows()
        faces[label] = Interface(
            label,
            np.array([-1]),
            (tuple(sorted(keys.components)),),
            np.array([keys.position], dtype=np.float64),
            frame,
            np.eye(3)[None],
        )
    body = RigidBody(
        name, part.rigid.mass, np.array(part.rigid.cg), part.rigid.tensor(), faces, part.units_in(scene.units)
    )
    return rigid_in_units(body, scene.units)


def _check_answerable(determined: Determined, ports: Ports) -> None:
    """Refuse actuators and sensors on motions without stiffness and mass."""
    units = sp.csr_array(sp.eye_array(determined.body.n, format="csr")[ports.interface])
    determined.check_untouched(units, "what acts")
    determined.check_untouched(sp.csr_array(ports.loads.T), "what acts")
    determined.check_untouched(ports.displacements, "what is measured")
    determined.check_untouched(ports.rates, "what is measured")


def _read(name: str, part: Component, units: Units) -> tuple[FEModel, RowOrderProof, FEModel]:
    """The body with its ties, the proof of its rows, and the body as its files have it."""
    assert part.stiffness is not None and part.mass is not None
    matrix = None if part.damping is None else part.damping.matrix
    body = read_body(
        name,
        stiffness=_source(part.stiffness),
        mass=_source(part.mass),
        geometry=None if part.geometry is None else part.geometry.file,
        rows=None if part.rows is None else part.rows.file or part.rows.set,
        damping=None if part.damping is None else part.damping.law(),
        damping_matrix=None if matrix is None else _source(matrix),
        units=units,
        grounded=part.grounded,
        interfaces={label: _interface(label, name, keys) for label, keys in part.interfaces.items()},
    )
    # The rows are proven on the matrices as they are read; what follows restates them.
    proof, untied = prove_row_order(body), body
    for label, keys in part.interfaces.items():
        if keys.tie is not None:
            position = None if keys.position is None else np.array(keys.position)
            frame = None if keys.frame is None else keys.frame.rows()
            body = tie_nodes(body, label, Tie(keys.tie, position, keys.weights, frame))
    return body, proof, untied


def _source(keys: MatrixFile) -> MatrixSource:
    return MatrixSource(keys.file, keys.matrix, keys.format)


def _interface(label: str, body: str, keys: InterfaceKeys) -> InterfaceSpec:
    if keys.position is not None and keys.tie is None:
        raise SceneError(f"'{body}.{label}': a flexible body is joined at its nodes; give `node:`, not `position:`")
    nodes = (keys.node,) if keys.node is not None else keys.nodes
    dofs = None if keys.dofs is None else "".join(str(c) for c in sorted(keys.components))
    return InterfaceSpec(nodes, dofs, keys.set, None if keys.frame is None else keys.frame.rows())


# Areas, densities and coordinates of a deck have five digits or more.
_DIGITS = 1e-4


def against_deck(path: Path, body: FEModel) -> list[Check]:
    """Compare mass and centre of mass with those of the elements of the deck.

    Parameters
    ----------
    path : Path
        Geometry file.
    body : FEModel
        As read from it, in its units; free in all directions.

    Returns
    -------
    list of Check
        Relative to the mass, and to the largest radius of gyration; empty where the deck states no masses, or some that
        are not counted.
    """
    stated = None if body.nodes is None else deck_mass(path, body.nodes)
    if stated is None:
        return []
    found = rigid_mass_properties(rigid_mass(body))
    mass = float(found.mass.max())
    radius = float(np.sqrt(abs(found.inertia).max() / mass))
    away = float(np.linalg.norm(found.cg - stated.centre))
    return [
        Check("mass against the deck", abs(stated.mass - mass) / mass, _DIGITS),
        Check("centre of mass against the deck", away / radius if radius > 0 else float(away > 0), _DIGITS),
    ]
