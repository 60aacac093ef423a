"""Responses to constant loads: static displacements that a basis misses, static gains of modes, steps in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.sparse import ElasticFlexibility, factorise, motions_held
from cmsreduce.model import FEModel, GainSum, ModalComponent, repeated_groups

__all__ = ["StaticLoads", "gain_sum", "static_completeness", "static_loads", "step_errors", "step_response"]

Array = NDArray[np.float64]

# A load that its reactions balance dof by dof leaves this share of itself as rounding.
_NOTHING = 1e-10
# Gains between channels that no mode joins are rounding of the products of their largest modal inputs and outputs.
_APART = 1e-10
# Dofs whose rigid motions differ by less than this share hold a body as well as each other.
_AS_WELL = 1e-6
# A step response below this share of the strongest one of its output is rounding.
_SILENT = 1e-10


@dataclass(frozen=True, eq=False)
class StaticLoads:
    """Static loads on a body that stays in place, and the strain energy of the body under each.

    Parameters
    ----------
    balanced : (n, s) float64
        Loads with their reactions.
    energy : (s,) float64
        Strain energy of the unreduced body; 1 where a load deforms nothing.
    deforms : (s,) bool
        Loads that leave more than rounding when they are balanced.

    Notes
    -----
    A balanced load does no work on rigid motion, so that u_r is the projection of u, with energy sum (phi^T f)^2 / w^2.
    """

    balanced: Array
    energy: Array
    deforms: NDArray[np.bool_]

    def shares(self, modes: ModalComponent) -> Array:
        """Share of the strain energy that each orthonormal mode holds (m, s); rigid ones hold none."""
        elastic = slice(modes.rigid_count, None)
        found = np.zeros((modes.omega.size, self.energy.size))
        found[elastic] = (modes.Phi[:, elastic].T @ self.balanced) ** 2 / modes.stiffness[elastic, None] / self.energy
        return found

    def lack(self, shares: Array) -> Array:
        """Strain energy that modes with these shares lack, |u - u_r|_K^2 / |u|_K^2 of each load (s,)."""
        return np.where(self.deforms, np.maximum(1 - shares.sum(axis=0), 0.0), 0.0)


def static_loads(body: FEModel, rigid: Array, loads: Array, interface: NDArray[np.int64]) -> StaticLoads:
    """Strain energy of a body under static loads.

    Parameters
    ----------
    body : FEModel
        The unreduced body.
    rigid : (n, r) float64
        Its rigid-body modes, orthonormal in M; none for a body that is held.
    loads : (n, s) float64
        Unit loads at interfaces and actuators.
    interface : (i,) int64
        Rows among which the body is held in a statically determinate way, as its neighbours hold it. Where they cannot
        hold the body, its own inertia balances the load.
    """
    balanced = _balanced(body, rigid, loads, interface)
    solve = (
        ElasticFlexibility(body.K, body.M, rigid, interface)
        if rigid.shape[1]
        else factorise(body.K, what="the stiffness")
    )
    U = np.asarray(solve(balanced))
    # A load that only moves the body leaves nothing but rounding when it is balanced.
    some = np.linalg.norm(balanced, axis=0) > _NOTHING * np.linalg.norm(loads, axis=0)
    return StaticLoads(balanced, np.where(some, np.einsum("ij,ij->j", balanced, U), 1.0), some)


def static_completeness(
    modes: ModalComponent, body: FEModel, rigid: Array, loads: Array, interface: NDArray[np.int64]
) -> Array:
    """Strain energy under static loads that a reduced body lacks, as a share of the body's own.

    Parameters
    ----------
    modes : ModalComponent
        Orthonormal modes of the body, static ones included.
    body, rigid, loads, interface
        As for `static_loads`.

    Returns
    -------
    (s,) float64
        |u - u_r|_K^2 / |u|_K^2 for each load; 0 where the displacement is in the basis or the load deforms nothing, 1
        where none of it is. Craig-Bampton and MacNeal-Rubin have 0 for every load on their i-set.
    """
    found = static_loads(body, rigid, loads, interface)
    return found.lack(found.shares(modes))


def _balanced(body: FEModel, rigid: Array, loads: Array, interface: NDArray[np.int64]) -> Array:
    """Loads with reactions that keep the body in place: at the interface if it holds the body, else by inertia."""
    r = rigid.shape[1]
    if not r:
        return loads
    if motions_held(rigid, interface) < r:
        return np.asarray(loads - body.M @ rigid @ (rigid.T @ loads))
    # Of dofs that hold the body as well, the first: rounding would choose another end of a symmetric body.
    first = 1 - _AS_WELL * np.arange(interface.size) / interface.size
    _, _, order = la.qr(rigid[interface].T * first, mode="economic", pivoting=True)
    reference = interface[order[:r]]
    balanced = loads.copy()
    balanced[reference] -= np.linalg.solve(rigid[reference].T, rigid.T @ loads)
    return balanced


def gain_sum(omega: Array, B: Array, C: Array, static: Array | None = None, reach: Array | None = None) -> GainSum:
    """Static gains of modes of unit modal mass between all inputs and outputs.

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
    reach : (outputs, inputs) float64, optional
        Largest static gain that the inputs and outputs could have, static modes included; without these by default. A
        gain far below it is rounding, and zero here.

    Notes
    -----
    Modes of one frequency count together: in any rotation of them, what each has alone is another number.
    """
    _, first = np.unique(repeated_groups(omega), return_index=True)
    gain = np.add.reduceat(np.einsum("yk,ku,k->kyu", C, B, 1 / omega**2), first)
    direct = np.zeros(gain.shape[1:]) if static is None else static
    if reach is None:
        reach = np.outer(np.linalg.norm(C / omega, axis=1), np.linalg.norm(B / omega[:, None], axis=0))
    joined = abs(gain).sum(axis=0) + abs(direct) > _APART * reach
    return GainSum(omega[first] / (2 * np.pi), np.where(joined, gain, 0.0), np.where(joined, direct, 0.0))


def step_response(A: Array, B: Array, C: Array, D: Array, step: float, count: int) -> Array:
    """Response to a unit step on each input at time zero, exact at every instant returned.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, inputs), (outputs, n), (outputs, inputs) float64
        x' = A x + B u, y = C x + D u; in modal states, the response is the superposition of the modes.
    step : float
        Time between instants in seconds.
    count : int
        Instants, from time zero.

    Returns
    -------
    (count, outputs, inputs) float64

    Notes
    -----
    With a constant input, x(t + h) = exp(A h) x(t) + int exp(A s) ds B without any error of discretisation; one
    exponential gives both (Van Loan 1978).
    """
    n, inputs = B.shape
    both = la.expm(np.block([[A, B], [np.zeros((inputs, n + inputs))]]) * step)
    F, G = both[:n, :n], both[:n, n:]
    x, found = np.zeros((n, inputs)), np.empty((count, C.shape[0], inputs))
    for k in range(count):
        found[k] = C @ x + D
        x = F @ x + G
    return found


def step_errors(full: Array, reduced: Array, joined: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
    """Errors of a step response.

    Parameters
    ----------
    full, reduced : (t, outputs, inputs) float64
        At the same instants.
    joined : (outputs, inputs) bool, optional
        Pairs with a gain that is more than rounding; all by default.

    Returns
    -------
    peak : (outputs, inputs) float64
        Largest difference over the largest reference response; NaN for a silent pair.
    rms : (outputs, inputs) float64
        Root mean square of the difference over the root mean square of the reference response; NaN for a silent pair.
    """
    miss = reduced - full
    high, mean = abs(full).max(axis=0, initial=0.0), np.sqrt(np.mean(full**2, axis=0))
    silent = high <= _SILENT * high.max(axis=1, initial=0.0, keepdims=True)
    silent = silent if joined is None else silent | ~joined
    peak, rms = (
        np.where(silent, np.nan, part / np.where(silent, 1.0, size))
        for part, size in ((abs(miss).max(axis=0, initial=0.0), high), (np.sqrt(np.mean(miss**2, axis=0)), mean))
    )
    return np.asarray(peak), np.asarray(rms)
