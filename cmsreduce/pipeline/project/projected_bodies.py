"""Bodies after projection: each reduced to its part of chosen system modes, and all of them as arrays on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import combined
from cmsreduce.linalg.gramian import weighted_singular_values
from cmsreduce.mechanics import energies
from cmsreduce.model import (
    ModalComponent,
    ModeBlock,
    ModeKind,
    ModeSet,
    ProjectionRecord,
)
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.project import Projection, keep_combinations, project_shapes
from cmsreduce.reduce import project

__all__ = ["Projected", "attachment_amplitudes", "projected_body"]

Real = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

# Reason why a body's combinations of modes are kept.
_WHY = "projected system modes"
# Amplitude, of one, up to which a static shape depends on the others.
_DEPENDENT = 1e-6


def attachment_amplitudes(component: ModalComponent, rows: NDArray[np.int64]) -> Real:
    """Elastic displacement of a body under unit forces on some dofs (e, i), as amplitudes of unit modal mass.

    Parameters
    ----------
    component : ModalComponent
        Orthonormal modes.
    rows : (i,) int64
        Dofs, such as the i-set.
    """
    e = component.elastic
    amplitudes = component.Phi[rows, e].T / component.omega[e, None] ** 2
    size = np.linalg.norm(amplitudes, axis=0)
    return np.asarray(amplitudes[:, size > 0] / size[size > 0])


def projected_body(
    flexible: FlexibleBody,
    own: ModalComponent,
    amplitudes_of: ModalComponent | None,
    shapes: Sequence[Real],
    tolerance: float,
    attached: Real | None = None,
) -> tuple[ModalComponent, Projection]:
    """Reduce a body to its rigid motion and its part of the chosen system modes.

    Parameters
    ----------
    flexible : FlexibleBody
        The body as read.
    own : ModalComponent
        Its modes after the stages before.
    amplitudes_of : ModalComponent, optional
        Modes that the shapes are amplitudes of: ``own``, or others. Without it the shapes are displacements of dofs.
    shapes : sequence of (m, n_R) float64
        Chosen system modes on the body, of unit modal mass in the system, for each sampled configuration.
    tolerance : float
        Amplitude up to which a shape depends on the others.
    attached : (e, i) float64, optional
        Further shapes of the basis, as amplitudes of the elastic modes of ``own``.

    Returns
    -------
    ModalComponent
        Rigid modes first: a multibody code moves the body by them. Static modes of ``own`` stay where the shapes are
        amplitudes of ``own``.
    Projection
        Shapes and singular values of the elastic part.

    Notes
    -----
    Shapes stay amplitudes of modes as long as possible. Over dofs the strain energy of a soft shape is a small
    difference of large terms, and digits are lost; in modes it is a sum of squares.
    """
    if amplitudes_of is None:
        return _of_dofs(flexible, own, shapes, tolerance, attached)
    if amplitudes_of is not own:
        return _of_other_modes(own, amplitudes_of, shapes, tolerance, attached)
    e, unit = own.elastic, np.eye(own.elastic_count)
    found = project_shapes(own.name, [X[e] for X in shapes], unit, tolerance)
    Q = found.Q
    if attached is not None:
        Q = np.hstack([Q, project_shapes(own.name, [attached - Q @ (Q.T @ attached)], unit, _DEPENDENT).Q])
    Q = np.linalg.qr(Q)[0] if Q.shape[1] else Q
    return keep_combinations(own, Q, _WHY), found


def _of_other_modes(
    own: ModalComponent, modes: ModalComponent, shapes: Sequence[Real], tolerance: float, attached: Real | None
) -> tuple[ModalComponent, Projection]:
    """Project shapes that are amplitudes of other modes than the body's own, such as those of the full body."""
    r, e = modes.rigid_count, modes.elastic_count
    mass, body = np.diag(modes.mass[r:]), modes.body
    found = project_shapes(own.name, [X[r:] for X in shapes], mass, tolerance)
    Q = found.Q
    if attached is not None:
        u = own.Phi[:, own.elastic] @ attached
        elastic, static = modes.Phi[:, modes.elastic], modes.Phi[:, modes.elastic.stop :]
        amplitudes = np.vstack([elastic.T @ (body.M @ u), static.T @ (body.K @ u)])
        Q = np.hstack([Q, project_shapes(own.name, [amplitudes - Q @ (Q[:e].T @ amplitudes[:e])], mass, _DEPENDENT).Q])
    omega, X = weighted_singular_values(np.sqrt(modes.stiffness[r:]), Q)
    Y, k = Q @ X, omega.size
    whole = np.zeros((modes.omega.size, r + k))
    whole[:r, :r], whole[r:, r:] = np.eye(r), Y
    D = None if modes.D is None else whole.T @ modes.D @ whole
    viscous = np.einsum("ij,i,ij->j", Y, modes.viscous[r:], Y) if D is None else D.diagonal()[r:]
    loss = body.damping.structural
    ratio = viscous / (2 * omega) if loss is None else np.full(k, loss / 2)
    of_attached = (X[found.rank :] ** 2).sum(axis=0) > 1 / 2
    kinds: list[ModeKind] = ["residual" if static else "system" for static in of_attached]
    rigid: list[ModeKind] = ["rigid"] * r
    component = ModalComponent(
        body=body,
        method="projection",
        Phi=combined(modes.Phi, whole),
        omega=np.concatenate([np.zeros(r), omega]),
        zeta=np.concatenate([np.zeros(r), ratio]),
        rigid_count=r,
        D=D,
        kind=(*rigid, *kinds),
        source_hz=np.concatenate([np.zeros(r), np.full(k, np.nan)]),
        sigma=np.full(r + k, np.nan),
        spacing=np.full(r + k, np.nan),
        why=("rigid body",) * r + (_WHY,) * k,
        basis_size=r + k,
        terms=tuple(term.over(whole) for term in modes.terms),
    )
    return component, found


