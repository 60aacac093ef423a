"""Craig-Bampton: fixed-interface normal modes and constraint modes; Guyan is the same without normal modes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SingularInterfaceError
from cmsreduce.linalg.blocks import by_columns, column_blocks, combined, congruence, new_basis, observed, side_by_side
from cmsreduce.linalg.eigen import HELD, beside_modes, certified_modes, count_below, motions_held
from cmsreduce.linalg.sparse import BLOCK, NotPositiveDefiniteError, Solve, factorise
from cmsreduce.model import FEModel, ModeBlock, ModeCertificate, ModeSet
from cmsreduce.reduce.characteristic import Boundary, InterfaceReduction
from cmsreduce.reduce.macneal_rubin import free_modes_and_residuals
from cmsreduce.reduce.neglected import Basis, LeftOut
from cmsreduce.reduce.reduction import Reduction
from cmsreduce.reduce.static_shapes import Loads, residual_shapes

__all__ = ["CraigBampton", "Guyan"]


class CraigBampton(Reduction):
    """Fixed-interface modes up to the cutoff and one constraint mode per interface dof.

    Parameters
    ----------
    cutoff_hz : float
        Fixed-interface modes are kept up to this frequency.
    interface_cutoff_hz : float, optional
        Characteristic constraint modes up to this frequency take the place of the constraint modes: for interfaces
        of many dofs.
    interface_reduction : InterfaceReduction, optional
        The same for a part of the interface, or with shapes of one's own.

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
    ) -> None:
        super().__init__(cutoff_hz)
        if interface_reduction is None and interface_cutoff_hz is not None:
            interface_reduction = InterfaceReduction(interface_cutoff_hz)
        self.interface_reduction = interface_reduction

    def basis(
        self,
        body: FEModel,
        interface: NDArray[np.int64],
        rigid: NDArray[np.float64],
        loads: NDArray[np.float64] | None = None,
    ) -> Basis:
        """Shapes of the mode set, constraint modes first; see `Reduction.basis`.

        Raises
        ------
        SingularInterfaceError
            If the interface leaves the body a rigid motion or a mechanism.
        """
        omega = 2 * np.pi * self.cutoff_hz if self.normal_modes else 0.0
        forces = np.empty((body.n, 0)) if loads is None else loads
        if interface.size == 0:
            names = [f"load {number + 1}" for number in range(forces.shape[1])]
            return free_modes_and_residuals(self.method, body, rigid, omega, forces, names)
        j = np.setdiff1d(np.arange(body.n), interface)
        Kjj, Mjj = sp.csc_array(body.K[j][:, j]), sp.csc_array(body.M[j][:, j])
        self._check_held(body, interface, rigid)
        # Counted first: one factor is in memory at a time.
        count = count_below(Kjj, Mjj, omega)
        solve = self._interior_factor(body, interface, Kjj, j)
        w, phi, certificate = np.empty(0), np.empty((j.size, 0)), None
        if omega > 0 and j.size:
            w, phi, bound = certified_modes(Kjj, Mjj, omega, solve=solve, count=count, rounding=body.rounding)
            certificate = ModeCertificate(self.cutoff_hz, count, w / (2 * np.pi), bound)
            solve = beside_modes(solve, Mjj, w, phi)
        constraint = self._constraint_modes(body, interface, rigid, solve, j)
        boundary = self._boundary(body, interface, rigid, constraint)
        static, new = np.empty((j.size, 0)), np.empty(0, dtype=np.int64)
        if j.size:
            static, new = residual_shapes(solve, Kjj, forces[j], phi, Mjj)
        lone, many = constraint, constraint[:, :0]
        if self.interface_reduction is not None:
            lone = combined(constraint, boundary.shapes[:, : boundary.single.size])
            many = combined(constraint, boundary.shapes[:, boundary.single.size :])
        blocks = [(None, lone), (None, many), (j, phi), (j, static)]
        del constraint
        Phi, (lone, many, fixed, residual) = side_by_side(body.n, blocks)
        del blocks
        modes = ModeSet.of(
            self.method,
            [
                ModeBlock("constraint", lone, [body.dofs.labels[row] for row in interface[boundary.single]]),
                ModeBlock("constraint", many, boundary.labels, boundary.frequency_hz),
                ModeBlock("fixed", fixed, _ordinals(w.size), w / (2 * np.pi)),
                ModeBlock("residual", residual, [f"load {load + 1}" for load in new]),
            ],
            certificate,
            Phi,
        )
        # What the modes left out answer first is the inertia of the moving interface: M_jj Psi + M_ji.
        moving = np.concatenate([np.arange(boundary.shapes.shape[1]), np.arange(Phi.shape[1] - new.size, Phi.shape[1])])
        inertia = Loads(moving.size, lambda part: body.M @ Phi[:, moving[part]])
        return Basis(modes, LeftOut(solve, Kjj, (phi, static), inertia, j, body.n))

    def characteristic_shapes(
        self, body: FEModel, interface: NDArray[np.int64], rigid: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """All motions that the basis gives the dofs that are reduced, as `InterfaceReduction.shapes` takes them (t, b).

        Raises
        ------
        SingularInterfaceError
            As `basis` does.
        """
        self._check_held(body, interface, rigid)
        j = np.setdiff1d(np.arange(body.n), interface)
        solve = self._interior_factor(body, interface, sp.csc_array(body.K[j][:, j]), j)
        constraint = self._constraint_modes(body, interface, rigid, solve, j)
        boundary = self._boundary(body, interface, rigid, constraint)
        reduction = self.interface_reduction
        return boundary.shapes[reduction.positions(interface) if reduction else slice(0)]

    def _interior_factor(
        self, body: FEModel, interface: NDArray[np.int64], Kjj: sp.csc_array, j: NDArray[np.int64]
    ) -> Solve:
        """Flexibility of the interior, rows j, with the interface held."""
        try:
            return factorise(Kjj, what=f"body '{body.name}': K with the interface held")
        except NotPositiveDefiniteError as error:
            raise SingularInterfaceError(
                f"body '{body.name}': with its {interface.size} interface dofs held, dof "
                f"{body.dofs.labels[j[error.row]]} still moves freely ({error}). Add interface dofs that hold it, or "
                "remove the mechanism"
            ) from None

    def _constraint_modes(
        self,
        body: FEModel,
        interface: NDArray[np.int64],
        rigid: NDArray[np.float64],
        solve: Solve,
        j: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        """Static shapes of the body (n, i), one for each interface dof moved by one, the others held."""
        constraint = new_basis(body.n, interface.size)
        constraint[interface, np.arange(interface.size)] = 1.0
        if j.size:
            coupling = sp.csc_array(body.K[:, interface])[j]
            # Block by block: the loads of a wide interface would fill as much memory as its shapes.
            for first in range(0, interface.size, BLOCK):
                part = slice(first, first + BLOCK)
                answer = by_columns(solve(coupling[:, part].toarray()))
                constraint[j, part] = np.negative(answer, out=answer)
            # They carry the rigid modes: what a solve loses of them over a long lever, or a coarse file, is known.
            missed = rigid - constraint @ rigid[interface]
            lost, share = missed[j], la.pinv(rigid[interface], rtol=HELD)
            for part in column_blocks(interface.size):
                constraint[j, part] += lost @ share[:, part]
        return constraint

    def _boundary(
        self,
        body: FEModel,
        interface: NDArray[np.int64],
        rigid: NDArray[np.float64],
        constraint: NDArray[np.float64],
    ) -> Boundary:
        reduction = self.interface_reduction
        if reduction is None:
            return Boundary.whole(interface.size)
        many = reduction.positions(interface)
        if not many.size:
            return Boundary.whole(interface.size)
        # K Psi is zero but on the interface.
        K, M = observed(body.K[interface], constraint), congruence(body.M, constraint)
        P = np.eye(interface.size) - rigid[interface] @ (rigid[interface].T @ M)
        return Boundary.reduced(P.T @ ((K + K.T) / 2) @ P, M, rigid[interface], many, reduction, body.rounding)

    def _check_held(self, body: FEModel, interface: NDArray[np.int64], rigid: NDArray[np.float64]) -> None:
        held = motions_held(rigid, interface)
        if held < rigid.shape[1]:
            raise SingularInterfaceError(
                f"body '{body.name}' has {rigid.shape[1]} rigid-body motions, but its {interface.size} interface dofs "
                f"hold only {held} of them, so {self.method} has no constraint modes. Add interface dofs (three "
                "translations at three nodes not in line, or a node with rotations)"
            )


class Guyan(CraigBampton):
    """Static condensation: constraint modes alone (theory section 2)."""

    method: ClassVar[str] = "guyan"
    normal_modes: ClassVar[bool] = False


def _ordinals(count: int) -> list[str]:
    return [str(number + 1) for number in range(count)]
