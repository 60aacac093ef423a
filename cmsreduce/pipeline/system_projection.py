"""Bodies that make chosen modes of the whole system again: their part of these modes, freed of what is dependent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import closed_loop_modes, system_modes
from cmsreduce.balance import keep_directions
from cmsreduce.errors import ConfigError
from cmsreduce.linalg.dense import dense
from cmsreduce.model import Configuration, ModalComponent, ModeBlock, ModeSet, System
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.comparison import ReducedModel
from cmsreduce.project import Projection, project_shapes
from cmsreduce.reduce import project

__all__ = ["ModesOfSystem", "SystemModes", "all_modes", "attachment_amplitudes", "remade"]

Real = NDArray[np.float64]

# The imaginary part of a mode, of unit length in the mass, that is none: the mode is real.
_NO_PART = 1e-9
# A static shape that the others hold but for this amplitude, of one, is none of its own.
_NEW = 1e-6
# All modes of a system are found by dense algebra, in seconds, up to so many coordinates.
_DENSE = 4000


@dataclass(frozen=True, eq=False)
class SystemModes:
    """Elastic modes of a system in one configuration.

    Parameters
    ----------
    configuration : Configuration
    omega : (k,) float64
        Natural frequencies in rad/s, ascending.
    Phi : (N, k) float64
        In the system's coordinates, orthonormal in its mass. Under feedback: columns of unit modal mass, the real and
        the imaginary part of each mode one after the other, orthogonal to each other.
    system : System
        The system.
    s : (k,) complex128, optional
        Under feedback, the root that each column belongs to; ``omega`` is its size.
    """

    configuration: Configuration
    omega: Real
    Phi: Real
    system: System
    s: NDArray[np.complex128] | None = None

    @property
    def count(self) -> int:
        """Number of columns."""
        return int(self.omega.size)

    def only(self, modes: NDArray[np.int64]) -> SystemModes:
        """Some of the columns; of a mode under feedback always both."""
        if self.s is not None:
            modes = np.flatnonzero(np.isin(self.s, self.s[modes]))
        s = None if self.s is None else self.s[modes]
        return replace(self, omega=self.omega[modes], Phi=self.Phi[:, modes], s=s)

    @property
    def by_body(self) -> dict[str, Real]:
        """Shapes in each body's own coordinates (m_i, k)."""
        ends = np.cumsum(list(self.system.sizes.values()))[:-1]
        return dict(zip(self.system.sizes, np.split(np.asarray(self.system.T @ self.Phi), ends), strict=True))


class ModesOfSystem:
    """Modes of a model of the whole scene, computed once for each configuration.

    Parameters
    ----------
    model : ReducedModel
        Of reduced or unreduced bodies.
    omega : float
        Highest frequency in rad/s.
    gain : (inputs, outputs) float64, optional
        Feedback from the sensors to the actuators.
    """

    def __init__(self, model: ReducedModel, omega: float, gain: Real | None = None) -> None:
        self.model, self.omega, self.gain = model, omega, gain
        self._found: dict[str, SystemModes] = {}

    def at(self, configuration: Configuration) -> SystemModes:
        """Elastic modes in a configuration, or those under feedback."""
        if configuration.name not in self._found:
            system = self.model.assembled.system(configuration)
            if self.gain is None:
                w, Phi = system_modes(system, self.omega)
                found = _sharpened(self.model, SystemModes(configuration, w, Phi, system))
            else:
                found = _under_feedback(configuration, system, self.gain, self.omega)
            self._found[configuration.name] = found
        return self._found[configuration.name]


def all_modes(model: ReducedModel, configuration: Configuration) -> SystemModes:
    """Every elastic mode of a reduced system.

    Raises
    ------
    ConfigError
        If it is too large for dense algebra.
    """
    system = model.assembled.system(configuration)
    if system.N > _DENSE:
        raise ConfigError(
            f"project: the reassembled system has {system.N} coordinates, more than {_DENSE}, so that the modes that "
            "came along cannot be told; choose fewer modes or configurations"
        )
    w, Phi = system_modes(replace(system, K=dense(system.K), M=dense(system.M)), np.inf)
    return _sharpened(model, SystemModes(configuration, w, Phi, system))


def _sharpened(model: ReducedModel, modes: SystemModes) -> SystemModes:
    """Frequencies as quotients of the energies of the bodies.

    In the modes of a body the strain energy is a sum of squares. Assembled, it is a difference of large numbers, in
    which a mode of 0.1 Hz beside one of 1 kHz loses eight digits.
    """
    strain, kinetic = np.zeros(modes.count), np.zeros(modes.count)
    for name, X in modes.by_body.items():
        sub = model.assembled.substructures.get(name)
        if sub is None or (sub.omega is None and name in model.shapes):
            return modes
        strain += np.einsum("ij,ij->j", X, np.asarray(sub.K @ X))
        kinetic += np.einsum("ij,ij->j", X, np.asarray(sub.M @ X))
    return replace(modes, omega=np.sqrt(strain / kinetic))


