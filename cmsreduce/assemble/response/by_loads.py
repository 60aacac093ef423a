"""Responses of many outputs: first the forces in the joints, then the motions that these and the inputs cause.

The flexibilities between every output and every joint force, of which there may be many times more than responses, are
not formed.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.response.by_rows import MANY, ByRows, add_between, frequencies_last
from cmsreduce.assemble.response.receptance import Receptance
from cmsreduce.assemble.response.residual_flexibility import JoinedRows
from cmsreduce.linalg.response import frequency_blocks

__all__ = ["by_loads", "sees_much"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Ints = NDArray[np.int64]

# Rows on the right for each input, from which on the responses are fewer than the flexibilities.
_FEWER = 2
# Memory of the responses of a block of frequencies.
_BLOCK_BYTES = 2**24


def sees_much(joined: JoinedRows, receptances: Mapping[str, Receptance], columns: Mapping[str, Ints]) -> bool:
    """True if a configuration has many outputs for its inputs and joints, on a body whose rows are formed alone."""
    rows, forces = joined.shape
    if rows - joined.c < MANY or _FEWER * (forces - joined.c) > forces:
        return False
    sides = {name: (joined.left[:, own], joined.right[:, own]) for name, own in columns.items()}
    return any(isinstance(of, ByRows) and of.has_fewer([sides[name]]) for name, of in receptances.items())


def by_loads(
    joined: JoinedRows, receptances: Mapping[str, Receptance], columns: Mapping[str, Ints], grid: Real
) -> Complex:
    """Responses (f, outputs, inputs) of one configuration.

    Parameters
    ----------
    joined : JoinedRows
        Joints, inputs and outputs.
    receptances : mapping of body to Receptance
    columns : mapping of body to (p,) int64
        Columns of the body's motions in the rows.
    grid : (f,) float64
        Circular frequencies in rad/s.

    Raises
    ------
    LinAlgError
        If the joints are not independent in the motions of the bodies.
    """
    c, (rows, forces) = joined.c, joined.shape
    H = np.empty((grid.size, joined.outputs, forces - c), dtype=np.complex128)
    for part in frequency_blocks(grid.size, 16 * (c * forces + 3 * rows * (forces - c)), _BLOCK_BYTES):
        omega = grid[part]
        held = np.zeros((c, forces, omega.size), dtype=np.complex128)
        moved = np.zeros((rows - c, forces - c, omega.size), dtype=np.complex128)
        whole: dict[str, Complex] = {}
        for name, own in columns.items():
            of, left, right = receptances[name], joined.left[:, own], joined.right[:, own]
            if isinstance(of, ByRows) and of.has_fewer([(left, right)]):
                of.add(held, left[:c], right, omega)
            else:
                whole[name] = frequencies_last(of(omega))
                add_between(held, left[:c], whole[name], right)
        at = held.transpose(2, 0, 1)
        inner = np.linalg.solve(at[:, :, :c], at[:, :, c:]).transpose(1, 2, 0)
        one = np.broadcast_to(np.eye(forces - c)[:, :, None], (forces - c, forces - c, omega.size))
        loads = np.ascontiguousarray(np.concatenate([-inner, one]))
        for name, own in columns.items():
            of, left, right = receptances[name], joined.left[c:, own], joined.right[:, own]
            if name in whole:
                add_between(moved, left, whole[name], right, loads)
            elif isinstance(of, ByRows):
                of.add(moved, left, right, omega, loads)
        H[part] = joined.measured(moved.transpose(2, 0, 1), omega)
    return H
