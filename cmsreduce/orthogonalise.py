"""Orthonormal modes of a reduced body (theory section 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.pencil import elastic_pairs, refine
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
    lam, X = elastic_pairs(component.K, component.M, component.rigid, component.body.rounding)
    if lam.size < modes.m - r:
        raise MatrixError(
            f"body '{component.name}': {modes.m - r - lam.size} of the {modes.m} shapes of its {modes.method} basis "
            f"carry no mass of their own or repeat others, above all at dof {_massless_dof(component)}; leave it out "
            "of the interface (`dofs:`), so that it follows statically. Solid elements of reduced integration "
            "(C3D20R and the like) leave many such shapes: store the mass of fully integrated ones. Or let the body "
            "join as it is, without `reduce:`"
        )
    Psi = np.hstack([component.rigid, X])
    Phi, lam = _polished(component, modes.Phi @ Psi, lam)
    omega = np.concatenate([np.zeros(r), np.sqrt(lam)])
    D = None if component.body.D is None else Phi.T @ (component.body.D @ Phi)
    zeta = component.body.damping.ratios(omega[r:]) if D is None else D.diagonal()[r:] / (2 * omega[r:])
    kind, source = _origin(component, Psi)
    m = modes.m
    return ModalComponent(
        body=component.body,
        method=modes.method,
        Phi=Phi,
        omega=omega,
        zeta=np.concatenate([np.zeros(r), zeta]),
        rigid_count=r,
        D=D,
        kind=kind,
        source_hz=source,
        sigma=np.full(m, np.nan),
        spacing=np.full(m, np.nan),
        why=("rigid body",) * r + ("all modes kept",) * (m - r),
        basis_size=m,
    )


def _polished(
    component: ReducedComponent, Phi: NDArray[np.float64], lam: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Modes made orthonormal once more over all dofs.

    A basis of shapes that are nearly alike, such as constraint modes of neighbouring nodes, loses digits when its
    columns are combined; over the modes themselves the pencil is nearly diagonal, and one step restores them.
    """
    body, r = component.body, component.rigid.shape[1]
    rigid, elastic = Phi[:, :r], Phi[:, r:]
    for _ in range(2):
        rigid = rigid @ (1.5 * np.eye(r) - 0.5 * (rigid.T @ (body.M @ rigid)))
        elastic = elastic - rigid @ ((body.M @ rigid).T @ elastic)
    M, K = elastic.T @ (body.M @ elastic), elastic.T @ (body.K @ elastic)
    lam, X = refine((K + K.T) / 2, (M + M.T) / 2, lam, np.eye(lam.size))
    order = np.argsort(lam, kind="stable")
    return np.hstack([rigid, elastic @ X[:, order]]), lam[order]


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


def _massless_dof(component: ReducedComponent) -> str:
    """Interface dof with the largest share in the combination of shapes that has the least mass."""
    M = component.M
    scale = 1 / np.sqrt(np.where(M.diagonal() > 0, M.diagonal(), abs(M).max(initial=0.0) or 1.0))
    lightest = np.linalg.eigh(M * np.outer(scale, scale))[1][:, 0]
    static = np.array([kind == "constraint" for kind in component.modes.kind])
    return component.modes.label[int(np.argmax(abs(lightest) * static))]


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
