"""The share of one body in chosen modes of a system, in any number of configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import combined, svd
from cmsreduce.linalg.gramian import weighted_singular_values
from cmsreduce.model import Matrix, ModalComponent

__all__ = ["INDEPENDENT", "Projection", "keep_combinations", "project_shapes"]

Array = NDArray[np.float64]

INDEPENDENT = 1e-8
"""A direction of a body's projected shapes is independent when it holds more than this share of the amplitude of a mode
of the system of unit modal mass: 1e-16 of its kinetic energy. System modes are known to 1e-9 of their amplitude."""

# Gram-Schmidt leaves this share of a column that depends on those before it.
_ROUNDING = 1e-13
# A combination with this share of its square in one old mode is that mode.
_SAME = 1 - 1e-6
# Products of unit columns, to the rounding of a few thousand terms.
_ORTHONORMAL = 1e-10


@dataclass(frozen=True, eq=False)
class Projection:
    """Shapes of a body that span its part of chosen system modes.

    Parameters
    ----------
    body : str
        Name of the body.
    Q : (m, r) float64
        Shapes in the body's coordinates, orthonormal in its mass, the largest share first.
    singular : (k,) float64
        Singular values of all projected shapes, in the body's mass norm, the largest first: the r kept ones and those
        of dependent shapes. With system modes of unit modal mass they are amplitudes between 0 and the root of the
        number of modes, whatever the units.
    """

    body: str
    Q: Array
    singular: Array

    @property
    def rank(self) -> int:
        """Number of shapes kept, r."""
        return int(self.Q.shape[1])

    @property
    def left_out(self) -> float:
        """Largest singular value that was left out; zero if none was."""
        return float(self.singular[self.rank :].max(initial=0.0))


def project_shapes(body: str, shapes: Sequence[Array], M: Matrix, tolerance: float = INDEPENDENT) -> Projection:
    """Collect a body's part of system modes from several configurations, without dependent shapes.

    Parameters
    ----------
    body : str
        Name of the body.
    shapes : sequence of (m, n_R) float64
        Chosen system modes in the body's coordinates, one block for each configuration; each mode of unit modal mass
        in the whole system.
    M : (m, m) float64 or sparse array
        Mass of the body; coordinates without mass follow the others.
    tolerance : float
        Shapes with singular values up to this are dependent. A larger tolerance compresses: the chosen modes then no
        longer return exactly.

    Returns
    -------
    Projection

    Notes
    -----
    From the singular value decomposition U1 S1 V1^T of P_i Phi_R, U1 replaces P_i Phi_R where that is deficient in
    rank: Eke and Man; Bernard; theory section 6. The mass norm makes the decision independent of units and of the size
    of a system mode on the body. The decomposition is that of the triangular factor of Gram-Schmidt in this norm: from
    the Gram matrix, values below 1e-8 would be round-off.
    """
    X = np.hstack([np.asarray(block, dtype=np.float64) for block in shapes])
    basis, R = _orthonormal(X, M)
    U, singular, _ = svd(R, full_matrices=False)
    rank = int(np.count_nonzero(singular > tolerance))
    return Projection(body, np.asarray(basis @ U[:, :rank]), np.asarray(singular))


def keep_combinations(component: ModalComponent, Q: Array, why: str, *, coupled: bool = False) -> ModalComponent:
    """Reduce a body to chosen combinations of its elastic modes.

    Parameters
    ----------
    component : ModalComponent
        r rigid, e elastic, s static modes; rigid and static ones are kept.
    Q : (e, k) float64
        Orthonormal columns: the combinations to keep.
    why : str
        Reason why they are kept.
    coupled : bool
        Project the viscous damping of a law completely, as that of a damping matrix.

    Returns
    -------
    ModalComponent
        k elastic modes, orthonormal in M and K: combinations of the columns that make Q^T K Q diagonal. Their
        frequencies lie between the old ones. Modal damping is no longer diagonal; its diagonal is kept, because the
        coupling is zeta times a difference of the combined frequencies. A damping matrix, and with ``coupled`` a law,
        is projected without such an approximation. Kind, source and ranking are those of the old mode most alike; the
        reason names that mode, unless the combination is itself an old mode.

    Raises
    ------
    MatrixError
        If the columns of ``Q`` are not orthonormal, or not as long as the elastic modes.
    """
    e, r = component.elastic, component.rigid_count
    Q = np.asarray(Q, dtype=np.float64)
    if Q.shape[0] != component.elastic_count or not np.allclose(Q.T @ Q, np.eye(Q.shape[1]), rtol=0, atol=_ORTHONORMAL):
        raise MatrixError(
            f"body '{component.name}': combinations {Q.shape} must be orthonormal columns over its "
            f"{component.elastic_count} elastic modes"
        )
    w, d = component.omega[e], 2 * component.zeta[e] * component.omega[e]
    omega, X = weighted_singular_values(w, Q)
    Y = Q @ X
    like = abs(Y).argmax(axis=0) if Y.size else np.zeros(0, dtype=np.int64)
    # A mode that is kept as it was keeps its sign, too.
    Y = Y * np.sign(Y[like, np.arange(like.size)])
    same = (Y**2).max(axis=0, initial=0.0) > _SAME
    combination = la.block_diag(np.eye(r), Y, np.eye(component.static_count))
    reasons = [
        why if one else f"combination of modes, most alike mode {r + k + 1}; {why}"
        for k, one in zip(like, same, strict=True)
    ]
    columns = np.concatenate([np.arange(r), r + like, np.arange(e.stop, component.omega.size)])
    D = None if component.D is None else combination.T @ component.D @ combination
    if coupled and D is None and component.damping.law not in ("none", "structural"):
        D = combination.T @ (component.viscous[:, None] * combination)
    zeta = np.einsum("ij,i,ij->j", Y, d, Y) if D is None else D.diagonal()[r : r + omega.size]
    loss = component.damping.structural
    ratio = zeta / (2 * omega) if loss is None else np.full(omega.size, loss / 2)
    static = component.omega[e.stop :]
    return replace(
        component,
        Phi=combined(component.Phi, combination),
        omega=np.concatenate([component.omega[:r], omega, static]),
        zeta=np.concatenate([np.zeros(r), ratio, np.zeros(static.size)]),
        D=D,
        terms=tuple(term.over(combination) for term in component.terms),
        kind=tuple(component.kind[k] for k in columns),
        source_hz=component.source_hz[columns],
        sigma=component.sigma[columns],
        spacing=component.spacing[columns],
        why=(*component.why[:r], *reasons, *component.why[e.stop :]),
        rankings={name: values[columns] for name, values in component.rankings.items()},
        cluster=None if component.cluster is None else component.cluster[columns],
    )


def _orthonormal(X: Array, M: Matrix) -> tuple[Array, Array]:
    """Columns orthonormal in M (m, r), and R (r, k) with X their product, by Gram-Schmidt applied twice."""
    basis, of_mass, R = np.empty(X.shape), np.empty(X.shape), np.zeros((X.shape[1], X.shape[1]))
    r = 0
    for k in range(X.shape[1]):
        x = X[:, k].copy()
        for _ in range(2):
            c = of_mass[:, :r].T @ x
            x -= basis[:, :r] @ c
            R[:r, k] += c
        y = np.asarray(M @ x)
        size, known = float(x @ y), float(np.sum(R[:r, k] ** 2))
        if size <= _ROUNDING**2 * known or size <= 0:
            continue
        R[r, k] = np.sqrt(size)
        basis[:, r], of_mass[:, r] = x / R[r, k], y / R[r, k]
        r += 1
    return basis[:, :r], R[:r]
