"""A basis of shapes for one body, and what each shape is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model.certificate import ModeCertificate

__all__ = ["ModeBlock", "ModeKind", "ModeSet"]

ModeKind = Literal["rigid", "constraint", "fixed", "free", "residual", "loaded", "system"]


@dataclass(frozen=True, eq=False)
class ModeBlock:
    """Shapes of one kind.

    Parameters
    ----------
    kind : ModeKind
        What they are.
    shapes : (n, k) float64
        Columns.
    label : sequence of str
        Dof or load of a static shape, ordinal of a normal mode.
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
        What each column is.
    source_hz : (m,) float64
        Frequency of the eigenproblem a normal mode came from, 0 for rigid modes, NaN for static shapes.
    label : tuple of str
        Dof or load a static shape belongs to; ordinal of a normal mode.
    certificate : ModeCertificate, optional
        What is proven of the normal modes.
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
        """Put blocks of shapes side by side; ``Phi`` is what they are views of, where they lie so already."""
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
