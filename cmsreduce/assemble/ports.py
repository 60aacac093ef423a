"""Ports of one body in the scene: the loads of its actuators and the motions that its sensors measure."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.model import SCALAR, Channel, FEModel, Point, PointTerm, Scene, StrutTerm, dof_index

__all__ = ["Ports", "body_points", "body_ports", "rows_on_body"]

Array = NDArray[np.float64]

_NODE_DOFS = 6

_ALL_OF_A_KIND = ("actuators", "sensors", "dampers")
# Discrete dampers act on few dofs; more static shapes than this would cost too much.
_MOST_DAMPED = 300
# Moments that one wheel exerts, at most: about all axes.
_OF_A_WHEEL = 3
# Share of a moment that rounding leaves where a wheel exerts none.
_NO_MOMENT = 1e-9


@dataclass(frozen=True, eq=False)
class Ports:
    """Inputs and outputs of one body.

    Parameters
    ----------
    interface : (i,) int64
        Rows of the i-set: every interface of the body, and every dof of a point on which an actuator acts
        (Spanos-Tsuha's rule).
    loads : (n, l) float64
        Loads whose static shapes the basis must hold, one column for each actuator that acts on several points of the
        body (`rows`, struts) or on a node that follows others.
    displacements, rates : (p, n), (q, n) sparse array
        Rows of the sensors on the body, one for each sensor however many points it measures. A strut to another body
        has one for each direction, since its line turns.
    residuals : (n, k) float64
        Further loads whose static shapes the basis must hold, which are no inputs: unit loads along the motions that
        sensors measure, or at dofs that the user names.
    """

    interface: NDArray[np.int64]
    loads: Array
    displacements: sp.csr_array
    rates: sp.csr_array
    residuals: Array

    @property
    def static_loads(self) -> Array:
        """Loads whose static shapes the basis must hold, without the unit forces on the i-set (n, l + k)."""
        return np.hstack([self.loads, self.residuals])

    def as_loads(self) -> Ports:
        """Replace the i-set by unit forces as loads: for a body that nothing holds, reduced to its free modes."""
        units = np.zeros((self.loads.shape[0], self.interface.size))
        units[self.interface, np.arange(self.interface.size)] = 1.0
        return replace(self, interface=self.interface[:0], loads=np.hstack([units, self.loads]))


def body_points(scene: Scene, body: FEModel) -> list[str]:
    """Names of the points of one body that are in its interfaces or in the scene."""
    named = [point.name for point in scene.points() if point.body == body.name]
    return list(dict.fromkeys([*body.interfaces, *named]))


def body_ports(body: FEModel, scene: Scene, residuals: Collection[str] = ()) -> Ports:
    """Collect the inputs and outputs of one body from the scene.

    Parameters
    ----------
    body : FEModel
        In the scene's units.
    scene : Scene
        Actuators, sensors, joints.
    residuals : collection of str
        ``actuators`` to take the actuators' dofs as loads instead of into the i-set, ``sensors`` for a load along
        each measured motion, ``dampers`` for the forces of the body's damping matrix, ``NODE`` or ``NODE.DOF`` for
        unit loads there.

    Raises
    ------
    SceneError
        If an actuator, a sensor or a residual sits on a node that the body does not have.
    """
    at_joints = [row for name in body.interfaces for row in body.interface_rows(name)]
    acting = _channels(body, scene.actuators)
    # A force on a node that follows many others is one load, not many interface dofs.
    by_load = [force.spread or np.count_nonzero(force.row) > _NODE_DOFS for force in acting]
    held = [np.flatnonzero(force.row) for force, load in zip(acting, by_load, strict=True) if not load]
    loads = [force.row for force, load in zip(acting, by_load, strict=True) if load or "actuators" in residuals]
    acted_on = [] if "actuators" in residuals else [row for rows in held for row in rows]
    measured = [_channels(body, [sensor for sensor in scene.sensors if sensor.rate is rate]) for rate in (False, True)]
    displacements, rates = ([motion.row for motion in motions] for motions in measured)
    wanted = [row for text in residuals if text not in _ALL_OF_A_KIND for row in _named(body, text)]
    if "sensors" in residuals:
        wanted += displacements + rates
    if "dampers" in residuals:
        wanted += _damper_forces(body)
    wanted += _wheel_moments(body)
    return Ports(
        np.array(list(dict.fromkeys(int(row) for row in [*at_joints, *acted_on])), dtype=np.int64),
        _columns(loads, body.n),
        _stacked(displacements, body.n),
        _stacked(rates, body.n),
        _columns(wanted, body.n),
    )


def rows_on_body(body: FEModel, channel: Channel) -> list[Array]:
    """Rows of forces or motions of one channel over the dofs of one body; none if it does not act there.

    Parameters
    ----------
    body : FEModel
        In the scene's units.
    channel : Channel
        Of the scene. The line to another body turns with the joints: it has three rows at its end.

    Returns
    -------
    list of (n,) float64

    Raises
    ------
    SceneError
        If the channel sits on a node that the body does not have.
    """
    return [each.row for each in _channels(body, [channel])]


@dataclass(frozen=True, eq=False)
class _OnBody:
    """Row of a channel over the dofs of one body; ``spread`` if it takes more than one point."""

    row: Array
    spread: bool


def _channels(body: FEModel, channels: Iterable[Channel]) -> list[_OnBody]:
    """Forces or motions of channels on a body, one for each channel; those of several points first.

    The directions of a channel turn with the body, so that its points on one body have one sum in every configuration.
    """
    found: list[_OnBody] = []
    for channel in channels:
        rows: list[Array] = []
        nodes: set[int] = set()
        for term in channel.terms:
            if isinstance(term, PointTerm) and term.at.body == body.name:
                rows.append(_row(body, term.at, term.direction))
                nodes.add(_node(body, term.at))
            elif isinstance(term, StrutTerm):
                ends = [point for point in (term.a, term.b) if point.body == body.name]
                if len(ends) == 2:
                    rows.append(_strut(body, term))
                    nodes.update(_node(body, point) for point in ends)
                else:
                    # The line to another body turns with the joints: every direction at this end counts.
                    found += [_OnBody(_row(body, point, axis), False) for point in ends for axis in np.eye(6)[:3]]
        if rows:
            found.append(_OnBody(np.sum(rows, axis=0), len(nodes) > 1))
    return sorted(found, key=lambda each: not each.spread)


def _named(body: FEModel, text: str) -> list[Array]:
    """Unit rows of ``NODE.DOF``, or of every dof that ``NODE`` has."""
    node, _, dof = text.partition(".")
    point = Point(body.name, node)
    wanted = [dof_index(dof)] if dof else range(6)
    rows = [row for k in wanted if (row := _row(body, point, np.eye(6)[k])).any()]
    if not rows:
        raise SceneError(f"'{body.name}.{text}': the node does not have this dof, so no residual vector can be made")
    return rows


def _damper_forces(body: FEModel) -> list[Array]:
    """Forces that damping matrices exert, of the body and of its parameters: their columns, where dampers are few."""
    matrices = [sp.csc_array(term.matrix) for term in body.terms if term.letter == "D"]
    D = sp.csc_array(sp.hstack([*matrices, *([] if body.D is None else [body.D])])) if matrices else body.D
    if D is None:
        return []
    damped = np.flatnonzero(np.diff(D.indptr))
    if damped.size > _MOST_DAMPED:
        raise SceneError(
            f"component '{body.name}': its damping matrix acts on {damped.size} dofs; residual vectors for `dampers` "
            f"are for discrete ones, on at most {_MOST_DAMPED} dofs. Take `dampers` out of its residuals"
        )
    return list(D[:, damped].toarray().T)


def _wheel_moments(body: FEModel) -> list[Array]:
    """Moments by which wheels act on the body: a force acts there, and a basis without its static shape lacks it."""
    found = []
    for term in body.terms:
        G = sp.csc_array(term.matrix)
        rows = np.unique(G.indices)
        if not term.gyroscopic or not 0 < rows.size <= _MOST_DAMPED:
            continue
        U, size, _ = np.linalg.svd(G[rows][:, rows].toarray())
        moments = U.T[size > _NO_MOMENT * size[0]]
        # A shaft has moments all along it, and its ends are interfaces.
        for moment in moments if len(moments) <= _OF_A_WHEEL else ():
            load = np.zeros(body.n)
            load[rows] = moment
            found.append(load)
    return found


def _columns(rows: list[Array], n: int) -> Array:
    return np.column_stack(rows) if rows else np.zeros((n, 0))


def _stacked(rows: list[Array], n: int) -> sp.csr_array:
    return sp.csr_array(sp.vstack([sp.csr_array(row[None]) for row in rows])) if rows else sp.csr_array((0, n))


def _node(body: FEModel, point: Point) -> int:
    if point.name in body.interfaces:
        return int(body.interfaces[point.name].node[0])
    if not point.name.isdigit() or not (body.recovery.dofs.node == int(point.name)).any():
        faces = ", ".join(body.interfaces) or "none"
        raise SceneError(
            f"'{point}': body '{body.name}' has no node or interface '{point.name}' in its matrices "
            f"(interfaces: {faces})"
        )
    return int(point.name)


def _row(body: FEModel, point: Point, direction: Array) -> Array:
    """Motion of a point along a direction in basic, as a row over the body's dofs."""
    node = _node(body, point)
    at = -1 if body.nodes is None else int(body.nodes.index(node)[0])
    frame = np.eye(3) if body.nodes is None or at < 0 else body.nodes.frame[at]
    along = np.concatenate([frame @ direction[:3], frame @ direction[3:]])
    # Rounding of the direction cosines of a printed frame is no input.
    along[abs(along) < 1e-7 * np.linalg.norm(direction)] = 0.0
    known = body.recovery
    dofs = known.dofs.rows(node, np.arange(1, 7))
    scalar = known.dofs.rows(node, SCALAR)[0]
    if scalar >= 0:
        dofs[0] = scalar
    return np.asarray(known.T[dofs[dofs >= 0]].T @ along[dofs >= 0])


def _strut(body: FEModel, term: StrutTerm) -> Array:
    if body.nodes is None:
        raise SceneError(f"'{term.a}' to '{term.b}': a strut needs the coordinates of its ends; give `geometry:`")
    ends = [body.nodes.xyz[int(body.nodes.index(_node(body, point))[0])] for point in (term.a, term.b)]
    line = ends[1] - ends[0]
    if not np.linalg.norm(line) > 0:
        raise SceneError(f"'{term.a}' and '{term.b}' coincide, so the strut between them has no direction")
    along = np.concatenate([line / np.linalg.norm(line), np.zeros(3)])
    return _row(body, term.b, along) - _row(body, term.a, along)
