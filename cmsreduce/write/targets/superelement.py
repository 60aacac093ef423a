"""A reduced body as a superelement: interface dofs and fixed-interface modes, for programs that take its matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

from cmsreduce.errors import WriteError
from cmsreduce.model import DofTable
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.targets.joined_nodes import JoinedNodes, an_interface, frames, refuse_joined

__all__ = ["Superelement", "framed_superelement", "superelement"]

# Rows of the shapes are scaled to unit length. Shapes are known to about nine digits, so a row that is a combination of
# the others to nine digits is dependent on them.
_DEPENDENT = 1e-9
# Relative to the largest damping: round-off of the products that form it.
_UNDAMPED = 1e-12
_SIX = 6
_REMEDY = "keep all modes (`balance: {keep: all}`) of `method: craig-bampton` or `macneal-rubin`"

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Superelement:
    """Mass and stiffness of i interface dofs and q fixed-interface modes.

    Parameters
    ----------
    interface : DofTable
        Interface dofs, sorted by node and component.
    omega : (q,) float64
        Frequencies with fixed interfaces, in rad per unit of time; infinite for shapes without mass.
    M, K : (i + q, i + q) float64
        Interface dofs first.
    D, loss : (i + q, i + q) float64, optional
        Viscous damping, and imaginary part of the stiffness.
    """

    interface: DofTable
    omega: Array
    M: Array
    K: Array
    D: Array | None
    loss: Array | None


def superelement(component: ComponentFile) -> Superelement:
    """Express a component's modes as constraint modes of its interfaces and fixed-interface modes of the same space.

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
    A constraint mode is the shape of least strain energy for a unit displacement of one interface dof. No stiffness
    couples it to the fixed-interface modes (Craig and Bampton, 1968).
    """
    interface, shapes = _interface(component)
    K, M, D = (component.arrays[f"modes/{name}"] for name in ("stiffness", "mass", "damping"))
    loss = component.arrays.get("modes/loss")
    psi = _constraint_modes(component, shapes, np.diag(K))
    omega, Y = _fixed_interface_modes(shapes, K, M)
    T = np.hstack([psi, Y])
    i, massless = shapes.shape[0], np.isinf(omega)
    reduced_K, reduced_M = _change(K, T), _change(M, T)
    # Remove the round-off of entries that are exactly zero or one: least strain energy, and modes of unit mass.
    reduced_K[:i, i:] = reduced_K[i:, :i] = 0.0
    reduced_K[i:, i:] = np.diag(np.where(massless, 1.0, omega) ** 2)
    reduced_M[i:, i:] = np.diag(np.where(massless, 0.0, 1.0))
    return Superelement(
        interface,
        omega,
        reduced_M,
        reduced_K,
        _change(D, T) if D.any() else None,
        None if loss is None else _change(loss, T),
    )


def _change(A: Array, T: Array) -> Array:
    B = T.T @ A @ T
    return np.asarray(0.5 * (B + B.T))


def framed_superelement(component: ComponentFile) -> Superelement:
    """Superelement in SI for programs that join frames of six dofs: x y z rx ry rz of each node, along the basic axes.

    Modes without mass are left out. No load of such a program acts on them and no mass or stiffness couples them to
    the rest, so that they stay at rest.

    Parameters
    ----------
    component : ComponentFile
        m modes.

    Raises
    ------
    WriteError
        As `superelement` does; and if an interface node has fewer than six dofs, damping is a complex stiffness, or
        damping couples a mode without mass to the rest.
    """
    refuse_joined(component, frames(JoinedNodes.of_file(component)))
    body = superelement(component)
    if body.loss is not None:
        raise WriteError(
            f"component '{component.name}': structural damping is a complex stiffness, which codes in the time domain "
            "cannot use; give it modal damping"
        )
    i = len(body.interface)
    kept = np.concatenate([np.ones(i, dtype=bool), np.isfinite(body.omega)])
    if body.D is not None and abs(body.D[~kept]).max(initial=0.0) > _UNDAMPED * abs(body.D).max():
        raise WriteError(
            f"component '{component.name}': a shape without mass is damped, so that it lags behind its load; give the "
            "body modal damping, which does not act on such shapes"
        )
    units = component.units
    T = _to_basic_metres(component, body)[:, kept]
    K, M, D = (None if A is None else _change(A, T) for A in (body.K, body.M, body.D))
    assert K is not None and M is not None
    energy = units.mass * units.length**2
    return Superelement(
        body.interface,
        body.omega[kept[i:]] / units.time,
        M * energy,
        K * energy / units.time**2,
        None if D is None else D * energy / units.time,
        None,
    )


def _to_basic_metres(component: ComponentFile, body: Superelement) -> Array:
    """Dofs of the file from those in basic axes, metres, radians and unit modal masses of kg m^2 (i + q, i + q)."""
    T, units = np.zeros_like(body.K), component.units
    for first in range(0, len(body.interface), _SIX):
        at = component.arrays["nodes/id"] == body.interface.node[first]
        axes = component.arrays["nodes/frame"][at][0]
        T[first : first + 3, first : first + 3] = axes / units.length
        T[first + 3 : first + 6, first + 3 : first + 6] = axes
    q = np.arange(len(body.interface), len(T))
    T[q, q] = 1 / np.sqrt(units.mass * units.length**2)
    return T


def _interface(component: ComponentFile) -> tuple[DofTable, Array]:
    """Dofs of the interfaces, each once, and their rows of the shapes (i, m)."""
    names = [f"interfaces/{name}" for name in component.interfaces]
    refuse_joined(component, an_interface(JoinedNodes.of_file(component)))
    node = np.concatenate([component.arrays[f"{name}/node"] for name in names])
    part = np.concatenate([component.arrays[f"{name}/component"] for name in names])
    rows = np.vstack([component.arrays[f"{name}/shapes"] for name in names])
    _, first = np.unique(node * 8 + part, return_index=True)
    return DofTable(node[first], part[first]), rows[first]


def _constraint_modes(component: ComponentFile, shapes: Array, stiffness: Array) -> Array:
    """Modal coordinates (m, i) of the shapes of least strain energy that displace one interface dof each."""
    r, i = component.rigid_count, shapes.shape[0]
    scale = 1 / np.linalg.norm(shapes, axis=1)
    if not np.isfinite(scale).all():
        raise WriteError(f"component '{component.name}': an interface dof moves in no mode kept; {_REMEDY}")
    scaled = scale[:, None] * shapes
    rigid, strained = scaled[:, :r], scaled[:, r:] / np.sqrt(stiffness[r:])
    # Rigid motions need no strain energy; only the remaining motions of the interface strain the body.
    left = null_space(rigid.T, rcond=_DEPENDENT) if r else np.eye(i)
    remaining = left.T @ strained
    if np.linalg.matrix_rank(left.T @ scaled[:, r:], tol=_DEPENDENT) < left.shape[1]:
        raise WriteError(
            f"component '{component.name}': its {shapes.shape[1]} modes cannot move its {i} interface dofs "
            f"independently; {_REMEDY}"
        )
    p = np.linalg.pinv(remaining) @ left.T if left.shape[1] else np.zeros((strained.shape[1], i))
    q = np.linalg.pinv(rigid, rcond=_DEPENDENT) @ (np.eye(i) - strained @ p)
    return np.asarray(np.vstack([q, p / np.sqrt(stiffness[r:])[:, None]]) * scale)


def _fixed_interface_modes(shapes: Array, K: Array, M: Array) -> tuple[Array, Array]:
    """Frequencies (q,) and modal coordinates (m, q) of the fixed-interface modes."""
    held = null_space(shapes / np.linalg.norm(shapes, axis=1)[:, None], rcond=_DEPENDENT)
    if not held.shape[1]:
        return np.zeros(0), held
    # There are shapes without mass and shapes without stiffness; K + shift M is positive for both. The lowest modes
    # keep their digits if the shift is not above them.
    k, m = held.T @ K @ held, held.T @ M @ held
    resisting = np.diag(K)[(np.diag(K) > 0) & (np.diag(M) > 0)]
    shift = resisting.min(initial=np.inf) if resisting.size else 1.0
    compliance, Y = eigh(0.5 * (m + m.T), 0.5 * (k + shift * m + (k + shift * m).T))
    compliance, Y = compliance[::-1], Y[:, ::-1]
    # Modal masses are 1 or 0, so the rank of the mass counts the combinations with mass, for any stiffness.
    massless = np.arange(Y.shape[1]) >= np.linalg.matrix_rank(m, rtol=_DEPENDENT, hermitian=True)
    squared = np.where(massless, np.inf, 1 / np.where(massless, 1.0, compliance) - shift)
    # The eigenvectors are orthonormal in K + shift M. Scale them to unit mass; those without mass have unit stiffness.
    return np.sqrt(np.maximum(squared, 0.0)), held @ (Y / np.sqrt(np.where(massless, 1.0, compliance)))