def _of_dofs(
    flexible: FlexibleBody, own: ModalComponent, shapes: Sequence[Real], tolerance: float, attached: Real | None
) -> tuple[ModalComponent, Projection]:
    """Project shapes that are displacements of the body's dofs."""
    body, rigid = flexible.body, flexible.rigid
    blocks = [np.asarray(X - rigid @ (rigid.T @ (body.M @ X))) for X in shapes]
    found = project_shapes(body.name, blocks, body.M, tolerance)
    kinds = [
        ModeBlock("rigid", rigid, [f"rigid {motion + 1}" for motion in range(rigid.shape[1])]),
        ModeBlock("system", found.Q, [str(number + 1) for number in range(found.rank)]),
    ]
    if attached is not None:
        static = own.Phi[:, own.elastic] @ attached
        static = static - found.Q @ (found.Q.T @ (body.M @ static))
        added = project_shapes(body.name, [static], body.M, _DEPENDENT)
        kinds.append(ModeBlock("residual", added.Q, [f"attached {number + 1}" for number in range(added.rank)]))
    return _sharpened(orthogonalise(project(body, ModeSet.of("projection", kinds), rigid))), found


def _sharpened(component: ModalComponent) -> ModalComponent:
    """Frequencies by Rayleigh quotients: the error of a shape counts squared."""
    e, body = component.elastic, component.body
    Phi, omega = component.Phi[:, e], component.omega.copy()
    omega[e] = np.sqrt(energies(body.K, Phi) / energies(body.M, Phi))
    # Equal frequencies may change places by rounding.
    omega[e].sort()
    return replace(component, omega=omega)


@dataclass(frozen=True, eq=False)
class Projected:
    """Bodies after projection.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Rigid modes, and those that span the body's part of the chosen system modes.
    record : ProjectionRecord
        Modes sampled, ranks, extraneous modes, errors.
    notes : tuple of str
        For the reader of the run.
    """

    components: dict[str, ModalComponent]
    record: ProjectionRecord
    notes: tuple[str, ...]
