"""Geometric stiffness of a body of bars under unit loads: the stress of each, by statics, and what it adds to K."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SceneError, SingularInterfaceError
from cmsreduce.linalg.bar_stiffness import BarStiffness
from cmsreduce.linalg.congruence import congruence
from cmsreduce.linalg.factorise import NotPositiveDefiniteError, factorise
from cmsreduce.linalg.inertia_loads import inertia_loads
from cmsreduce.model import INERTIA_LOADS, Bars, FEModel, GeometricStiffness, ModalStiffening, Recovery, UnitLoad

__all__ = ["bars_stiffness", "modal_stiffening", "unit_forces"]

Array = NDArray[np.float64]

BARS = "bars of the deck"
"""What a computed matrix comes from."""


def bars_stiffness(
    body: FEModel,
    bars: Bars,
    loads: Sequence[UnitLoad] = INERTIA_LOADS,
    *,
    held: NDArray[np.int64],
    origin: Array | None = None,
    holding: str = "",
    hidden: Recovery | None = None,
) -> GeometricStiffness:
    """Geometric stiffness of a body of bars and beams for each of some unit loads.

    Parameters
    ----------
    body : FEModel
        n dofs; whatever it is of besides bars adds no geometric stiffness.
    bars : Bars
        Its bars, in its units.
    loads : sequence of UnitLoad
        Loads; those at a point name a node.
    held : (h,) int64
        Rows at rest while the loads act, as by the frame that the body moves with; none for a body that is held.
    origin : (3,) float64, optional
        Point the frame turns about, in basic; its origin if absent.
    holding : str
        What holds those rows, in words.
    hidden : Recovery, optional
        Motion of dofs of the bars that have no row, of the rows.

    Raises
    ------
    SingularInterfaceError
        If the body can still move without strain when these rows are held.

    Notes
    -----
    Under a load p f the stress, and with it the stiffness that it adds, is p times that under f: u = K^-1 f with the
    rows held, the force along each bar from u, and the geometric stiffness of the bar under it. Forces that balance
    leave no reaction, and their stress does not depend on where the body is held, if it is held just so far that it
    cannot move as one piece.
    """
    about = np.zeros(3) if origin is None else np.asarray(origin, dtype=np.float64)
    stiffness = BarStiffness(body, bars, hidden)
    tension = _tensions(body, stiffness, unit_forces(body, loads, about), held)
    matrices = tuple(stiffness.stiffness(column) for column in tension.T)
    return GeometricStiffness(tuple(loads), matrices, (BARS,) * len(matrices), about, holding)


def modal_stiffening(stiffening: GeometricStiffness, Phi: Array) -> ModalStiffening:
    """Geometric stiffness of a body in its modes Phi (n, m): Phi^T K_l Phi of each unit load l."""
    K = [congruence(A, Phi) for A in stiffening.matrices]
    return ModalStiffening(stiffening.loads, np.array(K).reshape(len(K), Phi.shape[1], Phi.shape[1]), stiffening.origin)


def unit_forces(body: FEModel, loads: Sequence[UnitLoad], origin: Array) -> Array:
    """Generalised forces of unit loads on the rows (n, l), rotations about ``origin``.

    Raises
    ------
    SceneError
        If a force acts on a node that cannot move along it.
    """
    inertia = [load for load in loads if not load.at]
    moving = inertia_loads(body, origin) if inertia else np.zeros((body.n, 0))
    columns = [_at_node(body, load) if load.at else moving[:, INERTIA_LOADS.index(load)] for load in loads]
    return np.column_stack(columns) if columns else np.zeros((body.n, 0))


def _at_node(body: FEModel, load: UnitLoad) -> Array:
    """A unit force or moment along a basic axis, on the rows (n,)."""
    node, first = int(load.at), 1 if load.kind == "force" else 4
    at = -1 if body.nodes is None else int(body.nodes.index(node)[0])
    rows = body.recovery.dofs.rows(node, np.arange(first, first + 3))
    axis = "xyz".index(load.axes)
    if at < 0 or body.nodes is None or (rows < 0).all():
        raise SceneError(f"body '{body.name}': '{load.label}' acts on a node that has no such motion")
    there = rows >= 0
    return np.asarray(body.recovery.T[rows[there]].T @ body.nodes.frame[at][there, axis])


def _tensions(body: FEModel, stiffness: BarStiffness, forces: Array, held: NDArray[np.int64]) -> Array:
    free = np.setdiff1d(np.arange(body.n), held)
    u = np.zeros_like(forces)
    K = sp.csc_array(body.K[free][:, free])
    try:
        u[free] = factorise(K, what=f"the stiffness of '{body.name}', held for its unit loads,")(forces[free])
    except NotPositiveDefiniteError as error:
        raise SingularInterfaceError(
            f"body '{body.name}': nothing holds {body.dofs.labels[free[error.row]]} while the unit loads of its "
            "geometric stiffness act; name with `held:` an interface that leaves no rigid motion, or several"
        ) from None
    return np.asarray(stiffness.forces @ u)
