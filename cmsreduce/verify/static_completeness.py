"""Static displacements that a basis misses; converged frequencies do not show them.

Running sum of modal gains from an actuator to a sensor: which modes make up the static response.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.eigen import motions_held
from cmsreduce.linalg.sparse import ElasticFlexibility, factorise
from cmsreduce.model import FEModel, GainSum, HighGain, ModalComponent

__all__ = [
    "GainSum",
    "HighGain",
    "gain_sum",
    "static_completeness",
]

Array = NDArray[np.float64]

# Of a load that its reactions balance dof by dof, this share is left as rounding.
_NOTHING = 1e-10


def static_completeness(
    modes: ModalComponent, body: FEModel, rigid: Array, loads: Array, interface: NDArray[np.int64]
) -> Array:
    """Strain energy that a reduced body lacks under static loads, as a share of the energy there is.

    Parameters
    ----------
    modes : ModalComponent
        Orthonormal modes of the body, static ones included.
    body : FEModel
        The unreduced body.
    rigid : (n, r) float64
        Its rigid-body modes, orthonormal in M; none for a body that is held.
    loads : (n, s) float64
        Unit loads at interfaces and actuators.
    interface : (i,) int64
        Rows among which the body is held in a statically determinate way, as its neighbours hold it. Where they do not
        suffice, the load is balanced by the body's own inertia.

    Returns
    -------
    (s,) float64
        |u - u_r|_K^2 / |u|_K^2 for each load; 0 where the displacement is in the basis or the load deforms nothing, 1
        where none of it is. Craig-Bampton and MacNeal-Rubin have 0 for every load on their i-set.

    Notes
    -----
    A balanced load does no work on rigid motion, so that u_r is the projection of u, of energy sum (phi^T f)^2 / w^2.
    """
    balanced = _balanced(body, rigid, loads, interface)
    solve = ElasticFlexibility(body.K, body.M, rigid) if rigid.shape[1] else factorise(body.K, what="the stiffness")
    U = np.asarray(solve(balanced))
    energy = np.einsum("ij,ij->j", balanced, U)
    elastic = slice(modes.rigid_count, None)
    share = (modes.Phi[:, elastic].T @ balanced) ** 2 / modes.stiffness[elastic, None]
    # A load that only moves the body is balanced to nothing, but for rounding of itself.
    size = np.linalg.norm(balanced, axis=0)
    some = size > _NOTHING * np.linalg.norm(loads, axis=0)
    lacking = 1 - share.sum(axis=0) / np.where(some, energy, 1.0)
    return np.where(some, np.maximum(lacking, 0.0), 0.0)


def _balanced(body: FEModel, rigid: Array, loads: Array, interface: NDArray[np.int64]) -> Array:
    """Loads with reactions that keep the body in place: at the interface if it holds the body, else its own inertia."""
    r = rigid.shape[1]
    if not r:
        return loads
    if motions_held(rigid, interface) < r:
        return np.asarray(loads - body.M @ rigid @ (rigid.T @ loads))
    _, _, order = la.qr(rigid[interface].T, mode="economic", pivoting=True)
    reference = interface[order[:r]]
    balanced = loads.copy()
    balanced[reference] -= np.linalg.solve(rigid[reference].T, rigid.T @ loads)
    return balanced


# Gains between channels that no mode joins are rounding of what each of them does with the modes.
_APART = 1e-10


def gain_sum(omega: Array, B: Array, C: Array, static: Array | None = None) -> GainSum:
    """Gains of modes of unit modal mass.

    Parameters
    ----------
    omega : (k,) float64
        Elastic frequencies in rad/s, ascending.
    B : (k, inputs) float64
        Modal inputs.
    C : (outputs, k) float64
        Modal displacement outputs; of a rate sensor, the displacement whose rate it is.
    static : (outputs, inputs) float64, optional
        Gain of static modes.
    """
    gain = np.einsum("yk,ku,k->kyu", C, B, 1 / omega**2)
    direct = np.zeros(gain.shape[1:]) if static is None else static
    reach = np.outer(np.linalg.norm(C / omega, axis=1), np.linalg.norm(B / omega[:, None], axis=0))
    joined = abs(gain).sum(axis=0) > _APART * reach
    return GainSum(omega / (2 * np.pi), np.where(joined, gain, 0.0), direct)
