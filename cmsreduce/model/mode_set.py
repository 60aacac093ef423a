"""A basis of shapes for one body, and what each shape is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["ModeKind", "ModeSet"]

ModeKind = Literal["rigid", "constraint", "fixed", "free", "residual", "loaded"]


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
        What each column is.
    source_hz : (m,) float64
        Frequency of the eigenproblem a normal mode came from, 0 for rigid modes, NaN for static shapes.
    label : tuple of str
        Dof or load a static shape belongs to; ordinal of a normal mode.
    """

    method: str
    Phi: NDArray[np.float64]
    kind: tuple[ModeKind, ...]
    source_hz: NDArray[np.float64]
    label: tuple[str, ...]

    def __post_init__(self) -> None:
        m = self.Phi.shape[1]
        if not len(self.kind) == len(self.label) == self.source_hz.size == m:
            raise MatrixError(f"mode set '{self.method}': {m} columns need {m} kinds, labels and frequencies")
        unknown = set(self.kind) - set(get_args(ModeKind))
        if unknown:
            raise MatrixError(f"mode set '{self.method}': unknown kinds of modes {sorted(unknown)}")

    @property
    def m(self) -> int:
        """Number of columns."""
        return int(self.Phi.shape[1])
