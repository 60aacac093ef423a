"""Orthonormal modes of a reduced body (theory section 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.pencil import elastic_pairs
from cmsreduce.model import ModalComponent, ModeKind, ReducedComponent

__all__ = ["orthogonalise", "orthogonality_errors"]


def orthogonalise(component: ReducedComponent) -> ModalComponent:
    """Solve the reduced pencil, so that M becomes the identity and K the squared frequencies.

    Parameters
    ----------
    component : ReducedComponent
        m columns, r rigid modes.

    Returns
    -------
    ModalComponent
        Rigid modes first, exactly r of them with frequency exactly zero, then elastic ones by frequency.

    Raises
    ------
    MatrixError
        If the basis holds a shape without mass or the same shape twice.
    """
    modes, r = component.modes, component.rigid.shape[1]
    lam, X = elastic_pairs(component.K, component.M, component.rigid)
    if lam.size < modes.m - r:
        raise MatrixError(
            f"body '{component.name}': {modes.m - r - lam.size} of the {modes.m} shapes of its {modes.method} basis "
            "carry no mass of their own or repeat others; take massless dofs out of the interface"
        )
    Psi = np.hstack([component.rigid, X])
    omega = np.concatenate([np.zeros(r), np.sqrt(lam)])
    kind, source = _origin(component, Psi)
    m = modes.m
    return ModalComponent(
        body=component.body,
        method=modes.method,
        Phi=modes.Phi @ Psi,
        omega=omega,
        zeta=np.concatenate([np.zeros(r), component.body.damping.ratios(omega[r:])]),
        rigid_count=r,
        D=None if component.D is None else Psi.T @ component.D @ Psi,
        kind=kind,
        source_hz=source,
        sigma=np.full(m, np.nan),
        spacing=np.full(m, np.nan),
        why=("rigid body",) * r + ("all modes kept",) * (m - r),
        basis_size=m,
    )


def orthogonality_errors(component: ModalComponent) -> tuple[float, float]:
    """Largest error of Phi^T M Phi = I, and of Phi^T K Phi = diag(w^2) relative to w_i w_j.

    Rows and columns of rigid modes, whose w is zero, are measured against the highest frequency: they hold what
    rounding leaves of K.
    """
    Phi, body = component.Phi, component.body
    mass = abs(Phi.T @ (body.M @ Phi) - np.eye(Phi.shape[1])).max(initial=0.0)
    w = component.omega.copy()
    if component.elastic_count:
        w[: component.rigid_count] = component.omega[-1]
    stiffness = abs(Phi.T @ (body.K @ Phi) - np.diag(component.omega**2))
    return float(mass), float((stiffness / np.outer(w, w)).max(initial=0.0)) if w.any() else 0.0


def _origin(component: ReducedComponent, Psi: NDArray[np.float64]) -> tuple[tuple[ModeKind, ...], NDArray[np.float64]]:
    """Kind and source frequency of the basis shapes with most of each mode's kinetic energy."""
    modes, r = component.modes, component.rigid.shape[1]
    share = abs(Psi * (component.M @ Psi))
    names = sorted(set(modes.kind))
    by_kind = np.array([share[[k == name for k in modes.kind]].sum(axis=0) for name in names])
    kind = [names[k] for k in by_kind.argmax(axis=0)]
    kind[:r] = ["rigid"] * r
    source = modes.source_hz[share.argmax(axis=0)]
    source[:r] = 0.0
    return tuple(kind), source
