"""Responses of joined bodies that keep some of their modes: every mode is one term of its body's receptance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.response.modal_terms import (
    Change,
    Columns,
    CoupledModes,
    CoupledTerms,
    Kept,
    ModalTable,
    ModalTerms,
    add_terms,
)
from cmsreduce.assemble.response.receptance import Receptance, add_between, frequencies_last, modal_weights, resonant
from cmsreduce.assemble.system import Wiring
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import row_basis
from cmsreduce.linalg.response import ResonanceError, frequency_blocks
from cmsreduce.model import Substructure

__all__ = ["ModalReceptance"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.int64]

# Memory of the flexibilities of the frequencies taken at a time.
_BLOCK_BYTES = 2**27
# Changes of modes by themselves, of modes of one cluster, and all others.
_SINGLE, _COUPLED, _MIXED = range(3)


class ModalReceptance:
    """Response in one configuration at fixed frequencies, for any choice of the bodies' modes.

    What a mode adds to its body's receptance does not depend on the other modes kept. It is tabulated once, and a
    choice of modes costs a sum and a solve with as many unknowns as there are joint forces. Modes that a damping
    matrix couples have no such terms: their receptance is solved anew for every choice, cluster by cluster.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies with all modes that may be kept.
    wiring : Wiring
        Joints, inputs and outputs in the configuration.
    omega : (f,) float64
        Circular frequencies in rad/s, none of them zero if a body floats.
    whole : mapping of name to Receptance
        Receptances of the bodies over the motions that these have; those of bodies that are not in modes are asked for
        once.

    Raises
    ------
    MatrixError
        If a frequency hits a mode without damping.
    """

    def __init__(
        self, substructures: Mapping[str, Substructure], wiring: Wiring, omega: Real, whole: Mapping[str, Receptance]
    ) -> None:
        self.omega, self._substructures = omega, substructures
        stack = PointStack(substructures)
        self._displacement, self._rate = (np.flatnonzero(rows.any(axis=1)) for rows in (wiring.C1, wiring.C2))
        self._outputs = wiring.C1.shape[0]
        self._left = np.vstack([wiring.A, wiring.C1[self._displacement], wiring.C2[self._rate]])
        self._right = np.vstack([wiring.A, wiring.B])
        self._c = wiring.A.shape[0]
        self._tables: dict[str, ModalTable] = {}
        self._coupled: dict[str, CoupledModes] = {}
        self._motions = {name: dense(stack.motions(name)) for name in substructures}
        self._columns = {name: stack.body_columns(name) for name in substructures}
        self._always = {name: _always(sub) for name, sub in substructures.items()}
        # Frequencies last, as products over all of them leave them.
        self._base = np.zeros((self._left.shape[0], self._right.shape[0], omega.size), dtype=np.complex128)
        for name, sub in substructures.items():
            here, L = self._columns[name], self._motions[name]
            left, right = self._left[:, here], self._right[:, here]
            if sub.omega is None:
                moving = stack.moving(name)
                add_between(self._base, left[:, moving], frequencies_last(whole[name](omega)), right[:, moving])
            else:
                self._coupled[name] = CoupledModes.of(sub, left @ L, right @ L)
                table = ModalTable(left @ L, right @ L, _weights(sub, self._single(name), omega))
                self._tables[name] = table
                add_terms(self._base, table, self._single(name, self._always[name]))
        self._basis = self._row_basis({name: np.arange(sub.m) for name, sub in substructures.items()})
        # Joints that the motions present in every choice already tell apart need no look at each choice.
        alone = self._row_basis({name: np.empty(0, dtype=np.int64) for name in substructures})
        self._same_joints = alone.shape[0] == self._basis.shape[0]

    def response(self, kept: Kept, at: Indices | None = None) -> Complex:
        """Response with some of the modes, rigid-body part included.

        Parameters
        ----------
        kept : mapping of body to (k,) int64
        at : (g,) int64, optional
            Which of the frequencies, all of them if left out.

        Returns
        -------
        H : (g, outputs, inputs) complex128
        """
        points = np.arange(self.omega.size) if at is None else at
        U = self._joints(kept)
        H = np.empty((points.size, self._outputs, self._right.shape[0] - self._c), dtype=np.complex128)
        for part, part_points in self._blocks(points):
            AYA, AYB, CYA, CYB = self._joined(kept, U, part_points)
            H[part] = CYB - CYA @ np.linalg.solve(AYA, AYB) if U.shape[0] else CYB
        return H

    def effects(self, kept: Kept, changes: Sequence[Change], at: Indices) -> tuple[Complex, Complex, NDArray[np.bool_]]:
        """Response with some of the modes, and what each of many changes alone would add to it.

        Parameters
        ----------
        kept : mapping of body to (k,) int64
        changes : sequence of Change
        at : (g,) int64
            Which of the frequencies.

        Returns
        -------
        H : (g, outputs, inputs) complex128
        dH : (g, outputs, inputs, n) complex128
            NaN where it is not known.
        known : (n,) bool
            False for changes that take away what a joint rests on, and for those of several modes of which some are
            coupled to others and some are not: ``response`` has to be asked.

        Notes
        -----
        Modes with weights 1/Z and motions v are put in (s = 1) or left out (s = -1) by an update of low rank of the
        joined flexibility, dH = (C Y v) (s Z + v^T Y v)^-1 (B Y v)^T, where Y is that of the joined bodies: Sherman,
        Morrison and Woodbury. Coupled modes take those beside them along, so that their v depends on the frequency.
        """
        U = self._joints(kept)
        inputs = self._right.shape[0] - self._c
        H = np.empty((at.size, self._outputs, inputs), dtype=np.complex128)
        dH = np.full((at.size, self._outputs, inputs, len(changes)), np.nan + 0j)
        # A change may join what the modes kept leave apart.
        known = np.full(len(changes), U.shape[0] == self._basis.shape[0])
        present = {name: self._present(name, kept) for name in self._coupled}
        sort = np.array([self._sort(body, columns, present) for body, columns in changes], dtype=np.int64)
        known &= sort != _MIXED
        terms = ModalTerms.of(self._tables, changes, np.flatnonzero(known & (sort == _SINGLE)), kept)
        alpha, gamma, beta = U @ terms.left[: self._c], terms.left[self._c :], terms.right[self._c :]
        coupled = np.flatnonzero(known & (sort == _COUPLED))
        columns = alpha.shape[1] + sum(changes[int(k)][1].size for k in coupled)
        for part, points in self._blocks(at, (3 + inputs) * columns * (self._c + self._outputs) + columns**2):
            AYA, AYB, CYA, CYB = self._joined(kept, U, points)
            S = np.linalg.inv(AYA)
            H[part] = CYB - CYA @ (S @ AYB)
            Sv = _times(S, alpha)
            P = self._output_rows(np.broadcast_to(gamma, (points.size, *gamma.shape)), points) - CYA @ Sv
            Q = beta - AYB.transpose(0, 2, 1) @ Sv
            terms.update(dH, known, part, 1 / terms.weights(points), alpha, Sv, P, Q)
            for more in CoupledTerms.of(self._coupled, changes, coupled, present, self.omega[points]):
                own = U @ more.left[:, : self._c]
                Sv = S @ own
                P = self._output_rows(more.left[:, self._c :], points) - CYA @ Sv
                Q = more.right[:, self._c :] - AYB.transpose(0, 2, 1) @ Sv
                more.update(dH, known, part, own, Sv, P, Q)
        dH[..., ~known] = np.nan
        return H, dH, known

    def _blocks(self, points: Indices, more: int = 0) -> Iterator[tuple[slice, Indices]]:
        entries = 3 * self._left.shape[0] * self._right.shape[0] + more
        entries += sum(3 * cluster.size**2 for body in self._coupled.values() for cluster in body.clusters)
        for part in frequency_blocks(points.size, 16 * entries, _BLOCK_BYTES):
            yield part, points[part]

    def _joints(self, kept: Kept) -> Real:
        return self._basis if self._same_joints else self._row_basis(kept)

    def _row_basis(self, kept: Kept) -> Real:
        # As in the coupling of whole bodies: joints that lock one motion of the bodies twice count once.
        A = self._left[: self._c]
        rows = [
            A[:, self._columns[name]] @ L[:, self._present(name, kept)] for name, L in self._motions.items() if L.size
        ]
        return row_basis(np.hstack([np.zeros((self._c, 0)), *rows]))

    def _present(self, name: str, kept: Kept) -> NDArray[np.bool_]:
        present = self._always[name].copy()
        present[kept[name] if name in kept else slice(None)] = True
        return present

    def _single(self, name: str, among: NDArray[np.bool_] | None = None) -> Columns:
        """Coordinates that nothing couples, all or some."""
        single = np.ones(self._substructures[name].m, dtype=bool) if among is None else among.copy()
        single[self._coupled[name].columns] = False
        return np.flatnonzero(single)

    def _sort(self, body: str, columns: Columns, present: Mapping[str, NDArray[np.bool_]]) -> int:
        """Whether a change is one of modes by themselves, of a cluster, or something else."""
        if body not in self._coupled:
            return _MIXED
        clusters = [cluster for cluster in self._coupled[body].clusters if np.isin(columns, cluster).any()]
        if not clusters:
            return _SINGLE
        alike = present[body][columns]
        return _COUPLED if np.isin(columns, clusters[0]).all() and alike.all() == alike.any() else _MIXED

    def _joined(self, kept: Kept, U: Real, points: Indices) -> tuple[Complex, Complex, Complex, Complex]:
        """Flexibilities between joint forces and inputs, and joint motions and outputs, at some frequencies."""
        last = self._base[..., points]
        presence = {name: self._present(name, kept) for name in self._tables}
        for name, table in self._tables.items():
            add_terms(last, table, self._single(name, presence[name] & ~self._always[name]), points)
        G = np.ascontiguousarray(last.transpose(2, 0, 1))
        for name, body in self._coupled.items():
            if body.clusters:
                G += body.flexibility(presence[name], self.omega[points])
        c = self._c
        C = self._output_rows(G[:, c:], points)
        AYA, AYB = U @ G[:, :c, :c] @ U.T, U @ G[:, :c, c:]
        return np.asarray(AYA), np.asarray(AYB), np.asarray(C[:, :, :c] @ U.T), C[:, :, c:]

    def _output_rows(self, rows: Real | Complex, points: Indices) -> Complex:
        """Outputs from the rows that measure displacements and those that measure rates."""
        out = np.zeros((points.size, self._outputs, rows.shape[2]), dtype=np.complex128)
        d = self._displacement.size
        out[:, self._displacement] = rows[:, :d]
        out[:, self._rate] += 1j * self.omega[points, None, None] * rows[:, d:]
        return out


def _always(sub: Substructure) -> NDArray[np.bool_]:
    """Coordinates that every choice keeps: rigid and static modes, and all of a body that has no modes."""
    if sub.omega is None:
        return np.ones(sub.m, dtype=bool)
    return np.asarray((sub.omega == 0) | np.isinf(sub.omega))


def _times(S: NDArray[Any], alpha: Real) -> Complex:
    """Complex matrices at every frequency times one real matrix."""
    f, c = S.shape[:2]
    rows = S.reshape(f * c, c)
    return np.asarray((rows.real @ alpha + 1j * (rows.imag @ alpha)).reshape(f, c, alpha.shape[1]))


def _weights(sub: Substructure, columns: Columns, omega: Real) -> Complex:
    """Amplitudes of modes by themselves (m, f), and zeros for the others."""
    every = np.zeros((sub.m, omega.size), dtype=np.complex128)
    try:
        every[columns] = modal_weights(sub, omega, columns).T
    except ResonanceError as error:
        raise resonant(sub, error) from None
    return every
