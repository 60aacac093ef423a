"""Small scenes of frames and rigid bodies, and their response solved directly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from cmsreduce.assemble import modal_substructure, physical_substructure, rigid_substructure
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import (
    DOF_NAMES,
    Channel,
    FEModel,
    Interface,
    Joint,
    JointTerm,
    Placement,
    Point,
    PointTerm,
    RigidBody,
    StrutTerm,
    Substructure,
    System,
    rigid_body_shapes,
)
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton

ALL = 1e9  # Hz: every mode is kept


def points_of(body: FEModel, extra: Iterable[object] = ()) -> list[str]:
    return list(dict.fromkeys([*body.interfaces, *map(str, extra)]))


def rigid_modes(body: FEModel) -> np.ndarray:
    R = None if body.nodes is None else rigid_body_shapes(body.dofs, body.nodes)
    return rigid_body_modes(body.K, body.M, R, body.rounding, body.name)


def physical(body: FEModel, extra: Iterable[object] = ()) -> Substructure:
    return physical_substructure(body, points_of(body, extra), rigid_modes(body))


def modal(body: FEModel, cutoff_hz: float = ALL, extra: Iterable[object] = ()) -> Substructure:
    rows = [body.interface_rows(name) for name in body.interfaces]
    component = CraigBampton(cutoff_hz).reduce(body, np.concatenate(rows) if rows else ())
    return modal_substructure(orthogonalise(component), points_of(body, extra))


def rigid_body(
    name: str,
    mass: float,
    cg: Sequence[float],
    inertia: Sequence[float] | np.ndarray,
    faces: Mapping[str, Sequence[float]],
    frame: np.ndarray | None = None,
    dofs: tuple[int, ...] = (1, 2, 3, 4, 5, 6),
) -> RigidBody:
    J = np.asarray(inertia, dtype=float)
    axes = np.eye(3) if frame is None else frame
    return RigidBody(
        name,
        mass,
        np.asarray(cg, dtype=float),
        np.diag(J) if J.ndim == 1 else J,
        {
            label: Interface(label, np.array([-1]), (dofs,), np.array([x], dtype=float), axes, np.eye(3)[None])
            for label, x in faces.items()
        },
    )


def substructures(bodies: Iterable[FEModel | RigidBody], extra: Iterable[object] = ()) -> dict[str, Substructure]:
    return {
        body.name: rigid_substructure(body) if isinstance(body, RigidBody) else physical(body, extra) for body in bodies
    }


def joint(name: str, first: str, second: str, free: str = "", **options: object) -> Joint:
    """``free`` names motions, as in ``"x rz"``."""
    motions = frozenset(DOF_NAMES.index(word) for word in free.split())
    return Joint(name, Point(*first.split(".")), Point(*second.split(".")), motions, **options)  # type: ignore[arg-type]


def at(point: str, direction: Sequence[float] | str, name: str = "", rate: bool = False) -> Channel:
    """Channel on one point; a direction is a motion's name or six weights."""
    weights = np.eye(6)[DOF_NAMES.index(direction)] if isinstance(direction, str) else np.asarray(direction, float)
    quantity = "rotation" if np.any(weights[3:]) else "translation"
    return Channel(name or f"{point} {direction}", (PointTerm(Point(*point.split(".")), weights),), quantity, rate)


def in_joint(name: str, dof: str, rate: bool = False) -> Channel:
    k = DOF_NAMES.index(dof)
    return Channel(f"{name} {dof}", (JointTerm(name, k),), "rotation" if k > 2 else "translation", rate)


def strut(a: str, b: str) -> Channel:
    return Channel(f"{a} to {b}", (StrutTerm(Point(*a.split(".")), Point(*b.split("."))),), "translation")


def direct(system: System, omega: np.ndarray) -> np.ndarray:
    """Response solved from the assembled matrices, one frequency after the other."""
    M, K, D, loss = (
        np.zeros((system.N, system.N)) if A is None else np.asarray(A.toarray() if hasattr(A, "toarray") else A)
        for A in (system.M, system.K, system.D, system.loss)
    )
    return np.array(
        [
            (system.C1 + 1j * w * system.C2) @ np.linalg.solve(K - w**2 * M + 1j * (loss + w * D), system.B + 0j)
            for w in omega
        ]
    )


def turned(body: RigidBody, Q: np.ndarray, t: Sequence[float]) -> tuple[RigidBody, Placement]:
    """The same body written in a basic frame of its own, and the placement that brings it back: x = Q x' + t."""
    back = lambda x: (np.asarray(x) - t) @ Q  # noqa: E731
    faces = {
        label: Interface(label, face.node, face.components, back(face.position), face.frame @ Q, face.node_axes @ Q)
        for label, face in body.interfaces.items()
    }
    moved = RigidBody(body.name, body.mass, back(body.cg), Q.T @ body.inertia @ Q, faces)
    return moved, Placement(Q, np.asarray(t, dtype=float))
