"""Craig-Bampton: fixed-interface normal modes and constraint modes; Guyan is the same without normal modes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SingularInterfaceError
from cmsreduce.linalg.blocks import (
    by_columns,
    combined,
    congruence,
    new_basis,
    observed,
    row_blocks,
    side_by_side,
)
from cmsreduce.linalg.eigen import beside_modes, certified_modes, count_below
from cmsreduce.linalg.sparse import BLOCK, HELD, NotPositiveDefiniteError, Solve, factorise, motions_held, part
from cmsreduce.model import FEModel, ModeBlock, ModeCertificate, ModeSet
from cmsreduce.reduce.basis import Basis
from cmsreduce.reduce.characteristic import InterfaceMotions, InterfaceReduction
from cmsreduce.reduce.macneal_rubin import free_modes_and_residuals
from cmsreduce.reduce.reduction import Reduction
from cmsreduce.reduce.static_shapes import Loads, few_digits, residual_shapes

__all__ = ["CraigBampton", "Guyan"]

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

_RIGID = 6  # a free body has no more motions


class CraigBampton(Reduction):
    """Fixed-interface modes up to the cutoff and one constraint mode per interface dof.

    Parameters
    ----------
    cutoff_hz : float
        Fixed-interface modes are kept up to this frequency.
    interface_cutoff_hz : float, optional
        Characteristic constraint modes up to this frequency replace the constraint modes: for interfaces of many dofs.
    interface_reduction : InterfaceReduction, optional
        The same for a part of the interface, or with given shapes.
    damped : bool
        Also span the damped fixed-interface modes; see `Reduction`.
    inertia : bool
        Also span the response to the inertia of the moving interface; see `Reduction`.

    Notes
    -----
    Basis [[I, 0], [Psi_ji, phi_jk]], Psi_ji = -K_jj^-1 K_ji, K_jj phi = M_jj phi w^2.
    Source: Craig and Bampton (1968); theory section 2. A body without interface is reduced to its free modes.
    """

    method: ClassVar[str] = "craig-bampton"
    normal_modes: ClassVar[bool] = True

    def __init__(
        self,
        cutoff_hz: float,
        interface_cutoff_hz: float | None = None,
        interface_reduction: InterfaceReduction | None = None,
        *,
        damped: bool = False,
        inertia: bool = False,
    ) -> None:
        super().__init__(cutoff_hz, damped=damped, inertia=inertia)
        if interface_reduction is None and interface_cutoff_hz is not None:
            interface_reduction = InterfaceReduction(interface_cutoff_hz)
        self.interface_reduction = interface_reduction

    def basis(self, body: FEModel, interface: Rows, rigid: Array, loads: Array) -> Basis:
        """Shapes of the mode set, constraint modes first; see `Reduction.basis`.

        Raises
        ------
        SingularInterfaceError
            If the body has a rigid motion or a mechanism while the interface is held.
        """
        cutoff_hz = self.cutoff_hz if self.normal_modes else 0.0
        if interface.size == 0:
            names = [f"load {number + 1}" for number in range(loads.shape[1])]
            known = self.known_count(body, interface)
            return free_modes_and_residuals(self.method, body, rigid, cutoff_hz, loads, names, known=known)
        held = motions_held(rigid, interface)
        if held < rigid.shape[1]:
            digits = few_digits(body) if rigid.shape[1] > _RIGID else ""
            raise SingularInterfaceError(
                f"body '{body.name}' has {rigid.shape[1]} rigid-body motions, but its {interface.size} interface dofs "
                f"hold only {held} of them, so {self.method} has no constraint modes. Add interface dofs (three "
                f"translations at three nodes not in line, or a node with rotations){digits}"
            )
        omega, j = 2 * np.pi * cutoff_hz, np.delete(np.arange(body.n), interface)
        Kjj, Mjj = part(body.K, j), sp.csc_array(body.M[j][:, j])
        # The count comes first: so only one factor at a time is in memory.
        count = count_below(Kjj, Mjj, omega, known=self.known_count(body, interface))
        try:
            solve: Solve = factorise(Kjj, what=f"body '{body.name}': K with the interface held", kept=True)
        except NotPositiveDefiniteError as error:
            raise SingularInterfaceError(
                f"body '{body.name}': with its {interface.size} interface dofs held, dof "
                f"{body.dofs.labels[j[error.row]]} still moves freely ({error}). Add interface dofs that hold it, or "
                f"remove the mechanism{few_digits(body)}"
            ) from None
        w, phi, certificate = np.empty(0), np.empty((j.size, 0)), None
        if omega > 0 and j.size:
            w, phi, bound = certified_modes(Kjj, Mjj, omega, solve=solve, count=count, rounding=body.rounding)
            certificate = ModeCertificate(cutoff_hz, count, w / (2 * np.pi), bound)
            solve = beside_modes(solve, Mjj, w, phi)
        constraint = _constraint_modes(body, interface, rigid, solve, j)
        motions = self._interface_motions(body, interface, rigid, constraint)
        static, new = np.empty((j.size, 0)), np.empty(0, dtype=np.int64)
        if j.size:
            static, new = residual_shapes(solve, Kjj, loads[j], phi, Mjj)
        single, many = constraint, constraint[:, :0]
        if self.interface_reduction is not None:
            single = combined(constraint, motions.shapes[:, : motions.single.size])
            many = combined(constraint, motions.shapes[:, motions.single.size :])
        blocks = [(None, single), (None, many), (j, phi), (j, static)]
        del constraint
        Phi, (single, many, fixed, residual) = side_by_side(body.n, blocks)
        del blocks
        modes = ModeSet.of(
            self.method,
            [
                ModeBlock("constraint", single, [body.dofs.labels[row] for row in interface[motions.single]]),
                ModeBlock("constraint", many, motions.labels, motions.frequency_hz),
                ModeBlock("fixed", fixed, [str(number + 1) for number in range(w.size)], w / (2 * np.pi)),
                ModeBlock("residual", residual, [f"load {load + 1}" for load in new]),
            ],
            certificate,
            Phi,
        )
        # The largest part missed is the response to the inertia of the moving interface: M_jj Psi + M_ji.
        moving = np.concatenate([np.arange(motions.shapes.shape[1]), np.arange(Phi.shape[1] - new.size, Phi.shape[1])])
        inertia = Loads(moving.size, lambda part: body.M @ Phi[:, moving[part]])
        return Basis(modes, solve, Kjj, (phi, static), inertia, j)

    def characteristic_shapes(self, body: FEModel, interface: Rows, rigid: Array) -> Array:
        """All motions in the basis of the dofs that are reduced, as `InterfaceReduction.shapes` takes them (t, b).

        Raises
        ------
        SingularInterfaceError
            As in `basis`.
        """
        reduction = self.interface_reduction or InterfaceReduction(0.0, interface[:0])
        modes = self.basis(body, interface, rigid, np.empty((body.n, 0))).modes
        constraint = np.flatnonzero([kind == "constraint" for kind in modes.kind])
        return modes.Phi[np.ix_(interface[reduction.positions(interface)], constraint)]

    def _interface_motions(self, body: FEModel, interface: Rows, rigid: Array, constraint: Array) -> InterfaceMotions:
        reduction = self.interface_reduction
        many = interface[:0] if reduction is None else reduction.positions(interface)
        if reduction is None or not many.size:
            return InterfaceMotions.single_dofs(interface.size)
        # K Psi is zero except on the interface.
        K, M = observed(body.K[interface], constraint), congruence(body.M, constraint)
        P = np.eye(interface.size) - rigid[interface] @ (rigid[interface].T @ M)
        return InterfaceMotions.reduced(P.T @ ((K + K.T) / 2) @ P, M, rigid[interface], many, reduction, body.rounding)


class Guyan(CraigBampton):
    """Static condensation: constraint modes alone (theory section 2)."""

    method: ClassVar[str] = "guyan"
    normal_modes: ClassVar[bool] = False


def _constraint_modes(body: FEModel, interface: Rows, rigid: Array, solve: Solve, j: Rows) -> Array:
    """Static shapes of the body (n, i), one for each interface dof moved by one, the others held."""
    constraint = new_basis(body.n, interface.size)
    constraint[interface, np.arange(interface.size)] = 1.0
    if j.size:
        coupling = sp.csc_array(body.K[:, interface])[j]
        # Block by block: the loads of a wide interface would need as much memory as its shapes.
        for first in range(0, interface.size, BLOCK):
            columns = slice(first, first + BLOCK)
            answer = by_columns(solve(coupling[:, columns].toarray()))
            constraint[j, columns] = np.negative(answer, out=answer)
        # The shapes contain the rigid modes, so that what a solve loses of these is known: much over a long lever, or
        # with the digits of a coarse file.
        missed, share = rigid - constraint @ rigid[interface], la.pinv(rigid[interface], rtol=HELD)
        for block in row_blocks(j.size, interface.size):
            part = constraint[j[block]]
            moves = part != 0
            if moves.all():
                part += missed[j[block]] @ share
            else:
                _correct_moving(part, moves, missed[j[block]], rigid[interface])
            constraint[j[block]] = part
    return constraint


def _correct_moving(constraint: Array, moves: NDArray[np.bool_], missed: Array, moved: Array) -> None:
    """Add to some rows of constraint modes, in place, the rigid motion (k, r) that they miss, by modes that move them.

    Rounding in place of an exact zero would give mass, and so a frequency, to the motion of a massless dof between
    others of the interface.
    """
    pattern, group = np.unique(np.packbits(moves, axis=1), axis=0, return_inverse=True)
    for number, bits in enumerate(np.unpackbits(pattern, axis=1, count=moved.shape[0])):
        rows, moving = np.flatnonzero(group.ravel() == number), np.flatnonzero(bits)
        if moving.size:
            constraint[np.ix_(rows, moving)] += missed[rows] @ la.pinv(moved[moving], rtol=HELD)
