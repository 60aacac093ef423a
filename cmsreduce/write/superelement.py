"""A reduced body in coordinates that a finite-element code joins: dofs of its interfaces, then modes with them held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

from cmsreduce.errors import WriteError
from cmsreduce.model import DofTable
from cmsreduce.write.component_file import ComponentFile

__all__ = ["Superelement", "superelement"]

# Rows of the shapes are scaled to unit length. A row that is a combination of the others to nine digits is one to the
# digits that shapes are known to.
_DEPENDENT = 1e-9

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Superelement:
    """Mass and stiffness of i boundary dofs and q fixed-interface modes.

    Parameters
    ----------
    boundary : DofTable
        Boundary dofs, sorted by node and component.
    omega : (q,) float64
        Frequencies with the boundary held, in rad per unit of time; infinite for shapes without mass.
    M, K : (i + q, i + q) float64
        Boundary dofs first.
    D, loss : (i + q, i + q) float64, optional
        Viscous damping, and imaginary part of the stiffness.
    """

    boundary: DofTable
    omega: Array
    M: Array
    K: Array
    D: Array | None
    loss: Array | None


def superelement(component: ComponentFile) -> Superelement:
    """Change a component's modes to constraint modes of its interfaces and fixed-interface modes: the same space.

    Parameters
    ----------
    component : ComponentFile
        m modes.

    Raises
    ------
    WriteError
        If it has no interface, or fewer shapes than its interface dofs need.

    Notes
    -----
    Constraint modes are the shapes of least strain energy for a unit displacement each, so that no stiffness couples
    them to the others (Craig and Bampton, 1968).
    """
    boundary, shapes = _boundary(component)
    K, M, D = (component.arrays[f"modes/{name}"] for name in ("stiffness", "mass", "damping"))
    loss = component.arrays.get("modes/loss")
    psi = _constraint_modes(component, shapes, np.diag(K))
    omega, Y = _fixed_interface_modes(shapes, K, M)
    T = np.hstack([psi, Y])
    i, massless = shapes.shape[0], np.isinf(omega)
    reduced_K, reduced_M = _change(K, T), _change(M, T)
    # What is zero or one by construction is written as such: least strain energy, and modes of unit mass.
    reduced_K[:i, i:] = reduced_K[i:, :i] = 0.0
    reduced_K[i:, i:] = np.diag(np.where(massless, 1.0, omega) ** 2)
    reduced_M[i:, i:] = np.diag(np.where(massless, 0.0, 1.0))
    return Superelement(
        boundary,
        omega,
        reduced_M,
        reduced_K,
        _change(D, T) if D.any() else None,
        None if loss is None else _change(loss, T),
    )


def _change(A: Array, T: Array) -> Array:
    B = T.T @ A @ T
    return np.asarray(0.5 * (B + B.T))


def _boundary(component: ComponentFile) -> tuple[DofTable, Array]:
    """Dofs of all interfaces, each once, and their rows of the shapes (i, m)."""
    names = sorted({path.rpartition("/")[0] for path in component.arrays if path.startswith("interfaces/")})
    if not names:
        raise WriteError(f"component '{component.name}': a superelement is joined at its interfaces, and it has none")
    node = np.concatenate([component.arrays[f"{name}/node"] for name in names])
    part = np.concatenate([component.arrays[f"{name}/component"] for name in names])
    rows = np.vstack([component.arrays[f"{name}/shapes"] for name in names])
    _, first = np.unique(node * 8 + part, return_index=True)
    return DofTable(node[first], part[first]), rows[first]


def _constraint_modes(component: ComponentFile, shapes: Array, stiffness: Array) -> Array:
    """Modal coordinates (m, i) of the shapes of least strain energy that displace one boundary dof each."""
    r, i = component.rigid_count, shapes.shape[0]
    scale = 1 / np.linalg.norm(shapes, axis=1)
    if not np.isfinite(scale).all():
        raise WriteError(f"component '{component.name}': an interface dof moves in no mode kept; keep more modes")
    scaled = scale[:, None] * shapes
    rigid, strained = scaled[:, :r], scaled[:, r:] / np.sqrt(stiffness[r:])
    # What rigid motion reaches costs nothing; only the rest of the boundary's motions strains the body.
    left = null_space(rigid.T, rcond=_DEPENDENT) if r else np.eye(i)
    remaining = left.T @ strained
    if np.linalg.matrix_rank(left.T @ scaled[:, r:], tol=_DEPENDENT) < left.shape[1]:
        raise WriteError(
            f"component '{component.name}': its {shapes.shape[1]} modes do not move its {i} interface dofs one by one; "
            "keep more modes, or the constraint modes of the interface"
        )
    p = np.linalg.pinv(remaining) @ left.T if left.shape[1] else np.zeros((strained.shape[1], i))
    q = np.linalg.pinv(rigid, rcond=_DEPENDENT) @ (np.eye(i) - strained @ p)
    return np.asarray(np.vstack([q, p / np.sqrt(stiffness[r:])[:, None]]) * scale)


def _fixed_interface_modes(shapes: Array, K: Array, M: Array) -> tuple[Array, Array]:
    """Frequencies (q,) and modal coordinates (m, q) of the modes with the boundary held."""
    held = null_space(shapes / np.linalg.norm(shapes, axis=1)[:, None], rcond=_DEPENDENT)
    if not held.shape[1]:
        return np.zeros(0), held
    # Shapes without mass and shapes without stiffness both occur; K + shift M is positive for either. A shift no larger
    # than the lowest modes leaves them their digits.
    k, m = held.T @ K @ held, held.T @ M @ held
    resisting = np.diag(K)[(np.diag(K) > 0) & (np.diag(M) > 0)]
    shift = resisting.min(initial=np.inf) if resisting.size else 1.0
    compliance, Y = eigh(0.5 * (m + m.T), 0.5 * (k + shift * m + (k + shift * m).T))
    compliance, Y = compliance[::-1], Y[:, ::-1]
    # Modal mass is 1 or 0, so that combinations without mass show whatever their stiffness.
    massless = np.arange(Y.shape[1]) >= np.linalg.matrix_rank(m, rtol=_DEPENDENT, hermitian=True)
    squared = np.where(massless, np.inf, 1 / np.where(massless, 1.0, compliance) - shift)
    # Orthonormal in K + shift M as they come: to unit mass, but for those that have none, whose stiffness is 1 already.
    return np.sqrt(np.maximum(squared, 0.0)), held @ (Y / np.sqrt(np.where(massless, 1.0, compliance)))
