"""Bodies joined in a few shapes of each in one configuration: forces in the joints, response, and adjoint solutions.

Nothing here has the size of the outputs squared: outputs are many, forces in joints, shapes and inputs few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cmsreduce.project.body_modes import ShapeFlexibility
from cmsreduce.project.response_sample import ResponseSample

__all__ = ["BodyPart", "JoinedShapes"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A body in its shapes in one configuration: its rows of all, their motions (l, k), (r, k), and its flexibility."""

    name: str
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    left: Array
    right: Array
    Y: ShapeFlexibility

    @classmethod
    def of(cls, sample: ResponseSample, name: str, V: Array, Y: ShapeFlexibility) -> BodyPart:
        """A body in shapes V (n, k), of flexibility Y."""
        rows, columns = sample.touched[name]
        return cls(name, rows, columns, sample.left[name][rows] @ V, sample.right[name][columns] @ V, Y)


@dataclass(frozen=True, eq=False)
class JoinedShapes:
    """Joined bodies in one configuration.

    Parameters
    ----------
    sample : ResponseSample
    parts : sequence of BodyPart
        The bodies in their shapes.

    Raises
    ------
    LinAlgError
        If the joints are not independent in the motions that the shapes leave.
    """

    sample: ResponseSample
    parts: Sequence[BodyPart]

    def __post_init__(self) -> None:
        # Singular joints are met here.
        _ = self.loads

    @cached_property
    def _at_joints(self) -> Complex:
        """Flexibility of all bodies between the joint rows and all rows on the right (f, c, r)."""
        c = self.sample.c
        G = self.sample.rest[:, :c].copy()
        for part in self.parts:
            own = part.rows < c
            G[:, part.rows[own][:, None], part.columns] += part.Y.between(part.left[own], part.right)
        return G

    @property
    def between_joints(self) -> Complex:
        """Flexibility between the joint rows (f, c, c), symmetric: no body has gyroscopic forces."""
        return self._at_joints[:, :, : self.sample.c]

    @cached_property
    def loads(self) -> Complex:
        """Forces at the rows on the right under unit inputs (f, r, inputs): in the joints, and the inputs."""
        c = self.sample.c
        inner = -np.linalg.solve(self.between_joints, self._at_joints[:, :, c:])
        f, _, inputs = inner.shape
        return np.concatenate([inner, np.broadcast_to(np.eye(inputs), (f, inputs, inputs))], axis=1)

    @cached_property
    def primal(self) -> dict[str, Complex]:
        """Amplitudes of the shapes of each body under unit inputs (f, k, inputs)."""
        return {part.name: part.Y.amplitudes(part.right, self.loads[:, part.columns]) for part in self.parts}

    @cached_property
    def H(self) -> Complex:
        """Response (f, outputs, inputs), rigid-body part included."""
        c = self.sample.c
        moved = self.sample.rest[:, c:] @ self.loads
        for part in self.parts:
            own = part.rows >= c
            moved[:, part.rows[own] - c] += part.left[own] @ self.primal[part.name]
        return self.sample.measured(moved)

    @cached_property
    def _observed(self) -> Complex:
        """Forces in the joints under unit forces at the measured rows (f, c, l - c)."""
        c = self.sample.c
        G = self.sample.rest[:, c:, :c].copy()
        for part in self.parts:
            own, joint = part.rows >= c, part.columns < c
            G[:, part.rows[own][:, None] - c, part.columns[joint]] += part.Y.between(part.left[own], part.right[joint])
        return np.asarray(-np.linalg.solve(self.between_joints, G.transpose(0, 2, 1)))

    @cached_property
    def adjoint(self) -> dict[str, Complex]:
        """Amplitudes of the shapes of each body under unit efforts at the outputs (f, k, outputs)."""
        c, found = self.sample.c, {}
        for part in self.parts:
            one, own = np.eye(part.left.shape[1]), part.rows >= c
            joint = part.rows[~own]
            z = part.Y.between(one, part.left[~own]) @ self._observed[:, joint]
            z[:, :, part.rows[own] - c] += part.Y.between(one, part.left[own])
            found[part.name] = self.sample.by_output(z)
        return found

    def observed(self, rows: Array) -> Complex:
        """Forces on a body's motions (l, n) at the left rows, under unit efforts at the outputs (f, n, outputs)."""
        c = self.sample.c
        return self.sample.by_output(rows[:c].T @ self._observed + rows[c:].T)

    def swayed(self, efforts: Complex) -> tuple[Complex, dict[str, Complex]]:
        """Adjoint solution for efforts at the outputs (f, outputs, p).

        Returns
        -------
        forces : (f, l, p) complex128
            At the rows on the left.
        amplitudes : dict of body to (f, k, p) complex128
        """
        c, forces = self.sample.c, self.sample.forced(efforts)
        moved = self.sample.rest[:, c:, :c].transpose(0, 2, 1) @ forces
        found: dict[str, Complex] = {}
        for part in self.parts:
            own, joint = part.rows >= c, part.columns < c
            found[part.name] = part.Y.amplitudes(part.left[own], forces[:, part.rows[own] - c])
            moved[:, part.columns[joint]] += part.right[joint] @ found[part.name]
        inner: Complex = np.asarray(-np.linalg.solve(self.between_joints, moved))
        for part in self.parts:
            joint = part.rows < c
            held = part.Y.amplitudes(part.left[joint], inner[:, part.rows[joint]])
            found[part.name] = np.asarray(found[part.name] + held)
        return np.concatenate([inner, forces], axis=1), found
