"""Receptances of bodies whose coordinates are coupled: by solves, or by a small model of a body in many dofs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.response.by_modes import named
from cmsreduce.assemble.response.by_rows import ByRows, add_between, frequencies_last
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.response import (
    RESPONSE_TOLERANCE,
    DynamicStiffness,
    FlexibilityModel,
    ResonanceError,
    frequency_blocks,
)
from cmsreduce.model import Substructure

__all__ = ["FEWEST", "DenseSolves", "RigidMotion", "RigidShare", "SparseSolves"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Ints = NDArray[np.int64]

FEWEST = 20
"""Fewer points than this are solved one by one: a model over shapes costs about as much time."""
# Memory of the dense matrices of a block of frequencies, which stay in the cache.
_CACHED_BYTES = 2**21


@dataclass(frozen=True, eq=False)
class RigidShare:
    """Rigid motion of points, with the flexibility motions @ under_loads / -w^2.

    Parameters
    ----------
    motions : (p, r) float64
        Of the rigid modes.
    under_loads : (r, p) float64
        Accelerations of the rigid modes under unit forces.
    """

    motions: Real
    under_loads: Real

    def between(self, left: Real, right: Real) -> RigidShare:
        """Of rows (l, p) and (r, p)."""
        return RigidShare(left @ self.motions, self.under_loads @ right.T)

    def over_square(self, omega: Real) -> Real | float:
        """At frequencies (f, l, r) with the sign turned; zero for a held body, also at zero frequency."""
        whole = self.motions @ self.under_loads
        return whole / omega[:, None, None] ** 2 if whole.any() else 0.0


@dataclass(frozen=True, eq=False)
class RigidMotion(ByRows):
    """Receptance of a rigid body.

    Parameters
    ----------
    sub : Substructure
        The body.
    rigid : RigidShare
        Motions of its points.
    """

    sub: Substructure
    rigid: RigidShare

    @property
    def motions(self) -> int:
        """Number of motions."""
        return int(self.rigid.motions.shape[0])

    def __call__(self, omega: Real) -> Complex:
        """Receptances (f, p, p); see `ByRows`."""
        return self._at(self.rigid, omega).transpose(2, 0, 1)

    def add(self, G: Complex, left: Real, right: Real, omega: Real, loads: Complex | None = None) -> None:
        """Add left Y right^T, or left Y right^T loads, to an array; see `ByRows.add`."""
        rows, columns = (np.flatnonzero(side.any(axis=1)) for side in (left, right))
        _add(G, rows, columns, self._at(self.rigid.between(left[rows], right[columns]), omega), loads)

    def _at(self, share: RigidShare, omega: Real) -> Complex:
        with named(self.sub):
            if (omega == 0).any():
                raise ResonanceError(0.0)
        whole = share.motions @ share.under_loads
        Y = np.zeros((*whole.shape, omega.size), dtype=np.complex128)
        np.multiply(whole[..., None], -1 / omega**2, out=Y.real)
        return Y


@dataclass(frozen=True, eq=False)
class DenseSolves(ByRows):
    """Receptance of a body in few coordinates, solved at many frequencies at once.

    Parameters
    ----------
    sub : Substructure
        The body.
    load : (m, p) float64
        Loads at the motions without their share in rigid motion.
    rigid : RigidShare
        This share.
    """

    sub: Substructure
    load: Real
    rigid: RigidShare

    @property
    def motions(self) -> int:
        """Number of motions."""
        return int(self.load.shape[1])

    def __call__(self, omega: Real) -> Complex:
        """Receptances (f, p, p); see `ByRows`."""
        return self._between(self.load, self.load, self.rigid, omega)

    def add(self, G: Complex, left: Real, right: Real, omega: Real, loads: Complex | None = None) -> None:
        """Add left Y right^T, or left Y right^T loads, to an array; see `ByRows.add`."""
        rows, columns = (np.flatnonzero(side.any(axis=1)) for side in (left, right))
        a, b = left[rows], right[columns]
        Y = self._between(self.load @ a.T, self.load @ b.T, self.rigid.between(a, b), omega)
        _add(G, rows, columns, frequencies_last(Y), loads)

    def _between(self, ends: Real, load: Real, rigid: RigidShare, omega: Real) -> Complex:
        """Flexibility between motions and loads (m, l), (m, r) and that of their rigid share."""
        sub = self.sub
        zero = np.zeros((sub.m, sub.m))
        M, K = dense(sub.M), dense(sub.K)
        D, loss = (zero if part is None else dense(part) for part in (sub.D, sub.loss))
        Y = np.empty((omega.size, ends.shape[1], load.shape[1]), dtype=np.complex128)
        with named(sub):
            for part in frequency_blocks(omega.size, 16 * 3 * sub.m**2, _CACHED_BYTES):
                w = omega[part, None, None]
                try:
                    X = np.linalg.solve(K - w**2 * M + 1j * (loss + w * D), load[None].astype(np.complex128))
                except np.linalg.LinAlgError:
                    raise ResonanceError(float(omega[part][0])) from None
                Y[part] = ends.T @ X - rigid.over_square(omega[part])
        return Y


@dataclass(frozen=True, eq=False)
class SparseSolves(ByRows):
    """Receptance of a body in many dofs: a model over shapes, and a solve where its bound does not confirm it.

    Parameters
    ----------
    sub : Substructure
        The body.
    Z : DynamicStiffness
        Its matrices.
    load : (n, h) float64
        Loads at the motions that it has, without their share in rigid motion.
    rigid : RigidShare
        This share, of all motions.
    here : (h,) int64
        Numbers of the motions that it has.
    prepare : callable
        Makes a model of loads (n, h), and of motions (n, s) at which the responses are seen; None where there is none.
    loaded : (k,) int64, optional
        Numbers, among those it has, of the motions along which forces act. Given if they are far fewer: then a model
        has shapes for them alone, and sees the others.

    Notes
    -----
    The model for few forces is as accurate at the motions that it sees as one of them all (`FlexibilityModel`).
    """

    sub: Substructure
    Z: DynamicStiffness
    load: Real
    rigid: RigidShare
    here: Ints
    prepare: Callable[[Real, Real | None], FlexibilityModel | None]
    loaded: Ints | None = None

    def __post_init__(self) -> None:
        # Prepared now: its time is that of the preparation.
        _ = self._model if self.loaded is None else self._seeing

    @cached_property
    def _model(self) -> FlexibilityModel | None:
        return self.prepare(self.load, None)

    @cached_property
    def _seeing(self) -> FlexibilityModel | None:
        return self.prepare(self.load[:, self.loaded], self.load)

    @property
    def motions(self) -> int:
        """Number of motions."""
        return int(self.rigid.motions.shape[0])

    def __call__(self, omega: Real) -> Complex:
        """Receptances (f, p, p); see `ByRows`."""
        Y = np.zeros((omega.size, self.motions, self.motions), dtype=np.complex128)
        here, unsure = self.here, np.ones(omega.size, dtype=bool)
        with named(self.sub):
            model = self._model
            if model is not None:
                for part in frequency_blocks(omega.size, model.bytes_each):
                    found = model(omega[part])
                    Y[part, here[:, None], here] = found.Y
                    unsure[part] = ~(found.error <= RESPONSE_TOLERANCE)
            for k in np.flatnonzero(unsure):
                Y[k, here[:, None], here] = self.Z.flexibility(self.load, float(omega[k]))
        Y -= self.rigid.over_square(omega)
        return Y

    def add(self, G: Complex, left: Real, right: Real, omega: Real, loads: Complex | None = None) -> None:
        """Add left Y right^T, or left Y right^T loads, to an array; see `ByRows.add`."""
        rows, columns = (np.flatnonzero(side.any(axis=1)) for side in (left, right))
        a, b = left[rows], right[columns]
        model, size = (None, None) if self.loaded is None else (self._seeing, self._only_seen(a, b))
        if size is None or (model is None and self._model is not None):
            add_between(G, left, frequencies_last(self(omega)), right, loads)
            return
        Y = np.empty((omega.size, rows.size, columns.size), dtype=np.complex128)
        unsure = np.ones(omega.size, dtype=bool)
        with named(self.sub):
            if model is not None and model.seen is not None:
                seen, acting = (model.seen @ side[:, self.here].T for side in (a, b))
                for part in frequency_blocks(omega.size, model.bytes_each + 16 * acting.size):
                    Y[part] = seen.T @ model.amplitudes(omega[part], acting)
                    unsure[part] = ~(model(omega[part]).error <= RESPONSE_TOLERANCE) & ~size.any()
            if unsure.any():
                # Of many motions that are seen, these products take as long as a solve.
                ends, force = (self.load @ side[:, self.here].T for side in (a, b))
                for k in np.flatnonzero(unsure):
                    Y[k] = self.Z.flexibility(force, float(omega[k]), ends)
        _add(G, rows, columns, frequencies_last(Y + size - self.rigid.between(a, b).over_square(omega)), loads)

    def _only_seen(self, left: Real, right: Real) -> Real | None:
        """Static flexibility (l, r) that the model leaves out, where efforts act along rows that are only seen.

        Such efforts measure how much a sensor could see (`AssembledModel.collocated`), and need few digits. None if an
        effort along other motions than those prepared is meant.
        """
        model, here = self._seeing, self.here
        sees, meant = (np.asarray(np.delete(side, here[self.loaded], axis=1).any(axis=1)) for side in (left, right))
        if not (sees.any() and meant.any()):
            # What the model knows of one end it knows of the other: it is symmetric.
            return np.zeros((len(left), len(right)))
        known = {row.tobytes() for row in left}
        if model is None or model.beyond is None or not all(row.tobytes() in known for row in right[meant]):
            return None
        return np.asarray((abs(left[:, here]) * model.beyond) @ (abs(right[:, here]) * meant[:, None]).T)

    def has_fewer(self, sides: Iterable[tuple[Real, Real]]) -> bool:
        """As of `ByRows`, if forces act along few of its motions."""
        return self.loaded is not None and super().has_fewer(sides)


def _add(G: Complex, rows: Ints, columns: Ints, Y: Complex, loads: Complex | None) -> None:
    """Add a part (rows, columns, f) of a flexibility to an array, or its motions under loads (r, i, f)."""
    if loads is None:
        G[np.ix_(rows, columns)] += Y
    else:
        G[rows] += np.einsum("lrf,rif->lif", Y, loads[columns])