def _under_feedback(configuration: Configuration, system: System, gain: Real, omega: float) -> SystemModes:
    """Real and imaginary parts of the modes of the closed loop, turned to be orthogonal in the mass."""
    roots, X = closed_loop_modes(system, gain, omega)
    columns, s = [], []
    for root, x in zip(roots, X.T, strict=True):
        # The phase at which both parts are orthogonal in M makes the first as large as it can be.
        square = x @ (system.M @ x)
        x = x * np.exp(-0.5j * np.angle(square))
        for part in (x.real, x.imag):
            mass = float(part @ (system.M @ part))
            if mass > _NO_PART**2:
                columns.append(part / np.sqrt(mass))
                s.append(root)
    Phi = np.column_stack(columns) if columns else np.zeros((system.N, 0))
    return SystemModes(configuration, abs(np.array(s)), Phi, system, np.array(s, dtype=np.complex128))


def attachment_amplitudes(component: ModalComponent, rows: NDArray[np.int64]) -> Real:
    """Elastic modes' share of a body's displacement under unit forces on some dofs (e, i), of unit modal mass.

    Parameters
    ----------
    component : ModalComponent
        Orthonormal modes.
    rows : (i,) int64
        Dofs, such as the i-set.
    """
    e = component.elastic
    amplitudes = component.Phi[rows, e].T / component.omega[e, None] ** 2
    size = np.linalg.norm(amplitudes, axis=0)
    return np.asarray(amplitudes[:, size > 0] / size[size > 0])


def remade(
    flexible: FlexibleBody,
    own: ModalComponent,
    amplitudes_of: ModalComponent | None,
    shapes: Sequence[Real],
    tolerance: float,
    attached: Real | None = None,
) -> tuple[ModalComponent, Projection]:
    """Reduce a body to its rigid motion and its part of system modes.

    Parameters
    ----------
    flexible : FlexibleBody
        The body as read.
    own : ModalComponent
        Its modes as the stages before left them.
    amplitudes_of : ModalComponent, optional
        Modes that the shapes are amplitudes of: ``own``, or others; they are displacements of its dofs if absent.
    shapes : sequence of (m, n_R) float64
        Chosen system modes on the body, of unit modal mass in the system, for each sampled configuration.
    tolerance : float
        Amplitude up to which a shape is dependent on the others.
    attached : (e, i) float64, optional
        Further shapes that are to be in the basis, as amplitudes of the elastic modes of ``own``.

    Returns
    -------
    ModalComponent
        Rigid modes first, as ever: a multibody code moves the body by them. Static modes stay.
    Projection
        Shapes and singular values of the elastic part.
    """
    body, rigid = flexible.body, flexible.rigid
    if amplitudes_of is not None and amplitudes_of is own:
        # In a body's own modes nothing of a soft mode is lost beside stiff ones, as it would be over its dofs.
        e = own.elastic
        unit = np.eye(own.elastic_count)
        found = project_shapes(body.name, [X[e] for X in shapes], unit, tolerance)
        Q = found.Q
        if attached is not None:
            Q = np.hstack([Q, project_shapes(body.name, [attached - Q @ (Q.T @ attached)], unit, _NEW).Q])
        Q = np.linalg.qr(Q)[0] if Q.shape[1] else Q
        return keep_directions(own, Q, ("projected system modes",) * own.elastic_count), found
    blocks = [_displacements(flexible, amplitudes_of, X) for X in shapes]
    found = project_shapes(body.name, blocks, body.M, tolerance)
    kinds = [
        ModeBlock("rigid", rigid, [f"rigid {motion + 1}" for motion in range(rigid.shape[1])]),
        ModeBlock("system", found.Q, [str(number + 1) for number in range(found.rank)]),
    ]
    if attached is not None:
        static = own.Phi[:, own.elastic] @ attached
        static = static - found.Q @ (found.Q.T @ (body.M @ static))
        added = project_shapes(body.name, [static], body.M, _NEW)
        kinds.append(ModeBlock("residual", added.Q, [f"attached {number + 1}" for number in range(added.rank)]))
    modes = ModeSet.of("projection", kinds)
    return orthogonalise(project(body, modes, rigid)), found


def _displacements(flexible: FlexibleBody, amplitudes_of: ModalComponent | None, X: Real) -> Real:
    """Displacements (n, k) of a body's dofs without its rigid motion."""
    if amplitudes_of is not None:
        e = slice(amplitudes_of.rigid_count, None)
        return np.asarray(amplitudes_of.Phi[:, e] @ X[e])
    rigid = flexible.rigid
    return np.asarray(X - rigid @ (rigid.T @ (flexible.body.M @ X)))
