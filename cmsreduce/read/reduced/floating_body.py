"""A body of a floating-frame program: rigid mass, momentum of its modes, and shapes at nodes, as a modal body."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.mechanics import MassPoints, mass_points
from cmsreduce.model import DofTable, ModalIntegrals, Nodes, SecondOrder, Source, Units, cross_matrix
from cmsreduce.read.files import sha256_of
from cmsreduce.read.reduced.modal_body import ModalBody

__all__ = ["FloatingBody"]

# A smallest eigenvalue of the scaled mass below this is none, but for the digits of the files.
_DEFINITE = 1e-10
# Relative difference of the modal mass and the trace of int phi_i phi_j dm: above it they are of two bodies. Files have
# six digits at least.
_SAME_MASS = 1e-5
_PLANES = ((0, 1, 5), (1, 2, 3), (0, 2, 4))
_SIX = 6

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FloatingBody:
    """Data that a floating-frame program has of a body, about the origin and along the axes of its file.

    Parameters
    ----------
    mass : float
        Mass.
    first_moment : (3,) float64
        int r dm.
    inertia : (3, 3) float64
        int (r.r 1 - r r^T) dm about the origin.
    phi, r_cross_phi : (3, k) float64
        int phi dm and int r x phi dm of k modes.
    M, K, D : (k, k) float64
        Modal matrices.
    node : (n,) int64
        Ids of nodes.
    xyz : (n, 3) float64
        Their places.
    translation, rotation : (n, 3, k) float64
        Their motion in each mode.
    second_order : SecondOrder, optional
        Integrals of second order of the modes; None if the file does not determine them.
    points : MassPoints, optional
        Masses that have all integrals, in place of ``second_order``.
    undetermined : str
        Reason why the file does not determine integrals of second order.
    """

    mass: float
    first_moment: Array
    inertia: Array
    phi: Array
    r_cross_phi: Array
    M: Array
    K: Array
    D: Array
    node: NDArray[np.int64]
    xyz: Array
    translation: Array
    rotation: Array
    second_order: SecondOrder | None = None
    points: MassPoints | None = None
    undetermined: str = ""

    @property
    def k(self) -> int:
        """Number of modes."""
        return int(self.K.shape[0])

    def modal(self, name: str, path: Path, units: Units, *, rounding: float, kind: str) -> ModalBody:
        """The body in coordinates of the rigid motions of its frame, then of its modes.

        Parameters
        ----------
        name : str
            Name of the component.
        path : Path
            Its file.
        units : Units
            Unit system of the file.
        rounding : float
            Relative rounding of its numbers.
        kind : str
            Format of the file, for the record.

        Raises
        ------
        ReadError
            If no mass has such a first moment and inertia.

        Notes
        -----
        A node that moves in the modes and turns in none of them has no rotations here: programs write zeros where they
        do not know the slope, as at the nodes of solid elements.
        """
        k = self.k
        M = np.zeros((_SIX + k, _SIX + k))
        first = cross_matrix(self.first_moment)
        M[:3, :3], M[:3, 3:6], M[3:6, :3] = self.mass * np.eye(3), -first, first
        M[3:6, 3:6], M[6:, 6:] = self.inertia, self.M
        M[:3, 6:], M[3:6, 6:] = self.phi, self.r_cross_phi
        M[6:, :6] = M[:6, 6:].T
        K, D = np.zeros_like(M), np.zeros_like(M)
        K[6:, 6:], D[6:, 6:] = self.K, self.D
        turn = np.array([-cross_matrix(place) for place in self.xyz])
        rigid = np.zeros((self.node.size, _SIX, _SIX))
        rigid[:] = np.eye(_SIX)
        rigid[:, :3, 3:] = turn
        shapes = np.concatenate([rigid, np.concatenate([self.translation, self.rotation], axis=1)], axis=2)
        motions = self._motions(path, M)
        own = np.concatenate([motions, np.arange(_SIX, _SIX + k)])
        blind = ~np.any(self.rotation, axis=(1, 2)) & np.any(self.translation, axis=(1, 2))
        known = np.isin(np.arange(_SIX), motions) & ~np.outer(blind, np.arange(_SIX) >= 3)
        node, component = np.nonzero(known)
        square = np.ix_(own, own)
        second_order = self._second_order(np.eye(_SIX)[:, motions])
        why = self.undetermined
        if second_order is None and self.second_order is not None:
            why = "its integrals of second order are of another mass than its modal mass"
        return ModalBody(
            name=name,
            K=K[square],
            M=M[square],
            D=D[square],
            dofs=DofTable(self.node[node], (component + 1).astype(np.int8)),
            shapes=shapes[node, component][:, own],
            nodes=Nodes.in_basic(self.node, self.xyz),
            units=units,
            rounding=rounding,
            sources=(Source(str(path), sha256_of(path), kind),),
            unproven="its file names the node of each shape, and nothing in it proves that the shape belongs there",
            second_order=second_order,
            remarks=(f"component '{name}': read for slow rotations from {path}: {why}",) if why else (),
        )

    def _second_order(self, rigid: Array) -> SecondOrder | None:
        """Integrals of the rigid motions and of the modes, if those of the modes are of the body's own mass."""
        if self.points is not None:
            return self.points.second_order(rigid)
        if self.second_order is None:
            return None
        trace = np.einsum("iiab->ab", self.second_order.phi_phi)
        if abs(trace - self.M).max(initial=0.0) > _SAME_MASS * abs(self.M).max(initial=0.0):
            return None
        integrals = ModalIntegrals(
            origin=np.zeros(3),
            axes=np.eye(3),
            lumping="consistent",
            mass=self.mass,
            first_moment=self.first_moment,
            inertia=self.inertia,
            phi=self.phi,
            r_cross_phi=self.r_cross_phi,
            modes=np.arange(self.k),
            second_order=self.second_order,
        )
        return mass_points(integrals).second_order(rigid)

    def _motions(self, path: Path, M: Array) -> NDArray[np.int64]:
        """Rigid motions that the mass allows: all six, or the three of a plane body, which has no other inertia."""

        def allows(kept: NDArray[np.int64]) -> bool:
            scale = np.sqrt(np.maximum(M.diagonal()[kept], np.finfo(float).tiny))
            part = M[np.ix_(kept, kept)] / np.outer(scale, scale)
            return bool(np.linalg.eigvalsh(part)[0] > _DEFINITE)

        every = np.arange(_SIX)
        if allows(every):
            return every
        modes = np.concatenate([self.translation, self.rotation], axis=1)
        for kept in (np.array(plane) for plane in _PLANES):
            if allows(kept) and not modes[:, np.setdiff1d(every, kept)].any():
                return kept
        centre = self.first_moment / self.mass if self.mass else self.first_moment
        raise ReadError(
            f"{path}: no body has its mass {self.mass:g}, centre of mass ({centre[0]:g}, {centre[1]:g}, "
            f"{centre[2]:g}) and inertia J at once: the inertia about the centre of mass is not positive. Compare the "
            "centre and the inertia of the file (mdCM and J of an SID file, whose order is xx yy zz xy xz yz as "
            "entries of the tensor; record group 12 of MBDyn) with the finite-element program"
        )
