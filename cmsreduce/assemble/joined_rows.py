"""What joins, drives and measures the bodies of a scene, as rows over the motions of their points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.system import Wiring
from cmsreduce.linalg.dense import dense
from cmsreduce.linalg.null_space import row_basis

__all__ = ["JoinedRows"]


@dataclass(frozen=True, eq=False)
class JoinedRows:
    """Joints, inputs and outputs of one configuration.

    Parameters
    ----------
    left : (c + displacements + rates, size) float64
        Independent constraints, then the outputs that measure anything.
    right : (c + inputs, size) float64
        The same constraints, then the inputs.
    c, outputs : int
        Constraints; outputs, silent ones too.
    displacement, rate : tuple of int
        Which outputs the last rows on the left are.
    """

    left: NDArray[np.float64]
    right: NDArray[np.float64]
    c: int
    outputs: int
    displacement: tuple[int, ...]
    rate: tuple[int, ...]

    @classmethod
    def of(cls, wiring: Wiring, stack: PointStack) -> JoinedRows:
        """Take the rows of a configuration that count."""
        # Joints that lock the same motion of a reduced body twice would leave lambda undetermined.
        A = row_basis(dense(stack.spread(wiring.A))) @ wiring.A
        displacement, rate = (np.flatnonzero(rows.any(axis=1)) for rows in (wiring.C1, wiring.C2))
        left = np.vstack([A, wiring.C1[displacement], wiring.C2[rate]])
        measured = tuple(displacement.tolist()), tuple(rate.tolist())
        return cls(left, np.vstack([A, wiring.B]), A.shape[0], wiring.C1.shape[0], *measured)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows on the left and on the right."""
        return self.left.shape[0], self.right.shape[0]

    def response(self, G: NDArray[np.complex128], omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Outputs under unit inputs (f, outputs, inputs), from the flexibility of the bodies between all rows."""
        c = self.c
        both = G[:, c:, c:]
        if c:
            both = both - G[:, c:, :c] @ np.linalg.solve(G[:, :c, :c], G[:, :c, c:])
        return self.measured(both, omega)

    def measured(self, both: NDArray[np.complex128], omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Outputs (f, outputs, inputs), from what the rows that measure anything answer: rates are i w times these."""
        H = np.zeros((omega.size, self.outputs, both.shape[2]), dtype=np.complex128)
        d = len(self.displacement)
        H[:, self.displacement] = both[:, :d]
        H[:, self.rate] += 1j * omega[:, None, None] * both[:, d:]
        return H
