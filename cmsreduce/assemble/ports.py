"""What the scene asks of one body: where forces act on it, and what is measured of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.model import SCALAR, FEModel, Point, PointTerm, Scene, StrutTerm

__all__ = ["Ports", "body_points", "body_ports"]


@dataclass(frozen=True, eq=False)
class Ports:
    """Inputs and outputs of one body.

    Parameters
    ----------
    interface : (i,) int64
        Rows of the i-set: every interface of the body and every dof an actuator acts on (Spanos-Tsuha's rule).
    loads : (n, l) float64
        Loads whose static shapes the basis must hold: struts inside the body, one column each.
    displacements, rates : (p, n), (q, n) sparse array
        Rows of the sensors on the body.
    """

    interface: NDArray[np.int64]
    loads: NDArray[np.float64]
    displacements: sp.csr_array
    rates: sp.csr_array

    def as_loads(self) -> Ports:
        """Ports with unit forces on the i-set as loads: for a body that nothing holds, reduced to its free modes."""
        units = np.zeros((self.loads.shape[0], self.interface.size))
        units[self.interface, np.arange(self.interface.size)] = 1.0
        return replace(self, interface=self.interface[:0], loads=np.hstack([units, self.loads]))


def body_points(scene: Scene, body: FEModel) -> list[str]:
    """Names of the points of one body that the scene or its interfaces refer to."""
    named = [point.name for point in scene.points() if point.body == body.name]
    return list(dict.fromkeys([*body.interfaces, *named]))


def body_ports(body: FEModel, scene: Scene) -> Ports:
    """Collect the inputs and outputs of one body from the scene.

    Parameters
    ----------
    body : FEModel
        In the scene's units.
    scene : Scene
        Actuators, sensors, joints.

    Raises
    ------
    SceneError
        If an actuator or a sensor sits on a node that the body does not have.
    """
    rows: dict[int, None] = {}
    for name in body.interfaces:
        rows.update(dict.fromkeys(int(row) for row in body.interface_rows(name)))
    loads: list[NDArray[np.float64]] = []
    for actuator in scene.actuators:
        for term in actuator.terms:
            if isinstance(term, PointTerm) and term.at.body == body.name:
                rows.update(dict.fromkeys(int(row) for row in np.flatnonzero(_row(body, term.at, term.direction))))
            elif isinstance(term, StrutTerm):
                inside = term.a.body == term.b.body == body.name
                if inside:
                    loads.append(_strut(body, term))
                else:
                    for point in (term.a, term.b):
                        if point.body == body.name:
                            for axis in np.eye(6)[:3]:
                                found = np.flatnonzero(_row(body, point, axis))
                                rows.update(dict.fromkeys(int(row) for row in found))
    displacements: list[NDArray[np.float64]] = []
    rates: list[NDArray[np.float64]] = []
    for sensor in scene.sensors:
        into = rates if sensor.rate else displacements
        for term in sensor.terms:
            if isinstance(term, PointTerm) and term.at.body == body.name:
                into.append(_row(body, term.at, term.direction))
            elif isinstance(term, StrutTerm):
                if term.a.body == term.b.body == body.name:
                    into.append(_strut(body, term))
                else:
                    # The line to another body turns with the joints: any direction at this end counts.
                    ends = [point for point in (term.a, term.b) if point.body == body.name]
                    into += [_row(body, point, axis) for point in ends for axis in np.eye(6)[:3]]
    n = body.n
    return Ports(
        np.array(list(rows), dtype=np.int64),
        np.column_stack(loads) if loads else np.zeros((n, 0)),
        _stacked(displacements, n),
        _stacked(rates, n),
    )


def _stacked(rows: list[NDArray[np.float64]], n: int) -> sp.csr_array:
    return sp.csr_array(sp.vstack([sp.csr_array(row[None]) for row in rows])) if rows else sp.csr_array((0, n))


def _node(body: FEModel, point: Point) -> int:
    if point.name in body.interfaces:
        return int(body.interfaces[point.name].node[0])
    if not point.name.isdigit() or not (body.dofs.node == int(point.name)).any():
        faces = ", ".join(body.interfaces) or "none"
        raise SceneError(
            f"'{point}': body '{body.name}' has no node or interface '{point.name}' in its matrices "
            f"(interfaces: {faces})"
        )
    return int(point.name)


def _row(body: FEModel, point: Point, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motion of a point along a direction in basic, as a row over the body's dofs."""
    node = _node(body, point)
    at = -1 if body.nodes is None else int(body.nodes.index(node)[0])
    frame = np.eye(3) if body.nodes is None or at < 0 else body.nodes.frame[at]
    along = np.concatenate([frame @ direction[:3], frame @ direction[3:]])
    # What a direction cosine of a printed frame leaves of zero is no input.
    along[abs(along) < 1e-7 * np.linalg.norm(direction)] = 0.0
    row = np.zeros(body.n)
    dofs = body.dofs.rows(node, np.arange(1, 7))
    scalar = body.dofs.rows(node, SCALAR)[0]
    if scalar >= 0:
        dofs[0] = scalar
    row[dofs[dofs >= 0]] = along[dofs >= 0]
    return row


def _strut(body: FEModel, term: StrutTerm) -> NDArray[np.float64]:
    if body.nodes is None:
        raise SceneError(f"'{term.a}' to '{term.b}': a strut needs the coordinates of its ends; give `geometry:`")
    ends = [body.nodes.xyz[int(body.nodes.index(_node(body, point))[0])] for point in (term.a, term.b)]
    line = ends[1] - ends[0]
    if not np.linalg.norm(line) > 0:
        raise SceneError(f"'{term.a}' and '{term.b}' coincide, so the strut between them has no direction")
    along = np.concatenate([line / np.linalg.norm(line), np.zeros(3)])
    return _row(body, term.b, along) - _row(body, term.a, along)
