"""Shapes that span a reduced body, and the proof that no normal mode is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["REPEATED", "ModeBlock", "ModeCertificate", "ModeKind", "ModeSet", "repeated_groups"]

REPEATED = 1e-6
"""Frequencies this close, relative to them, belong to one repeated mode: a mesh is no closer to a symmetry."""

ModeKind = Literal["rigid", "constraint", "fixed", "free", "residual", "loaded", "response", "damped", "system"]
"""Kind of a shape, by the problem that it solves."""


@dataclass(frozen=True, eq=False)
class ModeCertificate:
    """Proof that no normal mode below a cutoff is missing, and how exact the frequencies are.

    Parameters
    ----------
    cutoff_hz : float
        Upper end of the range in which all modes were computed.
    counted : int or None
        Number of elastic modes below it by a Sturm count, which does not use the modes; None for a small body, of which
        all modes were computed.
    frequency_hz : (k,) float64
        Frequencies of the free or of the fixed-interface modes.
    bound : (k,) float64
        Upper bound on the relative error of each frequency, from the residual of its mode.
    """

    cutoff_hz: float
    counted: int | None
    frequency_hz: NDArray[np.float64]
    bound: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.frequency_hz.shape != self.bound.shape:
            raise MatrixError(f"{self.frequency_hz.size} frequencies need as many bounds, not {self.bound.size}")

    @property
    def worst_bound(self) -> float:
        """Largest bound; zero without modes."""
        return float(self.bound.max(initial=0.0))


@dataclass(frozen=True, eq=False)
class ModeBlock:
    """Shapes of one kind.

    Parameters
    ----------
    kind : ModeKind
        Kind of all of them.
    shapes : (n, k) float64
        Columns.
    label : sequence of str
        Dof or load of a static shape, number of a normal mode.
    source_hz : (k,) float64, optional
        Frequencies of normal modes; NaN for static shapes if absent, 0 for rigid ones.
    """

    kind: ModeKind
    shapes: NDArray[np.float64]
    label: Sequence[str]
    source_hz: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class ModeSet:
    """Shapes that span a reduced body.

    Parameters
    ----------
    method : str
        Mode set, such as ``craig-bampton``.
    Phi : (n, m) float64
        Shapes as columns, rows as in the body's dof table.
    kind : tuple of ModeKind
        Kind of each column.
    source_hz : (m,) float64
        Frequency of a normal mode in its eigenproblem, 0 for rigid modes, NaN for static shapes.
    label : tuple of str
        Dof or load of a static shape; number of a normal mode.
    certificate : ModeCertificate, optional
        Proof about the normal modes.
    """

    method: str
    Phi: NDArray[np.float64]
    kind: tuple[ModeKind, ...]
    source_hz: NDArray[np.float64]
    label: tuple[str, ...]
    certificate: ModeCertificate | None = None

    def __post_init__(self) -> None:
        m = self.Phi.shape[1]
        if not len(self.kind) == len(self.label) == self.source_hz.size == m:
            raise MatrixError(f"mode set '{self.method}': {m} columns need {m} kinds, labels and frequencies")
        unknown = set(self.kind) - set(get_args(ModeKind))
        if unknown:
            raise MatrixError(f"mode set '{self.method}': unknown kinds of modes {sorted(unknown)}")

    @classmethod
    def of(
        cls,
        method: str,
        blocks: Sequence[ModeBlock],
        certificate: ModeCertificate | None = None,
        Phi: NDArray[np.float64] | None = None,
    ) -> ModeSet:
        """Put blocks of shapes side by side; ``Phi`` is given if the blocks are already views of one array."""
        source = [
            np.full(block.shapes.shape[1], 0.0 if block.kind == "rigid" else np.nan)
            if block.source_hz is None
            else block.source_hz
            for block in blocks
        ]
        return cls(
            method,
            np.hstack([block.shapes for block in blocks]) if Phi is None else Phi,
            tuple(block.kind for block in blocks for _ in block.label),
            np.concatenate(source),
            tuple(name for block in blocks for name in block.label),
            certificate,
        )

    @property
    def m(self) -> int:
        """Number of columns."""
        return int(self.Phi.shape[1])


def repeated_groups(omega: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number the groups of repeated frequencies.

    Modes of one group span one subspace, in which any rotation is as good.

    Parameters
    ----------
    omega : (e,) float64
        Frequencies in rad/s.

    Returns
    -------
    (e,) int64
        Group of each mode, counted from 0 in order of frequency; a mode by itself is a group of one.

    Examples
    --------
    >>> repeated_groups(np.array([1.0, 2.0, 2.0 + 1e-9, 3.0])).tolist()
    [0, 1, 1, 2]
    """
    order = np.argsort(omega, kind="stable")
    w = omega[order]
    group = np.zeros(omega.size, dtype=np.int64)
    group[order[1:]] = np.cumsum(w[1:] > w[:-1] * (1 + REPEATED))
    return group
