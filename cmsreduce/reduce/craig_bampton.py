"""Craig-Bampton: fixed-interface normal modes and constraint modes; Guyan is the same without normal modes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SingularInterfaceError
from cmsreduce.linalg.eigenpairs import ElasticFlexibility, Solve, modes_below
from cmsreduce.linalg.factorise import NotPositiveDefiniteError, factorise
from cmsreduce.linalg.null_space import motions_held
from cmsreduce.model import FEModel, ModeKind, ModeSet
from cmsreduce.reduce.reduction import Reduction

__all__ = ["CraigBampton", "Guyan"]

# A load's static shape is new when the modes before it leave this share of its strain energy: round-off leaves 1e-14.
_NEW = 1e-12


class CraigBampton(Reduction):
    """Fixed-interface modes up to the cutoff and one constraint mode per interface dof.

    Notes
    -----
    Basis [[I, 0], [Psi_ji, phi_jk]], Psi_ji = -K_jj^-1 K_ji, K_jj phi = M_jj phi w^2.
    Source: Craig and Bampton (1968); theory section 2. A body without interface is reduced to its free modes.
    """

    method: ClassVar[str] = "craig-bampton"
    normal_modes: ClassVar[bool] = True

    def basis(
        self,
        body: FEModel,
        interface: NDArray[np.int64],
        rigid: NDArray[np.float64],
        loads: NDArray[np.float64] | None = None,
    ) -> ModeSet:
        """Shapes of the mode set, constraint modes first; see `Reduction.basis`.

        Raises
        ------
        SingularInterfaceError
            If the interface leaves the body a rigid motion or a mechanism.
        """
        omega = 2 * np.pi * self.cutoff_hz if self.normal_modes else 0.0
        if interface.size == 0:
            return self._free(body, rigid, omega, loads)
        self._check_held(body, interface, rigid)
        i, j = interface, np.setdiff1d(np.arange(body.n), interface)
        Kjj, Mjj = sp.csc_array(body.K[j][:, j]), sp.csc_array(body.M[j][:, j])
        try:
            solve = factorise(Kjj, what=f"body '{body.name}': K with the interface held")
        except NotPositiveDefiniteError as error:
            raise SingularInterfaceError(
                f"body '{body.name}': with its {i.size} interface dofs held, dof "
                f"{body.dofs.labels[j[error.row]]} still moves freely ({error}). Add interface dofs that hold it, or "
                "remove the mechanism"
            ) from None
        n, k = body.n, i.size
        constraint = np.zeros((n, k))
        constraint[i, np.arange(k)] = 1.0
        if j.size:
            constraint[j] = -solve(body.K[j][:, i].toarray())
        w, phi = np.empty(0), np.empty((j.size, 0))
        if omega > 0 and j.size:
            w, phi = modes_below(Kjj, Mjj, omega, solve=solve, rounding=body.rounding)
        normal = np.zeros((n, w.size))
        normal[j] = phi
        shapes, kinds, names = [constraint, normal], ["constraint"] * k + ["fixed"] * w.size, list[str]()
        names += [body.dofs.labels[row] for row in i] + [str(number + 1) for number in range(w.size)]
        if loads is not None and loads.shape[1]:
            static, new = _residuals(solve, loads[j], w, phi)
            residual = np.zeros((n, new.size))
            residual[j] = static
            shapes.append(residual)
            kinds += ["residual"] * new.size
            names += [f"load {number + 1}" for number in new]
        source = np.concatenate([np.full(k, np.nan), w / (2 * np.pi), np.full(len(kinds) - k - w.size, np.nan)])
        return ModeSet(self.method, np.hstack(shapes), _kinds(kinds), source, tuple(names))

    def _free(
        self, body: FEModel, rigid: NDArray[np.float64], omega: float, loads: NDArray[np.float64] | None
    ) -> ModeSet:
        w, phi = np.empty(0), np.empty((body.n, 0))
        if omega > 0:
            w, phi = modes_below(body.K, body.M, omega, rigid=rigid, rounding=body.rounding)
        r = rigid.shape[1]
        names = [f"rigid {number + 1}" for number in range(r)] + [str(number + 1) for number in range(w.size)]
        kinds = ["rigid"] * r + ["free"] * w.size
        residual = np.empty((body.n, 0))
        if loads is not None and loads.shape[1]:
            solve = ElasticFlexibility(body.K, body.M, rigid) if r else factorise(body.K, what="the stiffness")
            residual, new = _residuals(solve, loads, w, phi)
            kinds += ["residual"] * new.size
            names += [f"load {number + 1}" for number in new]
        source = np.concatenate([np.zeros(r), w / (2 * np.pi), np.full(residual.shape[1], np.nan)])
        return ModeSet(self.method, np.hstack([rigid, phi, residual]), _kinds(kinds), source, tuple(names))

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


def _residuals(
    solve: Solve, loads: NDArray[np.float64], w: NDArray[np.float64], phi: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Static responses beyond what the normal modes hold, and the loads they belong to; repeated ones left out."""
    static = solve(loads)
    residual = static - phi @ ((phi.T @ loads) / (w**2)[:, None])
    energy = np.einsum("ij,ij->j", loads, static)
    scale = 1 / np.sqrt(np.where(energy > 0, energy, 1.0))
    G = loads.T @ residual * np.outer(scale, scale)
    new: list[int] = []
    for number in range(loads.shape[1]):
        known = np.linalg.solve(G[np.ix_(new, new)], G[new, number])
        if G[number, number] - G[number, new] @ known > _NEW:
            new.append(number)
    return residual[:, new], np.array(new, dtype=np.int64)


def _kinds(names: list[str]) -> tuple[ModeKind, ...]:
    return tuple(names)  # type: ignore[arg-type]
