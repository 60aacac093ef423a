"""Forces in the joints of long chains and trees of bodies.

A joint force moves the joints of its own two bodies alone. In a good order of the constraints their flexibility A Y A^T
is a narrow band around its diagonal, and a frequency costs work in proportion to the number of joints, not to its cube.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg.lapack as lapack
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.assemble.response.receptance import Receptance, add_flexibility
from cmsreduce.assemble.response.residual_flexibility import JoinedRows
from cmsreduce.linalg.response import frequency_blocks

__all__ = ["JointChain", "joint_chain"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Ints = NDArray[np.int64]

# For fewer constraints, or a band wider than this share of them, one dense solve for many frequencies takes less time:
# a chain of 8 bodies, 49 constraints and a width of 10, takes four fifths of it, 20 bodies a third.
_FEWEST = 45
_WIDEST = 1 / 4
# Memory of the bands of the frequencies solved at a time.
_BLOCK_BYTES = 2**26


@dataclass(frozen=True, eq=False)
class JointChain:
    """Joints of one configuration whose flexibility is a band.

    Parameters
    ----------
    joined : JoinedRows
        Joints, inputs and outputs.
    columns : mapping of body to (p,) int64
        Columns of the body's motions in the rows.
    place : (c,) int64
        Place of each constraint in the order of the band.
    width : int
        Entries of the band on either side of the diagonal.
    """

    joined: JoinedRows
    columns: Mapping[str, Ints]
    place: Ints
    width: int

    def response(self, receptances: Mapping[str, Receptance], omega: Real) -> Complex:
        """Outputs under unit inputs (f, outputs, inputs) at frequencies (f,) in rad/s.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the flexibility of the joints is singular at a frequency.
        """
        c, (rows, columns) = self.joined.c, self.joined.shape
        H = np.empty((omega.size, self.joined.outputs, columns - c), dtype=np.complex128)
        entries = c * (3 * self.width + 1) + c * (rows + columns - 2 * c)
        entries += 3 * max(own.size**2 for own in self.columns.values())
        for part in frequency_blocks(omega.size, 16 * entries, _BLOCK_BYTES):
            H[part] = self.joined.measured(self._motions(receptances, omega[part]), omega[part])
        return H

    def _motions(self, receptances: Mapping[str, Receptance], omega: Real) -> Complex:
        """Motions of the measuring rows under unit inputs (f, measured, inputs)."""
        c, b, (rows, columns) = self.joined.c, self.width, self.joined.shape
        f, measured, inputs = omega.size, rows - c, columns - c
        # Column j of the flexibility is band[:, j], with the entry of row i at 2 b + i - j; b more are for its factor.
        band = np.zeros((f, c, 3 * b + 1), dtype=np.complex128)
        driven = np.zeros((f, inputs, c), dtype=np.complex128)
        sensed = np.zeros((f, measured, c), dtype=np.complex128)
        both = np.zeros((f, measured, inputs), dtype=np.complex128)
        for name, own in self.columns.items():
            left, right = self.joined.left[:, own], self.joined.right[:, own]
            row, column = (np.flatnonzero(side.any(axis=1)) for side in (left, right))
            G = np.zeros((row.size, column.size, f), dtype=np.complex128)
            add_flexibility(G, left[row], receptances[name], right[column], omega)
            G = G.transpose(2, 0, 1)
            i, j = np.searchsorted(row, c), np.searchsorted(column, c)
            at, to = self.place[row[:i]], self.place[column[:j]]
            band[:, to, 2 * b + at[:, None] - to] += G[:, :i, :j]
            driven[:, column[j:] - c, at[:, None]] += G[:, :i, j:]
            sensed[:, row[i:, None] - c, to] += G[:, i:, :j]
            both[:, row[i:, None] - c, column[j:] - c] += G[:, i:, j:]
        for k in range(f):
            _, _, forces, info = lapack.zgbsv(b, b, band[k].T, driven[k].T, overwrite_ab=True, overwrite_b=True)
            if info:
                raise np.linalg.LinAlgError("Singular matrix")
            both[k] -= sensed[k] @ forces
        return both


def joint_chain(joined: JoinedRows, columns: Mapping[str, Ints]) -> JointChain | None:
    """Order the constraints of a configuration into a band; None where a dense solve takes less time.

    Parameters
    ----------
    joined : JoinedRows
        Joints, inputs and outputs.
    columns : mapping of body to (p,) int64
        Columns of the body's motions in the rows.
    """
    c = joined.c
    if c < _FEWEST:
        return None
    on = np.array([joined.left[:c, own].any(axis=1) for own in columns.values()], dtype=float)
    meets = sp.csr_array(on.T @ on)
    order = csgraph.reverse_cuthill_mckee(meets, symmetric_mode=True)
    place = np.empty(c, dtype=np.int64)
    place[order] = np.arange(c)
    row, column = meets.nonzero()
    width = int(abs(place[row] - place[column]).max())
    return JointChain(joined, columns, place, width) if width <= _WIDEST * c else None
