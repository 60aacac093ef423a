"""Dofs without mass, or with next to none, and how far apart the stiffest and the softest dof are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel

__all__ = ["Contrast", "LightDofs", "light_dofs", "stiffness_contrast"]

# Mass this far below the median of its kind moves by itself at ten thousand times the frequency of its neighbours: it
# is a number put in to make a matrix regular, and costs time steps.
_NEARLY = 1e-8


@dataclass(frozen=True, eq=False)
class LightDofs:
    """Rows that carry no mass, and rows that nearly do not.

    Parameters
    ----------
    massless : (k,) int64
        Rows of M that are empty.
    nearly : (l,) int64
        Rows whose diagonal entry is far below the median of their kind, translations or rotations; lightest first.
    highest_hz : float
        sqrt(K_ii / M_ii) / 2 pi of the row where it is highest: no time step can pass over it.
    highest : int
        That row; -1 without any mass.
    """

    massless: NDArray[np.int64]
    nearly: NDArray[np.int64]
    highest_hz: float
    highest: int


@dataclass(frozen=True)
class Contrast:
    """Ratio of the stiffest to the softest dof of a kind.

    Parameters
    ----------
    kind : str
        ``translations``, ``rotations`` or ``scalars``.
    ratio : float
        Of the diagonal entries of K; the softest is the smallest that is not zero.
    stiffest, softest : int
        Rows.
    """

    kind: str
    ratio: float
    stiffest: int
    softest: int


def light_dofs(body: FEModel) -> LightDofs:
    """Find dofs without mass, and with next to none."""
    empty = np.asarray(abs(body.M).sum(axis=0)).ravel() == 0
    own = body.M.diagonal()
    nearly = np.zeros(body.n, dtype=bool)
    for rows in _kinds(body).values():
        heavy = own[rows][own[rows] > 0]
        if heavy.size:
            nearly[rows] = (own[rows] < _NEARLY * np.median(heavy)) & ~empty[rows]
    found = np.flatnonzero(nearly)
    ratio = np.divide(body.K.diagonal(), own, out=np.zeros(body.n), where=own > 0)
    top = int(ratio.argmax()) if (own > 0).any() else -1
    highest = float(np.sqrt(max(ratio[top], 0.0)) / (2 * np.pi)) if top >= 0 else 0.0
    return LightDofs(np.flatnonzero(empty), found[np.argsort(own[found], kind="stable")], highest, top)


def stiffness_contrast(body: FEModel) -> list[Contrast]:
    """Contrast of each kind of dof; a file of d digits keeps nothing of a spring that is 10^d times softer."""
    found = []
    own = body.K.diagonal()
    for kind, rows in _kinds(body).items():
        held = rows[own[rows] > 0]
        if held.size:
            high, low = held[own[held].argmax()], held[own[held].argmin()]
            found.append(Contrast(kind, float(own[high] / own[low]), int(high), int(low)))
    return found


def _kinds(body: FEModel) -> dict[str, NDArray[np.int64]]:
    c = body.dofs.component
    return {
        "translations": np.flatnonzero((c > 0) & (c <= 3)),
        "rotations": np.flatnonzero(c > 3),
        "scalars": np.flatnonzero(c == 0),
    }
