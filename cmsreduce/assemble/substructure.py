"""Bodies in their coordinates of assembly: physical dofs, orthonormal modes, or six rigid motions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DampingError, SceneError
from cmsreduce.linalg.blocks import observed
from cmsreduce.linalg.eigen import energy_parts
from cmsreduce.model import (
    SCALAR,
    FEModel,
    Matrix,
    ModalComponent,
    ParameterTerm,
    ReducedComponent,
    RigidBody,
    Substructure,
    cross_matrix,
    with_gyroscopic,
)

__all__ = [
    "interface_substructure",
    "modal_substructure",
    "physical_substructure",
    "reduced_substructure",
    "rigid_substructure",
]

Array = NDArray[np.float64]

# Removing rigid motion from a damping matrix fills it: up to this size it may be dense.
_DENSE_LIMIT = 600


def physical_substructure(body: FEModel, points: Iterable[str], rigid: Array) -> Substructure:
    """Build the unreduced body in its own dofs, sparse.

    Parameters
    ----------
    body : FEModel
        n dofs.
    points : iterable of str
        Names of interfaces and node ids (in digits) whose motion is needed.
    rigid : (n, r) float64
        Rigid-body modes.

    Notes
    -----
    A damping law stated mode by mode has no sparse form: D is then absent, and the caller must use all modes.
    """
    D: Matrix | None = body.D
    loss: Matrix | None = None
    if body.damping.rayleigh is not None:
        alpha, beta = body.damping.rayleigh
        D = sp.csc_array(alpha * body.M + beta * body.K)
        if alpha > 0 and rigid.shape[1]:
            D = _without_rigid_drag(body, alpha, beta, rigid)
    if body.damping.structural is not None:
        loss = sp.csc_array(body.damping.structural * body.K)
    rows = sp.csr_array(sp.eye_array(body.n))
    return Substructure(
        body.name,
        body.M,
        body.K,
        with_gyroscopic(D, body.terms),
        loss,
        rigid,
        *_motions(body, rows, points),
        body.interfaces,
        rounding=body.rounding,
        terms=tuple(term for term in body.terms if not term.constant),
    )


def modal_substructure(component: ModalComponent, points: Iterable[str]) -> Substructure:
    """Build a body in its orthonormal modes.

    Parameters
    ----------
    component : ModalComponent
        m modes: rigid, elastic, static.
    points : iterable of str
        Names of interfaces and node ids whose motion is needed.
    """
    m, r = component.omega.size, component.rigid_count
    D: Matrix | None = component.D
    loss: Matrix | None = None
    if component.damping.structural is not None:
        loss = sp.diags_array(component.loss, format="csc")
    elif component.damping.law != "none" and D is None:
        D = sp.diags_array(component.viscous, format="csc")
    return Substructure(
        component.name,
        sp.diags_array(component.mass, format="csc"),
        sp.diags_array(component.stiffness, format="csc"),
        with_gyroscopic(D, component.terms),
        loss,
        np.eye(m, r),
        *_motions(component.body, component.Phi, points),
        component.body.interfaces,
        component.omega,
        terms=tuple(term for term in component.terms if not term.constant),
    )


def reduced_substructure(component: ReducedComponent, points: Iterable[str]) -> Substructure:
    """Build a body in the coordinates of its basis, without its damping; with the parts of its strain energy."""
    return Substructure(
        component.name,
        component.M,
        component.K,
        None,
        None,
        component.rigid,
        *_motions(component.body, component.modes.Phi, points),
        component.body.interfaces,
        parts=energy_parts(component.body.K, component.modes.Phi),
    )


def interface_substructure(body: FEModel, rows: NDArray[np.int64], points: Iterable[str]) -> Substructure:
    """Build the i-set of a body alone, without stiffness and mass: its coordinates are the dofs in ``rows``."""
    i = rows.size
    picked = sp.csr_array(sp.csc_array(sp.eye_array(body.n, format="csc"))[:, rows])
    none = np.zeros((i, i))
    return Substructure(
        body.name, none, none, None, None, np.zeros((i, 0)), *_motions(body, picked, points), body.interfaces
    )


def rigid_substructure(body: RigidBody) -> Substructure:
    """Build a rigid body in six coordinates: translation of its centre of mass and small rotation, basic axes."""
    M = np.zeros((6, 6))
    M[:3, :3], M[3:, 3:] = body.mass * np.eye(3), body.inertia
    places = {"cg": body.cg} | {name: face.position[0] for name, face in body.interfaces.items()}
    motion: dict[str, Matrix] = {}
    for label, x in places.items():
        rows = np.eye(6)
        rows[:3, 3:] = -cross_matrix(x - body.cg)
        motion[label] = rows
    every = np.ones(6, dtype=bool)

    def gyroscopic(momentum: Array) -> Array:
        G = np.zeros((6, 6))
        G[3:, 3:] = -cross_matrix(momentum)
        return G

    return Substructure(
        body.name,
        M,
        np.zeros((6, 6)),
        gyroscopic(body.momentum) if body.momentum.any() else None,
        None,
        np.eye(6),
        motion,
        dict.fromkeys(motion, every),
        dict.fromkeys(motion, np.eye(3)),
        {label: np.asarray(x, dtype=np.float64) for label, x in places.items()},
        body.interfaces,
        terms=tuple(ParameterTerm(name, "G", gyroscopic(vector)) for name, vector in body.spun.items()),
    )


def _without_rigid_drag(body: FEModel, alpha: float, beta: float, rigid: Array) -> Matrix:
    # alpha M would act on rigid motion; material damping does not.
    if body.n > _DENSE_LIMIT:
        raise DampingError(
            f"body '{body.name}': Rayleigh damping with alpha > 0 acts on rigid motion, and removing this from a free "
            f"body of {body.n} dofs in its own dofs is not supported above {_DENSE_LIMIT}; use its modes, or alpha = 0"
        )
    momentum = body.M @ rigid
    return np.asarray(alpha * (body.M.toarray() - momentum @ momentum.T) + beta * body.K.toarray())


def _motions(
    body: FEModel, shapes: Matrix | sp.csr_array, points: Iterable[str]
) -> tuple[Mapping[str, Matrix], Mapping[str, NDArray[np.bool_]], Mapping[str, Array], Mapping[str, Array]]:
    turns: dict[str, Array] = {}
    has: dict[str, NDArray[np.bool_]] = {}
    axes: dict[str, Array] = {}
    position: dict[str, Array] = {}
    known, every = body.recovery, [np.empty(0, dtype=np.int64)]
    for node in _nodes_of(body, points):
        label = str(node)
        rows = known.dofs.rows(node, np.arange(1, 7))
        here = rows >= 0
        scalar = known.dofs.rows(node, SCALAR)[0]
        if scalar >= 0:
            # A scalar point has one motion without a frame, here x.
            rows[0], here[0] = scalar, True
        if not here.any():
            raise SceneError(f"body '{body.name}': node {node} has no dofs in the matrices")
        frame, xyz = _geometry(body, node)
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = frame.T
        every.append(rows[here])
        turns[label], has[label], axes[label], position[label] = turn[:, here], here, frame, xyz
    # All points at once: a product for each would read all shapes again.
    T = known.T[np.concatenate(every)]
    ends, motion = np.cumsum([rows.size for rows in every]), dict[str, Matrix]()
    if isinstance(shapes, sp.sparray):
        moved = sp.csr_array(T @ shapes)
        for (label, turn), part in zip(turns.items(), pairwise(ends), strict=True):
            motion[label] = sp.csc_array(sp.csc_array(turn) @ moved[slice(*part)])
    else:
        seen = observed(T, np.asarray(shapes))
        for (label, turn), part in zip(turns.items(), pairwise(ends), strict=True):
            motion[label] = turn @ seen[slice(*part)]
    return motion, has, axes, position


def _nodes_of(body: FEModel, points: Iterable[str]) -> list[int]:
    nodes: dict[int, None] = {}
    for point in points:
        if point in body.interfaces:
            nodes.update(dict.fromkeys(int(node) for node in body.interfaces[point].node))
        elif point.lstrip("-").isdigit():
            if not (body.recovery.dofs.node == int(point)).any():
                raise SceneError(f"'{body.name}.{point}': the body has no node {point} in its matrices")
            nodes[int(point)] = None
        else:
            faces = ", ".join(body.interfaces) or "none"
            raise SceneError(f"'{body.name}.{point}' is neither a node id nor an interface (interfaces: {faces})")
    return list(nodes)


def _geometry(body: FEModel, node: int) -> tuple[Array, Array]:
    at = -1 if body.nodes is None else int(body.nodes.index(node)[0])
    if body.nodes is None or at < 0:
        return np.eye(3), np.zeros(3)
    return body.nodes.frame[at], body.nodes.xyz[at]
