"""Responses of joined bodies with some of their modes: every mode is one term of its body's receptance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.points import PointStack, balanced
from cmsreduce.assemble.response.by_modes import modal_weights, resonant
from cmsreduce.assemble.response.by_rows import ModalTable, RowTerms, add_between, frequencies_last
from cmsreduce.assemble.response.modal_terms import (
    Change,
    Columns,
    CoupledModes,
    CoupledTerms,
    Kept,
    ModalTerms,
    eliminated,
)
from cmsreduce.assemble.response.receptance import Receptance
from cmsreduce.assemble.response.residual_flexibility import JoinedRows
from cmsreduce.assemble.system import Wiring
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import row_basis
from cmsreduce.linalg.response import ResonanceError, frequency_blocks
from cmsreduce.model import Substructure, is_gyroscopic

__all__ = ["ModalReceptance"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.int64]

# Memory of the flexibilities of the frequencies taken at a time: a selection of Galileo takes 30 % less time than with
# 2^27.
_BLOCK_BYTES = 2**23
# Changes of uncoupled modes, of modes of one cluster, and all others.
_SINGLE, _COUPLED, _MIXED = range(3)


class ModalReceptance:
    """Response in one configuration at fixed frequencies, for any choice of the bodies' modes.

    The term of a mode in its body's receptance does not depend on the other modes kept. It is tabulated once, and a
    choice of modes costs a sum and a solve with as many unknowns as there are joint forces. Modes that a damping matrix
    couples have no such terms: their receptance is solved for every choice, cluster by cluster.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies with all of their modes.
    wiring : Wiring
        Joints, inputs and outputs in the configuration.
    omega : (f,) float64
        Circular frequencies in rad/s, none of them zero if a body floats.
    whole : mapping of name to Receptance
        Receptances of the bodies over their motions; those of bodies that are not in modes are evaluated once.

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
        # Constraints that are independent in the motions of all modes.
        self._rows = JoinedRows.of(wiring, stack)
        self._tables: dict[str, ModalTable] = {}
        self._coupled: dict[str, CoupledModes] = {}
        self._motions = {name: dense(stack.motions(name)) for name in substructures}
        self._columns = {name: stack.body_columns(name) for name in substructures}
        # The updates below are for symmetric flexibilities.
        self._gyroscopic = any(is_gyroscopic(sub.D) for sub in substructures.values())
        self._always = {name: _always(sub) for name, sub in substructures.items()}
        # Frequencies are the last axis, as in the products over all of them.
        self._base = np.zeros((self._rows.left.shape[0], self._rows.right.shape[0], omega.size), dtype=np.complex128)
        for name, sub in substructures.items():
            here, L = self._columns[name], self._motions[name]
            left, right = self._rows.left[:, here], self._rows.right[:, here]
            if sub.omega is None:
                moving = stack.moving(name)
                add_between(self._base, left[:, moving], frequencies_last(whole[name](omega)), right[:, moving])
            else:
                self._coupled[name] = CoupledModes.of(sub, left @ L, right @ L)
                table = ModalTable(left @ L, right @ L, _weights(sub, self._single(name), omega))
                self._tables[name] = table
                RowTerms.of(table, self._single(name, self._always[name])).add(self._base)
        # If the motions present in every choice already make the joints independent, choices need no check.
        alone = self._row_basis({name: np.empty(0, dtype=np.int64) for name in substructures})
        self._same_joints = alone.shape[0] == self._rows.c

    def response(self, kept: Kept, at: Indices | None = None) -> Complex:
        """Response with some of the modes, rigid-body part included.

        Parameters
        ----------
        kept : mapping of body to (k,) int64
        at : (g,) int64, optional
            Numbers of the frequencies; all if absent.

        Returns
        -------
        H : (g, outputs, inputs) complex128
        """
        count = self.omega.size if at is None else at.size
        U, chosen = self._joints(kept), self._terms(kept)
        H = np.empty((count, self._rows.outputs, self._rows.right.shape[0] - self._rows.c), dtype=np.complex128)
        for part in self._blocks(count):
            AYA, AYB, CYA, CYB = self._joined(kept, chosen, U, part if at is None else at[part])
            H[part] = CYB - CYA @ np.linalg.solve(AYA, AYB) if U.shape[0] else CYB
        return H

    def rounding(self, kept: Kept, at: Indices) -> Real:
        """Bound of the rounding of `response`, to first order: large where the rigid motions of held bodies cancel.

        Parameters
        ----------
        kept : mapping of body to (k,) int64
        at : (g,) int64
            Numbers of the frequencies.

        Returns
        -------
        (g, outputs, inputs) float64
        """
        U, chosen = self._joints(kept), self._terms(kept)
        found = np.empty((at.size, self._rows.outputs, self._rows.right.shape[0] - self._rows.c))
        for part in self._blocks(at.size):
            AYA, AYB, CYA, CYB = self._joined(kept, chosen, U, at[part])
            found[part] = abs(CYB)
            if U.shape[0]:
                forces = abs(np.asarray(np.linalg.solve(AYA, AYB)))
                carried = abs(np.asarray(np.linalg.solve(AYA.swapaxes(1, 2), CYA.swapaxes(1, 2)))).swapaxes(1, 2)
                found[part] += abs(CYA) @ forces + carried @ (abs(AYA) @ forces + abs(AYB))
        return np.finfo(float).eps * found

    def effects(self, kept: Kept, changes: Sequence[Change], at: Indices) -> tuple[Complex, Complex, NDArray[np.bool_]]:
        """Response with some of the modes, and the change of the response by each of many changes alone.

        Parameters
        ----------
        kept : mapping of body to (k,) int64
        changes : sequence of Change
        at : (g,) int64
            Numbers of the frequencies.

        Returns
        -------
        H : (g, outputs, inputs) complex128
        dH : (g, outputs, inputs, n) complex128
            NaN where it is not known.
        known : (n,) bool
            False for changes that leave a joint without support, for those of both coupled and uncoupled modes, and for
            all of them where a body has gyroscopic forces: use ``response`` for these.

        Notes
        -----
        Modes with weights 1/Z and motions v are added (s = 1) or left out (s = -1) by an update of low rank of the
        joined flexibility, dH = (C Y v) (s Z + v^T Y v)^-1 (B Y v)^T, where Y is that of the joined bodies: Sherman,
        Morrison and Woodbury. Coupled modes move those beside them, so that their v depends on the frequency.
        """
        U, chosen = self._joints(kept), self._terms(kept)
        inputs = self._rows.right.shape[0] - self._rows.c
        H = np.empty((at.size, self._rows.outputs, inputs), dtype=np.complex128)
        dH = np.full((at.size, self._rows.outputs, inputs, len(changes)), np.nan + 0j)
        known = np.full(len(changes), self._updatable(U))
        present = {name: self._present(name, kept) for name in self._coupled}
        sort = np.array([self._sort(body, columns, present) for body, columns in changes], dtype=np.int64)
        known &= sort != _MIXED
        terms = ModalTerms.of(self._tables, changes, np.flatnonzero(known & (sort == _SINGLE)), kept, at)
        alpha, gamma, beta = U @ terms.left[: self._rows.c], terms.left[self._rows.c :], terms.right[self._rows.c :]
        coupled = np.flatnonzero(known & (sort == _COUPLED))
        columns = alpha.shape[1] + sum(changes[int(k)][1].size for k in coupled)
        more = (3 + inputs) * columns * (self._rows.c + self._rows.outputs) + columns**2
        for part in self._blocks(at.size, more):
            points = at[part]
            AYA, AYB, CYA, CYB = self._joined(kept, chosen, U, points)
            S = np.linalg.inv(AYA)
            H[part] = CYB - CYA @ (S @ AYB)
            Sv = _times(S, alpha)
            P = self._rows.measured(np.broadcast_to(gamma, (points.size, *gamma.shape)), self.omega[points]) - CYA @ Sv
            Q = beta - AYB.transpose(0, 2, 1) @ Sv
            terms.update(dH, known, part, alpha, Sv, P, Q)
            for cluster in CoupledTerms.of(self._coupled, changes, coupled, present, self.omega[points]):
                own = U @ cluster.left[:, : self._rows.c]
                Sv = S @ own
                P = self._rows.measured(cluster.left[:, self._rows.c :], self.omega[points]) - CYA @ Sv
                Q = cluster.right[:, self._rows.c :] - AYB.transpose(0, 2, 1) @ Sv
                cluster.update(dH, known, part, own, Sv, P, Q)
        dH[..., ~known] = np.nan
        return H, dH, known

    def together(self, kept: Kept, changes: Sequence[Change], sets: Indices, at: Indices) -> Complex:
        """Response after each of some sets of changes, their effects on one another included.

        Parameters
        ----------
        kept : mapping of body to (k,) int64
        changes : sequence of Change
            Those in ``sets`` are `alone`.
        sets : (s, k) int64
            Numbers of the changes made together; k is small.
        at : (g,) int64
            Numbers of the frequencies.

        Returns
        -------
        H : (g, outputs, inputs, s) complex128
            Not finite where a set makes the joined flexibility singular.
        """
        used, place = np.unique(sets, return_inverse=True)
        place, c = place.reshape(sets.shape), self._rows.c
        terms = ModalTerms.of(self._tables, changes, used, kept, at)
        U, chosen = self._joints(kept), self._terms(kept)
        alpha, gamma, beta = U @ terms.left[:c], terms.left[c:], terms.right[c:]
        H = np.empty((at.size, self._rows.outputs, beta.shape[0], len(sets)), dtype=np.complex128)
        for part in self._blocks(at.size, H[0].size + used.size**2 + 8 * sets.size):
            points = at[part]
            AYA, AYB, CYA, CYB = self._joined(kept, chosen, U, points)
            S = np.linalg.inv(AYA)
            Sv = _times(S, alpha)
            P = self._rows.measured(np.broadcast_to(gamma, (points.size, *gamma.shape)), self.omega[points]) - CYA @ Sv
            Q = beta - AYB.transpose(0, 2, 1) @ Sv
            N = alpha.T @ Sv
            N[:, np.arange(used.size), np.arange(used.size)] += 1 / terms.weights[part]
            X = eliminated(N, Q, place)
            H[part] = (CYB - CYA @ (S @ AYB))[..., None]
            for own, amplitude in zip(place.T, X, strict=True):
                H[part] += P[:, :, None, own] * amplitude[:, None]
        return H

    def alone(self, kept: Kept, changes: Sequence[Change]) -> NDArray[np.bool_]:
        """Mark changes of one mode that no damping matrix couples to others and no joint rests on (n,)."""
        if not self._updatable(self._joints(kept)):
            return np.zeros(len(changes), dtype=bool)
        return np.array([columns.size == 1 and self._sort(body, columns, {}) == _SINGLE for body, columns in changes])

    def _blocks(self, count: int, more: int = 0) -> Iterator[slice]:
        entries = 3 * self._rows.left.shape[0] * self._rows.right.shape[0] + more
        entries += sum(3 * cluster.size**2 for body in self._coupled.values() for cluster in body.clusters)
        return frequency_blocks(count, 16 * entries, _BLOCK_BYTES)

    def _updatable(self, U: Real) -> bool:
        """True if updates give the effects of changes: none makes joints independent that the modes kept do not.

        Receptances with gyroscopic forces are not symmetric, which the updates take for granted.
        """
        return bool(U.shape[0] == self._rows.c) and not self._gyroscopic

    def _joints(self, kept: Kept) -> Real:
        return np.eye(self._rows.c) if self._same_joints else self._row_basis(kept)

    def _row_basis(self, kept: Kept) -> Real:
        # As in the coupling of complete bodies: joints that lock one motion of the bodies twice count once.
        A = self._rows.left[: self._rows.c]
        rows = [
            balanced(A[:, self._columns[name]], L[:, self._present(name, kept)])
            for name, L in self._motions.items()
            if L.size
        ]
        return row_basis(np.hstack([np.zeros((self._rows.c, 0)), *rows]))

    def _present(self, name: str, kept: Kept) -> NDArray[np.bool_]:
        present = self._always[name].copy()
        present[kept[name] if name in kept else slice(None)] = True
        return present

    def _single(self, name: str, among: NDArray[np.bool_] | None = None) -> Columns:
        """Uncoupled coordinates, all or among some."""
        single = np.ones(self._substructures[name].m, dtype=bool) if among is None else among.copy()
        single[self._coupled[name].columns] = False
        return np.flatnonzero(single)

    def _sort(self, body: str, columns: Columns, present: Mapping[str, NDArray[np.bool_]]) -> int:
        """Sort of a change: of uncoupled modes, of modes of one cluster, or mixed."""
        if body not in self._coupled:
            return _MIXED
        clusters = [cluster for cluster in self._coupled[body].clusters if np.isin(columns, cluster).any()]
        if not clusters:
            return _SINGLE
        if body not in present:
            return _MIXED
        alike = present[body][columns]
        return _COUPLED if np.isin(columns, clusters[0]).all() and alike.all() == alike.any() else _MIXED

    def _terms(self, kept: Kept) -> list[RowTerms]:
        """Uncoupled modes that are present by choice."""
        return [
            RowTerms.of(table, self._single(name, self._present(name, kept) & ~self._always[name]))
            for name, table in self._tables.items()
        ]

    def _joined(
        self, kept: Kept, terms: Sequence[RowTerms], U: Real, points: Indices | slice
    ) -> tuple[Complex, Complex, Complex, Complex]:
        """Flexibilities between joint forces and inputs, and joint motions and outputs, at some frequencies."""
        last = self._base[..., points].copy() if isinstance(points, slice) else self._base.take(points, axis=-1)
        for own in terms:
            own.add(last, points)
        G = np.ascontiguousarray(last.transpose(2, 0, 1))
        for name, body in self._coupled.items():
            if body.clusters:
                G += body.flexibility(self._present(name, kept), self.omega[points])
        c = self._rows.c
        C = self._rows.measured(G[:, c:], self.omega[points])
        if self._same_joints:
            return G[:, :c, :c], G[:, :c, c:], C[:, :, :c], C[:, :, c:]
        AYA, AYB = U @ G[:, :c, :c] @ U.T, U @ G[:, :c, c:]
        return np.asarray(AYA), np.asarray(AYB), np.asarray(C[:, :, :c] @ U.T), C[:, :, c:]


def _always(sub: Substructure) -> NDArray[np.bool_]:
    """Mark coordinates in every choice: rigid and static modes, and all of a body without modes."""
    if sub.omega is None:
        return np.ones(sub.m, dtype=bool)
    return np.asarray((sub.omega == 0) | np.isinf(sub.omega))


def _times(S: NDArray[Any], alpha: Real) -> Complex:
    """Complex matrices at every frequency times one real matrix."""
    f, c = S.shape[:2]
    rows = S.reshape(f * c, c)
    return np.asarray((rows.real @ alpha + 1j * (rows.imag @ alpha)).reshape(f, c, alpha.shape[1]))


def _weights(sub: Substructure, columns: Columns, omega: Real) -> Complex:
    """Amplitudes of uncoupled modes, and zeros for the others (m, f)."""
    every = np.zeros((sub.m, omega.size), dtype=np.complex128)
    try:
        every[columns] = modal_weights(sub, omega, columns).T
    except ResonanceError as error:
        raise resonant(sub, error) from None
    return every
