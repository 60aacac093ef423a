"""Result of the proof of the row order, and the rows that it leaves out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel

__all__ = ["NONE_HIDDEN", "HiddenRows", "RowOrderProof", "hidden_rows"]

_ALL_MOTIONS = 6
_NAMED = 5


class HiddenRows(NamedTuple):
    """Rows whose order neither forces against rigid motion nor couplings show.

    Parameters
    ----------
    rows : (k,) int64
        Their numbers, in order.
    total : int
        Rows of the body.
    remark : str
        The rows, and the reason.
    turning : bool
        True if forces under uniform strain do not show these either: rotations, and rows beside supports.
    mirrored : bool
        True if all rows could be those of the mirror image.
    """

    rows: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
    total: int = 0
    remark: str = ""
    turning: bool = False
    mirrored: bool = False

    @property
    def only(self) -> str:
        """Rows whose order is proven, in words; empty if there are no others."""
        some = f"{self.total - self.rows.size} of {self.total} rows" if self.rows.size else ""
        return f"{some or 'order'} or {'their' if some else 'its'} mirror image" if self.mirrored else some

    @property
    def every(self) -> bool:
        """True if no row is proven."""
        return 0 < self.total == self.rows.size

    def without_rows(self) -> HiddenRows:
        """The rest, once these rows are shown by other means."""
        return self._replace(rows=self.rows[:0]) if self.mirrored else NONE_HIDDEN

    def joined(self, other: HiddenRows) -> HiddenRows:
        """The rows of both."""
        if not (self.only and other.only):
            return self if self.only else other
        turning, mirrored = self.turning or other.turning, self.mirrored or other.mirrored
        rows = np.union1d(self.rows, other.rows)
        return HiddenRows(rows, self.total, f"{self.remark}; {other.remark}", turning, mirrored)


NONE_HIDDEN = HiddenRows()
"""Every row is shown."""


def hidden_rows(body: FEModel, rows: NDArray[np.int64], why: str, turning: bool = True) -> HiddenRows:
    """Rows of a body that a proof leaves out, and the reason, in words that follow their names."""
    if not rows.size:
        return NONE_HIDDEN
    named = ", ".join(body.dofs[rows[:_NAMED]].labels)
    return HiddenRows(rows, body.n, f"{rows.size} rows ({named}{' ...' if rows.size > _NAMED else ''}) {why}", turning)


@dataclass(frozen=True, eq=False)
class RowOrderProof:
    """Result of the proof of the row order.

    Parameters
    ----------
    status : str
        ``proven``; ``trusted`` (not proven, and the user vouches for it); ``grounded`` (supports hold too many nodes
        or motions for a proof), ``no geometry`` or ``scalar`` (no geometry is needed: the body has no dofs of points).
    motions : int
        Rigid motions of the whole body that were tried; 0 if the ground holds it.
    residual : float
        Largest force against rigid motion relative to sqrt(K_ii K_jj) times the motion, in the row nearest to its
        tolerance.
    tolerance : float
        Force that rounding of the matrix and of the coordinates may leave in that row.
    remark : str
        Reason why there is no proof, or how a held body was proven; empty if all motions vanish.
    rounding, noise : float
        Errors of K that explain the forces, as in ``FEModel``; 0 without a proof.
    exact : bool
        True if all six motions vanish with the coordinates as they are, whatever their digits.
    xyz_rounding : float
        Error of the coordinates, beyond the digits that they show, that explains the forces; 0 without a proof.
    hidden : HiddenRows
        Rows that a proof leaves out.
    beside : int
        Nodes of a held body that stand next to dofs without rows.
    """

    status: str
    motions: int = 0
    residual: float = 0.0
    tolerance: float = 0.0
    remark: str = ""
    rounding: float = 0.0
    noise: float = 0.0
    exact: bool = False
    xyz_rounding: float = 0.0
    hidden: HiddenRows = NONE_HIDDEN
    beside: int = 0

    @property
    def free(self) -> bool:
        """True if the rows are proven, and no rigid motion costs force."""
        return self.status == "proven" and self.motions == _ALL_MOTIONS

    def estimated(self, body: FEModel) -> FEModel:
        """The body with the errors of K and of the coordinates that the proof found."""
        found = (max(body.rounding, self.rounding), max(body.noise, self.noise))
        if self.exact and body.nodes is not None and (body.nodes.xyz_rounding or body.nodes.frame_rounding):
            body = replace(body, nodes=replace(body.nodes, xyz_rounding=0.0, frame_rounding=0.0))
        elif self.xyz_rounding and body.nodes is not None:
            off = max(self.xyz_rounding, body.nodes.xyz_rounding)
            body = replace(body, nodes=replace(body.nodes, xyz_rounding=off))
        return body if found == (body.rounding, body.noise) else replace(body, rounding=found[0], noise=found[1])
