"""Parameters beside the joint angles: matrices that depend on a number, K = K0 + sum of p^k K_p, M and D alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["ParameterTerm", "Values", "parameter_label", "unresisted", "varied"]

Matrix = NDArray[np.float64] | sp.csc_array
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
        Name of the parameter.
    letter : {"M", "D", "K"}
        Matrix to which it is added.
    matrix : (n, n) Matrix
        Symmetric, for the value 1 of the parameter in the scene's units.
    power : int
        1 for preload, temperature, mass, stiffness; 2 for the stress of a spin.
    """

    parameter: str
    letter: Literal["M", "D", "K"]
    matrix: Matrix
    power: int = 1

    def factor(self, values: Values) -> float:
        """Factor of the matrix at some values of the parameters."""
        return float(values.get(self.parameter, 0.0)) ** self.power

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


def unresisted(matrices: Iterable[Matrix], rigid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Combinations (r, s), orthonormal, of rigid motions (n, r) on which none of some matrices acts."""
    left = np.eye(rigid.shape[1])
    for A in matrices:
        if not left.shape[1]:
            break
        whole: NDArray[np.float64] = np.asarray(abs(sp.csr_array(A)).sum(axis=1))
        size = float(whole.max(initial=0.0)) * abs(rigid).max(axis=0)
        force = np.asarray(A @ rigid) / np.where(size > 0, size, 1.0)
        _, s, V = np.linalg.svd(force @ left)
        rank = int(np.count_nonzero(s > _RESISTS))
        left = left @ V[rank:].T
    return left


def parameter_label(values: Values) -> str:
    """Values in words.

    Examples
    --------
    >>> parameter_label({"preload": 50000.0, "spin": 0.0})
    'preload=50000 spin=0'
    """
    return " ".join(f"{name}={value + 0.0:.6g}" for name, value in values.items())
