"""Stiffness held at as few dofs as the body has free motions: those motions then follow to the last digits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import Product, rows_of, symmetric_product
from cmsreduce.linalg.machine import share_rows
from cmsreduce.linalg.sparse import SOUND_PIVOT, Factor, InterfaceLast, held_factor

Array = NDArray[np.float64]

# Corrections of a free motion by residuals in long double; each gains the digits that one factor gives. Where the next
# one, which shrinks as the last one did, would change no entry by more than this share of the largest, none is needed.
_CORRECTIONS, _CORRECTED = 3, 1e-13
# Force of a change below this share of the shape: its rounding in double precision is below that of the whole in long
# double, which has eleven more bits.
_SMALL = 2.0**-11
# Rows that are copied to long double at a time: all of them would be twice as large as the body.
_COPIED = 4096


@dataclass(frozen=True)
class HeldStiffness:
    """Stiffness without the dofs that free motions move independently, factorised.

    The error of an eigenvector is rounding over the gap to the next eigenvalue: a few per cent beside a motion seven
    decades softer than the stiffest. Residuals in long double restore the digits.

    Attributes
    ----------
    K : (n, n) sparse array
        The whole stiffness.
    given, free : (k,), (n - k,) int64
        Dofs that are held, as many as there are motions, and the others in order.
    factor : Factor or InterfaceLast
        Of the stiffness between the free dofs.
    """

    K: sp.csc_array
    given: NDArray[np.int64]
    free: NDArray[np.int64]
    factor: Factor | InterfaceLast

    @classmethod
    def of(
        cls,
        K: sp.csc_array,
        motions: Array,
        what: str,
        interface: NDArray[np.int64] | None = None,
        sound: float = SOUND_PIVOT,
    ) -> HeldStiffness:
        """Hold a stiffness against (n, k) independent motions, as `held_factor` does; k may be zero.

        Raises
        ------
        NotPositiveDefiniteError
            If the body has another free motion.
        """
        return cls(K, *held_factor(K, motions, what, interface, sound))

    def independent(self, motions: Array) -> Array:
        """Free motions of K near the given ones, each of which moves one of the held dofs by one."""
        X = motions @ np.linalg.inv(motions[self.given])
        X[self.given] = np.eye(self.given.size)
        return self.solved(X)

    def solved(self, X: Array) -> Array:
        """Shapes with the values of X at the held dofs that leave no force on the others."""
        force, last = self._force(X), 0.0
        for _ in range(_CORRECTIONS):
            before, X = X, X.copy()
            change = self.factor(force[self.free])
            X[self.free] -= change
            share = float((abs(change).max(axis=0) / abs(X).max(axis=0)).max(initial=0.0))
            if share * (share / last if last > share else 1.0) <= _CORRECTED:
                break
            force, last = force + self._product(X - before) if share <= _SMALL else self._force(X), share
        return np.asarray(X)

    def largest_force(self, X: Array) -> float:
        """Largest force of shapes, each over the root of the stiffness of its own dof."""
        own = np.sqrt(abs(self.K.diagonal()))
        stiff = own > 0
        return float((abs(self._product(X))[stiff] / own[stiff, None]).max(initial=0.0))

    @cached_property
    def _product(self) -> Product:
        return symmetric_product(self.K)

    def _force(self, X: Array) -> Array:
        """K X with sums in long double."""
        exact, force = np.asfortranarray(X, dtype=np.longdouble), np.empty(X.shape)

        def multiply(_: int, rows: slice) -> None:
            part = rows_of(self.K, rows.start, rows.stop)
            part = sp.csr_array((part.data.astype(np.longdouble), part.indices, part.indptr), part.shape)
            # The sum of one column stays in a register; those of a block would go to memory and back at each entry.
            for k in range(X.shape[1]):
                force[rows, k] = part @ exact[:, k]

        share_rows(X.shape[0], _COPIED, multiply)
        return force
