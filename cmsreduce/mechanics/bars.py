"""Bars and beams of a body: motion of their ends, elastic stiffness, and geometric stiffness under axial force."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.model import Bars, DofTable, FEModel, Members, Nodes, Recovery, cross_matrix

__all__ = [
    "BarStiffness",
    "end_dofs",
    "end_motion",
    "known_motion",
    "member_stiffness",
]

Array = NDArray[np.float64]

_ENDS = np.array([[1.0, -1.0], [-1.0, 1.0]])
# A bar along itself is never stiffer than all elements at its node; decks print five digits or more of E and A.
_PRINTED = 1e-4
# Relative to the stretch by a motion along the bar: stretch by a motion across it, from coordinates of seven digits.
_ACROSS = 1e-6
# Smallest sine of the angle between a bar and its orientation vector that determines a plane.
_PARALLEL = 1e-6


def end_motion(nodes: Nodes, ends: NDArray[np.int64], known: Recovery, offset: Array) -> sp.csr_array:
    """Motion x y z rx ry rz of points fixed to nodes, along the basic axes, for unit motions of the leads (6 k, n).

    Parameters
    ----------
    nodes : Nodes
        Nodes of the body.
    ends : (k,) int64
        Node of each point.
    known : Recovery
        Motion of dofs; other dofs are at rest.
    offset : (k, 3) float64
        From each node to its point, along the basic axes: the point turns with the node.
    """
    node, component = np.repeat(ends, 6), np.tile(np.arange(1, 7), ends.size)
    found = known.dofs.rows(node, component)
    there = np.flatnonzero(found >= 0)
    frames = nodes.frame[nodes.index(node[there])]
    direction = frames[np.arange(there.size), (component[there] - 1) % 3]
    # Three rows of translations, then three of rotations, at each end.
    first = 6 * (there // 6) + 3 * ((there % 6) // 3)
    rows = first[:, None] + np.arange(3)
    to_basic = sp.csr_array(
        (direction.ravel(), (rows.ravel(), np.repeat(np.arange(there.size), 3))), shape=(6 * ends.size, there.size)
    )
    motion = sp.csr_array(to_basic @ known.T[found[there]])
    if offset.any():
        arm = np.tile(np.eye(6), (ends.size, 1, 1))
        arm[:, :3, 3:] = -cross_matrix(offset)
        k = ends.size
        motion = sp.csr_array(sp.bsr_array((arm, np.arange(k), np.arange(k + 1)), shape=(6 * k, 6 * k)) @ motion)
    motion.eliminate_zeros()
    return motion


class BarStiffness:
    """Bars of a body: forces along them under a motion, and the geometric stiffness of these forces.

    Parameters
    ----------
    body : FEModel
        n dofs, with the nodes of the bars.
    bars : Bars
        In the units of the body.
    hidden : Recovery, optional
        Motion of dofs without rows: dofs that rigid elements of the deck move, and condensed dofs.

    Raises
    ------
    DofMapError
        If a node of a bar is not in the body, its motion does not follow from the rows, or constraints keep the length
        of a bar.
    MatrixError
        If a bar has no length, or is stiffer than the stiffness matrix at its node.

    Notes
    -----
    The force along a bar is EA / L times its change of length: the exact value at the middle under a distributed load
    along the bar. A beam's deflection v is cubic along it, and the force N does the work N int v'^2 dx / 2 (consistent
    geometric stiffness, Przemieniecki 1968); with the twist t and uniform stress it does the work N Ip/A int t'^2 dx/2.
    A rod stays straight, and a hinged end of a beam has the slope of zero moment.
    """

    def __init__(self, body: FEModel, bars: Bars, hidden: Recovery | None = None) -> None:
        self.bars = bars
        self._without_rows = np.zeros(0, dtype=np.int64) if hidden is None else hidden.dofs.node_ids
        offset = _offsets(body, bars)
        assert body.nodes is not None
        places = body.nodes.xyz[body.nodes.index(bars.node.ravel())].reshape(-1, 2, 3) + offset
        along = places[:, 1] - places[:, 0]
        L = np.linalg.norm(along, axis=1)
        if (L == 0).any():
            raise MatrixError(f"body '{body.name}': bar {bars.id[L == 0][0]} has no length")
        t = along / L[:, None]
        self.length = L
        """(b,) float64: length of each bar."""
        self.motion = _end_motion(body, bars, offset, hidden)
        b = len(bars)
        stretch = np.zeros((b, 12))
        stretch[:, 0:3], stretch[:, 6:9] = -t, t
        rows = np.repeat(np.arange(b), 12)
        gather = sp.csr_array(
            ((stretch * (bars.EA / L)[:, None]).ravel(), (rows, np.arange(12 * b))), shape=(b, 12 * b)
        )
        self.forces = sp.csr_array(gather @ self.motion)
        """(b, n) sparse array: force along each bar, tension positive, of a motion of the rows."""
        self.per_force = _unit_stiffness(t, L, bars)
        """(b, 12, 12): geometric stiffness of each bar under a unit of tension, basic axes at its ends."""
        self._refuse_rigid(body)
        self._refuse_stiffer(body)

    def stiffness(self, tension: Array) -> sp.csc_array:
        """Geometric stiffness of the body (n, n) where each bar is under a tension (b,)."""
        b = len(self.bars)
        blocks = sp.bsr_array(
            (self.per_force * tension[:, None, None], np.arange(b), np.arange(b + 1)), shape=(12 * b, 12 * b)
        )
        K = self.motion.T @ (sp.csr_array(blocks) @ self.motion)
        return sp.csc_array((K + K.T) * 0.5)

    def _refuse_rigid(self, body: FEModel) -> None:
        """Refuse bars that constraints keep at their length: the constraints carry an unknown part of the force."""
        size = np.asarray(abs(self.motion).sum(axis=1)).reshape(-1, 12).max(axis=1)
        pull = np.asarray(abs(self.forces).sum(axis=1)).ravel()
        stuck = (size > 0) & (pull <= _ACROSS * self.bars.EA / self.length * size)
        if body.tied is not None:
            # A bar inside a rigid tie is part of one rigid piece, and has no stress.
            stuck &= ~np.isin(self.bars.node, body.tied.dofs.node).all(axis=1)
        # The same for a rigid element of the deck, one end of which may be its independent grid.
        stuck &= ~np.isin(self.bars.node, self._without_rows).any(axis=1)
        if stuck.any():
            raise DofMapError(
                f"body '{body.name}': {stuck.sum()} bars cannot stretch, the first is {self.bars.id[stuck][0]}: the "
                "motions along them are constrained or have no rows, so the forces along them are unknown; give "
                "matrices of the body that can stretch, or its geometric stiffness itself (`matrices:`)"
            )

    def _refuse_stiffer(self, body: FEModel) -> None:
        """Refuse bars that are stiffer than the stiffness matrix, which is the sum of the elements."""
        # Along one row x the energy of a bar is forces[x]^2 L / EA, and of the body K[x, x].
        worst = sp.csr_array(sp.diags_array(self.length / self.bars.EA) @ self.forces.power(2)).tocoo()
        excess = worst.data / np.maximum(body.K.diagonal()[worst.col], np.finfo(float).tiny)
        if excess.max(initial=0.0) > 1 + _PRINTED:
            at = int(excess.argmax())
            raise MatrixError(
                f"body '{body.name}': bar {self.bars.id[worst.row[at]]} alone is {excess[at]:.6g} times as stiff at "
                f"{body.dofs.labels[worst.col[at]]} as the stiffness matrix there: deck and matrix are not of one "
                "model, or not in one unit system (`units:`)"
            )


def _offsets(body: FEModel, bars: Bars) -> Array:
    """From nodes to the ends of bars (b, 2, 3), basic axes."""
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its bars have no direction")
    at = body.nodes.index(bars.node.ravel()).reshape(-1, 2)
    if (at < 0).any():
        bar, end = np.argwhere(at < 0)[0]
        raise DofMapError(f"body '{body.name}': bar {bars.id[bar]} ends at node {bars.node[bar, end]}, which it lacks")
    if bars.offset is None:
        return np.zeros((len(bars), 2, 3))
    return np.asarray(np.einsum("beji,bej->bei", body.nodes.frame[at], bars.offset))


def end_dofs(bars: Bars) -> DofTable:
    """Dofs that bars depend on, each once: slopes only for ends with slopes or offsets."""
    needed = np.ones((len(bars), 2, 6), dtype=bool)
    needed[:, :, 3:] = (bars.turning | bars.on_arms)[:, :, None]
    node = np.repeat(bars.node[:, :, None], 6, axis=2)[needed]
    component = np.broadcast_to(np.arange(1, 7), needed.shape)[needed]
    node, component = np.unique(np.column_stack([node, component]), axis=0).T
    return DofTable(node, component.astype(np.int8))


def known_motion(body: FEModel, hidden: Recovery | None) -> Recovery:
    """Motion of the dofs of a body, and of those without rows as far as it is known."""
    known = body.recovery
    if hidden is None:
        return known
    # A dof with a row keeps its motion there.
    new = known.dofs.rows(hidden.dofs.node, hidden.dofs.component) < 0
    T = sp.csr_array(sp.vstack([known.T, hidden.T[new]]))
    return Recovery(known.dofs.joined(hidden.dofs[new]), known.leads, T)


def _end_motion(body: FEModel, bars: Bars, offset: Array, hidden: Recovery | None) -> sp.csr_array:
    """Translations and rotations at both ends of each bar, along basic axes, for unit motions of the rows (12 b, n)."""
    assert body.nodes is not None
    known = known_motion(body, hidden)
    needed = end_dofs(bars)
    unknown = known.dofs.rows(needed.node, needed.component) < 0
    if body.constrained is not None:
        unknown &= body.constrained.rows(needed.node, needed.component) < 0
    if unknown.any():
        bar = bars.id[(bars.node == needed.node[unknown][0]).any(axis=1)][0]
        label = f"{needed.node[unknown][0]}.{needed.component[unknown][0]}"
        raise DofMapError(
            f"body '{body.name}': bar {bar} moves with dof {label}, which has no row in the matrices and is "
            "not constrained: it was condensed, or follows others by a mean (RBE3), so the force along the bar is not "
            "known; give the full matrices, or the geometric stiffness itself (`matrices:`)"
        )
    return end_motion(body.nodes, bars.node.ravel(), known, offset.reshape(-1, 3))


def _unit_stiffness(t: Array, L: Array, bars: Bars) -> Array:
    b = len(bars)
    across = np.eye(3) - np.einsum("bi,bj->bij", t, t)
    slope = -cross_matrix(t)
    K = np.zeros((b, 2, 6, 2, 6))
    # Deflections and slopes at the ends, of the cubic between them.
    share = np.zeros((b, 2, 2, 2, 2))
    beam = bars.bends.astype(float)
    torsion = bars.turning.all(axis=1)
    share[:, :, 0, :, 0] = np.where(bars.bends, 1.2, 1.0)[:, None, None] * _ENDS / L[:, None, None]
    share[:, :, 0, :, 1] = beam[:, None, None] * np.array([[0.1, 0.1], [-0.1, -0.1]])
    share[:, :, 1, :, 0] = np.swapaxes(share[:, :, 0, :, 1], 1, 2)
    share[:, :, 1, :, 1] = (beam * L)[:, None, None] * np.array([[4.0, -1.0], [-1.0, 4.0]]) / 30
    for bar in np.flatnonzero(bars.bends & ~bars.turning.all(axis=1)):
        share[bar] = _hinged_share(share[bar], L[bar], int(bars.turning[bar].argmin()))
    parts = (across, slope)
    for p in range(2):
        for q in range(2):
            block = np.einsum("bki,bkj->bij", parts[p], parts[q])
            K[:, :, 3 * p : 3 * p + 3, :, 3 * q : 3 * q + 3] += np.einsum("bef,bij->beifj", share[:, :, p, :, q], block)
    twist = (torsion * bars.radius_squared / L)[:, None, None] * _ENDS
    K[:, :, 3:, :, 3:] += np.einsum("bef,bi,bj->beifj", twist, t, t)
    return K.reshape(b, 12, 12)


def _hinged_share(share: Array, L: float, end: int) -> Array:
    """Work of deflections and slopes (2, 2, 2, 2) with one end free of moment, so that its slope follows."""
    free = np.eye(4)
    # Deflections and slopes in order v_a, v_a', v_b, v_b'. No curvature there: v' = 3 (v_b - v_a) / 2 L - v'_o / 2.
    slope, other = 1 + 2 * end, 3 - 2 * end
    free[slope] = 0.0
    free[slope, [0, 2, other]] = [-1.5 / L, 1.5 / L, -0.5]
    return np.asarray((free.T @ share.reshape(4, 4) @ free).reshape(2, 2, 2, 2))


def member_stiffness(members: Members, nodes: Nodes) -> Array:
    """Stiffness of each bar (b, 12, 12) for translations and rotations of its two ends, along basic axes.

    Parameters
    ----------
    members : Members
        b bars.
    nodes : Nodes
        Nodes of the body.

    Raises
    ------
    MatrixError
        If a bar has no length, or its orientation vector lies along it.

    Notes
    -----
    With end a held, end b deflects by the flexibility of bending, shear, torsion and stretch. The stiffness is its
    inverse, with the rigid motion of b under the motion of a. Released motions are condensed.
    """
    places = nodes.xyz[nodes.index(members.node.ravel())].reshape(-1, 2, 3) + members.offset
    out = np.zeros((members.EA.size, 12, 12))
    for k, (start, end) in enumerate(places):
        axes, L = _axes(start, end, members.up[k], bool(members.EI[k].any()))
        at_end = np.zeros((6, 6))
        at_end[0, 0], at_end[3, 3] = members.EA[k] / L, members.GJ[k] / L
        at_end += _bending(members.EI[k], members.shear[k], L)
        carried = np.hstack([-np.eye(6), np.eye(6)])
        carried[:3, 3:6] = cross_matrix([L, 0.0, 0.0])
        own, free = carried.T @ at_end @ carried, members.released[k]
        if free.any():
            own = own - own[:, free] @ np.linalg.pinv(own[np.ix_(free, free)], hermitian=True) @ own[free]
        turn = np.kron(np.eye(4), axes)
        out[k] = turn.T @ own @ turn
    return out


def _axes(start: Array, end: Array, up: Array, bends: bool) -> tuple[Array, float]:
    """Axes of a bar as rows, with x y the first plane of bending, and its length."""
    L = float(np.linalg.norm(end - start))
    if L == 0:
        raise MatrixError(f"a bar at {start} has no length")
    x = (end - start) / L
    if not bends:
        up = np.eye(3)[int(np.abs(x).argmin())]
    z = np.cross(x, up)
    size = float(np.linalg.norm(z))
    if size <= _PARALLEL * float(np.linalg.norm(up)):
        raise MatrixError(f"the orientation vector of the bar from {start} to {end} lies along it")
    z /= size
    return np.array([x, np.cross(z, x), z]), L


def _bending(EI: Array, shear: Array, L: float) -> Array:
    """Bending stiffness (6, 6) of one end of a bar held at the other, in both planes, along its own axes."""
    K = np.zeros((6, 6))
    planes = np.flatnonzero(EI.diagonal() > 0)
    if not planes.size:
        return K
    C, S = np.linalg.inv(EI[np.ix_(planes, planes)]), np.diag(shear[planes])
    flexibility = np.block([[C * L**3 / 3 + S * L, C * L**2 / 2], [C * L**2 / 2, C * L]])
    # Deflections y, z; slopes dy/dx = rz and dz/dx = -ry.
    at = np.concatenate([np.array([1, 2])[planes], np.array([5, 4])[planes]])
    sign = np.concatenate([np.ones(planes.size), np.array([1.0, -1.0])[planes]])
    K[np.ix_(at, at)] = np.linalg.inv(flexibility) * np.outer(sign, sign)
    return K
