"""Points at which bodies are joined, driven and measured, and their place in one stacked vector of motions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import DEPENDENT
from cmsreduce.model import Matrix, Point, Substructure

__all__ = ["PointStack", "balanced", "carried"]


class PointStack:
    """Six motions x y z rx ry rz of every point of every body, stacked.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies in order.
    """

    def __init__(self, substructures: Mapping[str, Substructure]) -> None:
        self.substructures = substructures
        self._start: dict[tuple[str, str], int] = {}
        self._motions: dict[str, Matrix] = {}
        self._moving: dict[str, NDArray[np.int64]] = {}
        self._sampled: dict[str, NDArray[np.float64]] = {}
        for name, sub in substructures.items():
            for label in sub.motion:
                self._start[name, label] = 6 * len(self._start)

    @property
    def size(self) -> int:
        """Length of the stacked vector of motions."""
        return 6 * len(self._start)

    def label(self, point: Point) -> str:
        """Label of a point in its body's motions: the first node of an interface, a node id, or ``cg``."""
        sub = self.substructures[point.body]
        if point.name in sub.interfaces and point.name not in sub.motion:
            return sub.point_labels(sub.interfaces[point.name])[0]
        if point.name not in sub.motion:
            known = ", ".join([*sub.interfaces, *(label for label in sub.motion if label not in sub.interfaces)])
            raise SceneError(f"'{point}': component '{point.body}' has no such point (known here: {known})")
        return point.name

    def columns(self, body: str, label: str) -> slice:
        """Columns of one point's six motions."""
        first = self._start[body, label]
        return slice(first, first + 6)

    def body_columns(self, body: str) -> slice:
        """Columns of all points of one body."""
        labels = list(self.substructures[body].motion)
        if not labels:
            return slice(0, 0)
        return slice(self.columns(body, labels[0]).start, self.columns(body, labels[-1]).stop)

    def motions(self, body: str) -> Matrix:
        """Motions of all points of one body from its coordinates, (6 points, m)."""
        if body not in self._motions:
            self._motions[body] = _stacked(self.substructures[body])
        return self._motions[body]

    def moving(self, body: str) -> NDArray[np.int64]:
        """Numbers of the motions that a body has: solids have no rotations, and the ground locks others."""
        if body not in self._moving:
            entries = sp.coo_array(self.motions(body))
            self._moving[body] = np.unique(entries.row[entries.data != 0]).astype(np.int64)
        return self._moving[body]

    def sampled(self, body: str) -> NDArray[np.float64]:
        """Motions of all points of one body in one arbitrary motion of its coordinates, (points, 6)."""
        if body not in self._sampled:
            L = self.motions(body)
            self._sampled[body] = dense(L @ np.random.default_rng(0).standard_normal((L.shape[1], 1))).reshape(-1, 6)
        return self._sampled[body]

    def spread(self, rows: NDArray[np.float64]) -> sp.csr_array:
        """Rows over the stacked coordinates of all bodies, from rows over the stacked motions."""
        own = [(rows[:, self.body_columns(name)], self.motions(name)) for name in self.substructures]
        if any(sp.issparse(L) for _, L in own):
            return sp.csr_array(sp.hstack([sp.csr_array(part) @ sp.csr_array(L) for part, L in own]))
        # For bodies in a few modes, sparse products would take most of their time for indices.
        return sp.csr_array(np.hstack([part @ np.asarray(L) for part, L in own]))


def balanced(rows: NDArray[np.float64], shapes: Matrix) -> NDArray[np.float64]:
    """Constraints (c, k) on motions of a body, scaled by one number: its heavy modes count as those of a light body.

    Parameters
    ----------
    rows : (c, p) float64
        Constraints over the motions of the body's points.
    shapes : (p, k) Matrix
        Motions of the points.
    """
    # The largest sum of absolute terms: what cancels is not made large.
    terms: Matrix = np.abs(rows) @ abs(shapes)
    size = float(dense(terms).max(initial=0.0))
    return np.asarray(dense(rows @ shapes) / (size or 1.0))


def carried(stack: PointStack, A: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of channels in which each point that a joined point carries, as a rigid tie does, is that joined point.

    What two points of a flexible body do in one arbitrary motion of it shows whether one carries the other.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    A : (c, size) float64
        Constraints over the stacked motions; a point is joined if it has an entry.
    rows : (r, size) float64
        Channels over the stacked motions.
    """
    rows = rows.copy()
    joined, measured = ((each != 0).reshape(len(each), stack.size // 6, 6).any(axis=(0, 2)) for each in (A, rows))
    for name, sub in stack.substructures.items():
        own = stack.body_columns(name)
        points = slice(own.start // 6, own.stop // 6)
        others, carriers = np.flatnonzero(measured[points] & ~joined[points]), np.flatnonzero(joined[points])
        if not (others.size and carriers.size):
            continue
        part = rows[:, own].reshape(len(rows), -1, 6)
        x, u = np.array([sub.position[label] for label in sub.motion]), stack.sampled(name)
        for q in carriers:
            arm = x[others] - x[q]
            for these, moved in ((np.s_[:3], u[q, :3] + np.cross(u[q, 3:], arm)), (np.s_[3:], u[q, 3:])):
                off, size = (np.linalg.norm(each, axis=1) for each in (u[others, these] - moved, u[others, these]))
                for p in others[np.asarray((off <= DEPENDENT * size) & (size > 0), dtype=bool)]:
                    weights = part[:, p, these].copy()
                    part[:, p, these] = 0.0
                    part[:, q, these] += weights
                    if these == np.s_[:3]:
                        part[:, q, 3:] += np.cross(x[p] - x[q], weights)
        rows[:, own] = part.reshape(len(rows), -1)
    return rows


def _stacked(sub: Substructure) -> Matrix:
    parts = list(sub.motion.values())
    if not parts:
        return np.zeros((0, sub.m))
    if any(sp.issparse(part) for part in parts):
        return sp.csc_array(sp.vstack([sp.csc_array(part) for part in parts]))
    return np.vstack([np.asarray(part) for part in parts])
