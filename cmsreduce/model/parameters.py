"""Parameters beside the joint angles: matrices that depend on a number, K = K0 + sum of p^k K_p, M and D alike.

Gyroscopic matrices, skew parts of the damping, are terms too: of a parameter such as a spin, or always there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["Letter", "ParameterTerm", "Values", "parameter_label", "unresisted", "varied", "with_gyroscopic"]

Matrix = NDArray[np.float64] | sp.csc_array
Letter = Literal["M", "D", "K", "G"]
"""Mass, viscous damping, stiffness, and gyroscopic matrix, which is skew and a part of the damping."""
Values = Mapping[str, float]
"""Values of parameters by name, in the scene's units; a parameter without a value is zero."""

# A rigid motion on which a matrix acts with less than this share of its largest row is not resisted: stresses and
# springs that a program prints in six digits leave 1e-6.
_RESISTS = 1e-5


@dataclass(frozen=True, eq=False)
class ParameterTerm:
    """A matrix that a parameter adds, times a power of its value.

    Parameters
    ----------
    parameter : str
        Name of the parameter; empty for a matrix that is always there.
    letter : {"M", "D", "K", "G"}
        Matrix to which it is added; G is added to D.
    matrix : (n, n) Matrix
        Symmetric, or skew if gyroscopic, for the value 1 of the parameter in the scene's units.
    power : int
        1 for preload, temperature, mass, stiffness, spin; 2 for the stress of a spin; 0 for a matrix that is always
        there.
    """

    parameter: str
    letter: Letter
    matrix: Matrix
    power: int = 1

    def factor(self, values: Values) -> float:
        """Factor of the matrix at some values of the parameters."""
        return float(values.get(self.parameter, 0.0)) ** self.power

    @property
    def constant(self) -> bool:
        """True if the matrix does not depend on a parameter."""
        return self.power == 0

    @property
    def gyroscopic(self) -> bool:
        """True if the matrix is skew: its forces do no work."""
        return self.letter == "G"

    @property
    def dense(self) -> NDArray[np.float64]:
        """The matrix as a dense array, of a body in a few modes."""
        return self.matrix.toarray() if isinstance(self.matrix, sp.sparray) else np.asarray(self.matrix)

    def over(self, T: NDArray[np.float64]) -> ParameterTerm:
        """The term over other coordinates, of which the old ones are T (n, m) times."""
        return replace(self, matrix=T.T @ self.dense @ T)

    def within(self, columns: NDArray[np.int64]) -> ParameterTerm:
        """The term over some of the coordinates."""
        return replace(self, matrix=self.dense[np.ix_(columns, columns)])


def varied(A: Matrix | None, terms: Iterable[ParameterTerm], letter: str, values: Values) -> Matrix | None:
    """A matrix with what the parameters add to it; the matrix itself where they add nothing."""
    for term in terms:
        if term.letter == letter and (factor := term.factor(values)):
            A = factor * term.matrix if A is None else A + factor * term.matrix
    return sp.csc_array(A) if isinstance(A, sp.sparray) else A


def with_gyroscopic(D: Matrix | None, terms: Iterable[ParameterTerm]) -> Matrix | None:
    """A damping matrix with the gyroscopic matrices that are always there; it is then not symmetric."""
    return varied(D, [term for term in terms if term.constant], "G", {})


def unresisted(matrices: Iterable[Matrix], rigid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Combinations (r, s), orthonormal, of rigid motions (n, r) on which none of some matrices acts."""
    left = np.eye(rigid.shape[1])
    for A in matrices:
        if not left.shape[1]:
            break
        whole: NDArray[np.float64] = np.asarray(abs(sp.csr_array(A)).sum(axis=1))
        moved = rigid @ left
        size = float(whole.max(initial=0.0)) * abs(moved).max(axis=0)
        size = np.where(size > 0, size, 1.0)
        _, s, V = np.linalg.svd(np.asarray(A @ moved) / size)
        rank = int(np.count_nonzero(s > _RESISTS))
        left = left @ np.linalg.qr(V[rank:].T / size[:, None])[0]
    return left


def parameter_label(values: Values) -> str:
    """Values in words.

    Examples
    --------
    >>> parameter_label({"preload": 50000.0, "spin": 0.0})
    'preload=50000 spin=0'
    """
    return " ".join(f"{name}={value + 0.0:.6g}" for name, value in values.items())
