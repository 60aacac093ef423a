"""Bodies as responses need them: held by the ground in their own coordinates, moved only where the scene holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble.constraint_space import ConstraintSpace, congruent_damping, constraint_space
from cmsreduce.assemble.joints import ground_rows
from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.system import Wiring
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import DEPENDENT, null_space
from cmsreduce.model import Matrix, Scene, Substructure

__all__ = ["HeldBodies", "held_bodies", "points_named"]


@dataclass(frozen=True, eq=False)
class HeldBodies:
    """Bodies, some of which are without the motions that the ground locks.

    Parameters
    ----------
    stack : PointStack
        Their points, in the same order as without the ground. Points that the scene does not name stand still.
    names : frozenset of str
        Bodies that are held.
    """

    stack: PointStack
    names: frozenset[str]

    @property
    def substructures(self) -> Mapping[str, Substructure]:
        """All bodies in their order."""
        return self.stack.substructures

    def wiring(self, wiring: Wiring) -> Wiring:
        """Remove the constraints of the ground, the only ones that lie within a held body."""
        entries = wiring.A != 0
        every, within = entries.sum(axis=1), np.zeros(wiring.A.shape[0], dtype=bool)
        for name in self.names:
            here = entries[:, self.stack.body_columns(name)].sum(axis=1)
            within |= (here > 0) & (here == every)
        return replace(wiring, A=wiring.A[~within])


def held_bodies(stack: PointStack, scene: Scene, *, in_modes: bool = True) -> HeldBodies:
    """Remove the motions that the ground locks from the coordinates of the bodies, and those of points without use.

    If redundant constraints are dropped, no body is held: a motion that a joint and the ground lock twice, to the
    digits of a deck, would leave a row of these digits.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    scene : Scene
        The scene with its ground.
    in_modes : bool
        Bodies in modes may be held, too. The receptance of such a body is then no longer a sum over modes; where more
        of its motions are locked than free, solving for the others takes less time than the sum.
    """
    locked: dict[str, list[NDArray[np.float64]]] = {}
    for point in scene.ground if scene.redundant == "refuse" else ():
        own = stack.body_columns(point.body)
        locked.setdefault(point.body, []).extend(row[own] for row, _ in ground_rows(stack, point))
    bodies = dict(stack.substructures)
    held = {name: rows for name, rows in locked.items() if _pays(bodies[name], len(rows), in_modes)}
    for name, rows in held.items():
        bodies[name] = _held(bodies[name], stack.motions(name), np.array(rows))
    return HeldBodies(PointStack({name: _named_only(sub, scene) for name, sub in bodies.items()}), frozenset(held))


def points_named(sub: Substructure, scene: Scene) -> set[str]:
    """Labels of the points of a body that a scene names; those of a joint's own body are all joined."""
    if sub.name not in scene.bodies:
        return set(sub.motion)
    named: set[str] = set()
    for point in scene.points():
        if point.body == sub.name:
            face = sub.interfaces.get(point.name)
            named.update([point.name] if face is None else sub.point_labels(face))
    return named


def _named_only(sub: Substructure, scene: Scene) -> Substructure:
    """Body without the motions of points that the scene does not name: an interface kept for later has hundreds."""
    named = points_named(sub, scene)
    if named.issuperset(sub.motion):
        return sub
    motion = {
        label: rows if label in named else sp.csc_array(rows.shape) if sp.issparse(rows) else np.zeros(rows.shape)
        for label, rows in sub.motion.items()
    }
    return replace(sub, motion=motion)


def _pays(sub: Substructure, locked: int, in_modes: bool) -> bool:
    if sub.rigid.shape[1] == sub.m:
        return False
    return sub.omega is None or (in_modes and sub.m <= 2 * locked)


def _held(sub: Substructure, motions: Matrix, locked: NDArray[np.float64]) -> Substructure:
    """Remove from one body the motions that are locked by rows (c, p) over its points."""
    A = sp.csr_array(locked @ motions)
    space = constraint_space(A)
    T = space.T
    left, _ = null_space(dense(A @ sub.rigid))
    return Substructure(
        sub.name,
        space.congruent([sub.M]),
        space.congruent([sub.K]),
        _congruent(space, sub.D),
        _congruent(space, sub.loss),
        np.asarray(T.T @ (sub.rigid @ left)),
        {label: _free(rows, rows @ T) for label, rows in sub.motion.items()},
        sub.has,
        sub.axes,
        sub.position,
        sub.interfaces,
        rounding=sub.rounding,
        terms=tuple(replace(term, matrix=congruent_damping(space, [term.matrix])) for term in sub.terms),
    )


def _free(before: Matrix, after: Matrix) -> Matrix:
    """Motions of a point, exactly zero where they are locked."""
    size, left = (np.linalg.norm(dense(rows), axis=1) for rows in (before, after))
    moves = np.where(left > DEPENDENT * size, 1.0, 0.0)
    return sp.csc_array(sp.diags_array(moves) @ after) if sp.issparse(after) else moves[:, None] * after


def _congruent(space: ConstraintSpace, A: Matrix | None) -> Matrix | None:
    return None if A is None else congruent_damping(space, [A])
