"""Receptances: the dynamic flexibility of a single body between the motions of its points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.assemble.response.by_modes import ByModes, is_diagonal
from cmsreduce.assemble.response.by_rows import FEWER, MANY, ByRows, add_between, frequencies_last
from cmsreduce.assemble.response.by_solves import FEWEST, DenseSolves, RigidMotion, RigidShare, SparseSolves
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.response import DynamicStiffness, FlexibilityModel, adaptive_flexibility
from cmsreduce.linalg.sparse import InsufficientMemoryError
from cmsreduce.model import Matrix, Substructure, damping_parts, is_gyroscopic

__all__ = ["DAMPED_RIGID", "Receptance", "add_flexibility", "receptance", "receptances", "tabulated"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Receptance = Callable[[Real], Complex]
"""Returns L (K + i loss + i w D - w^2 M)^-1 L^T (f, p, p) at frequencies (f,) in rad/s.

Products are fast where the frequencies of one entry are contiguous in memory, as for a body in modes.
"""

# Bodies with this many coordinates or more, and no modes, are solved sparse; smaller ones, dense, many points at once.
_SPARSE = 200
DAMPED_RIGID = 1e-9
"""Damping acts on rigid motion if more than this share of its size is left there; projection leaves less."""
# Memory of a table of receptances that are used again.
_TABLE_BYTES = 2**28


def receptance(sub: Substructure, omega: Real, motions: Matrix, loaded: NDArray[np.bool_] | None = None) -> Receptance:
    """Prepare a body's receptance for some frequencies.

    The receptance of a body in its modes is a sum over them. A body in many dofs gets a small model over shapes,
    accurate to ``RESPONSE_TOLERANCE`` at every frequency up to the highest; where its bound does not confirm this, the
    body itself is solved. The result may be evaluated at any other frequencies.

    Parameters
    ----------
    sub : Substructure
        The body alone, free or held.
    omega : (f,) float64
        Circular frequencies in rad/s, none of them zero for a free body.
    motions : (p, m) Matrix
        Rows of the point motions.
    loaded : (p,) bool, optional
        Motions along which joints or inputs act. If they are far fewer than all, a body in many dofs is prepared for
        forces along them alone.

    Returns
    -------
    Receptance
        Raises MatrixError at the resonance of a body without damping.
    """
    L = dense(motions)
    if is_diagonal(sub):
        return ByModes(sub, L)
    load, rigid = _elastic_load(sub, L)
    damped = _damps_rigid_motion(sub)
    if sub.rigid.shape[1] == sub.m and not damped:
        return RigidMotion(sub, rigid)
    if damped and is_gyroscopic(sub.D):
        sub, load = _beside_rigid_motion(sub, load)
    if sub.m < _SPARSE:
        return DenseSolves(sub, load, rigid)
    M, K = sp.csc_array(sub.M), sp.csc_array(sub.K)
    D, loss = (None if part is None else sp.csc_array(part) for part in (sub.D, sub.loss))
    Z = DynamicStiffness(K, M, D, loss)
    # Points have six motions; those of a solid have three.
    here = np.flatnonzero(L.any(axis=1))

    def prepare(forces: Real, seen: Real | None) -> FlexibilityModel | None:
        # The model over shapes is for symmetric matrices.
        if omega.size < FEWEST or not forces.shape[1] or is_gyroscopic(sub.D):
            return None
        try:
            return adaptive_flexibility(
                Z, forces, omega, rigid=sub.rigid, damped_rigid=damped, rounding=sub.rounding, seen=seen
            )
        except InsufficientMemoryError:
            raise
        except (MatrixError, la.LinAlgError):
            # No model is possible with these matrices, or it was not confirmed: every point is solved.
            return None

    some = None if loaded is None else np.flatnonzero(loaded[here])
    few = some is not None and here.size >= MANY and FEWER * some.size <= here.size
    return SparseSolves(sub, Z, load[:, here], rigid, here, prepare, some if few else None)


def receptances(sub: Substructure, omega: Real, motions: Matrix) -> Complex:
    """Receptances of a body at some frequencies (f, p, p); see ``receptance``.

    Raises
    ------
    MatrixError
        If a frequency hits a resonance of a body without damping.
    """
    return receptance(sub, omega, motions)(omega)


def tabulated(source: Receptance, omega: Real, motions: int) -> Receptance:
    """Keep a receptance at some frequencies in memory; return it unchanged where the table would be too large.

    Parameters
    ----------
    source : Receptance
        To tabulate.
    omega : (f,) float64
        Ascending; the table has no other frequencies.
    motions : int
        Rows of the receptance.
    """
    # Of many motions that are only seen, no table is used.
    seen = isinstance(source, SparseSolves) and source.loaded is not None
    if seen or 16 * omega.size * motions**2 > _TABLE_BYTES:
        return source
    table = frequencies_last(source(omega))
    return lambda wanted: table[..., np.searchsorted(omega, wanted)].transpose(2, 0, 1)


def add_flexibility(G: Complex, left: Real, of: Receptance, right: Real, omega: Real) -> None:
    """Add left Y right^T to an array (l, r, f), with the receptance Y of a body at frequencies (f,) in rad/s.

    Parameters
    ----------
    G : (l, r, f) complex128
        Changed in place.
    left, right : (l, p), (r, p) float64
    of : Receptance
    omega : (f,) float64

    Raises
    ------
    MatrixError
        If a frequency hits a resonance of a body without damping.
    """
    if isinstance(of, ByRows) and of.has_fewer([(left, right)]):
        of.add(G, left, right, omega)
    else:
        add_between(G, left, frequencies_last(of(omega)), right)


def _elastic_load(sub: Substructure, L: Real) -> tuple[Real, RigidShare]:
    """Loads at the points without their share in rigid motion (m, p), and the flexibility of this share.

    K is zero on rigid motion only to round-off, which a solve at low frequency would magnify by K over w^2 M.
    """
    if _damps_rigid_motion(sub):
        return L.T, RigidShare(np.zeros((L.shape[0], 0)), np.zeros((0, L.shape[0])))
    momentum, at_points = np.asarray(sub.M @ sub.rigid), L @ sub.rigid
    motion = np.linalg.solve(sub.rigid.T @ momentum, at_points.T)
    return L.T - momentum @ motion, RigidShare(at_points, motion)


def _beside_rigid_motion(sub: Substructure, load: Real) -> tuple[Substructure, Real]:
    """A body with wheels, and loads (m, p), in amplitudes of rigid motion and motions beside it.

    K, and damping that leaves rigid motion alone, are zero on it only to round-off, which at low frequency is not small
    beside w^2 M.
    """
    r, weight = sub.rigid.shape[1], np.sqrt(np.maximum(sub.M.diagonal(), 0.0))
    # The motion of these coordinates is rigid motion alone.
    held = la.qr((weight[:, None] * sub.rigid).T, mode="r", pivoting=True)[1][:r]
    others = sp.csc_array(sp.eye_array(sub.m, format="csc"))[:, np.setdiff1d(np.arange(sub.m), held)]
    T = sp.csc_array(sp.hstack([sp.csc_array(sub.rigid), others]))
    elastic = sp.diags_array(np.where(np.arange(sub.m) < r, 0.0, 1.0))
    assert sub.D is not None
    still, turning = damping_parts(sub.D)
    M, G, K, loss, D = (
        None if A is None else sp.csc_array(T.T @ sp.csc_array(A) @ T) for A in (sub.M, turning, sub.K, sub.loss, still)
    )
    K, loss = (None if A is None else sp.csc_array(elastic @ A @ elastic) for A in (K, loss))
    assert M is not None and K is not None and D is not None and G is not None
    D = G + (D if _acts_on(still, sub.rigid) else sp.csc_array(elastic @ D @ elastic))
    return replace(sub, M=M, K=K, D=D, loss=loss, rigid=np.eye(sub.m, r), omega=None), np.asarray(T.T @ load)


def _damps_rigid_motion(sub: Substructure) -> bool:
    """Tell if damping or a wheel acts on rigid motion, which is then not separate from elastic motion.

    A wheel may be small beside the damping of stiff elements, and rules rigid motion at low frequency all the same.
    """
    # A held body may have no coordinate at all.
    if sub.D is None or not sub.rigid.size:
        return False
    return any(_acts_on(part, sub.rigid) for part in damping_parts(sub.D))


def _acts_on(D: Matrix, rigid: Real) -> bool:
    size = spla.norm(sp.csc_array(D), 1) * abs(rigid).max(initial=0.0)
    return bool(abs(D @ rigid).max(initial=0.0) > DAMPED_RIGID * size)
