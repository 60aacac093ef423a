"""Rows of a matrix in which translations cost no force: what tells a stiffness from a mass."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import absolute_product, symmetric_product
from cmsreduce.model import FEModel, Nodes, rigid_body_shapes
from cmsreduce.read.row_order.causes.failure import Failure

__all__ = ["LOUD", "QUIET", "mass_in_stiffness", "mistaken_matrices", "quiet_share"]

QUIET = 0.5
"""Least share of rows without force of a stiffness, whose supports disturb the rows next to them."""

LOUD = 0.1
"""Largest share of rows without force of a mass."""

# Every translation cancels in a row of a free stiffness, to the digits of the file: text may have four of them. In a
# row of a mass matrix the one along it adds up; those across cancel in bars that lie at an angle.
_NO_FORCE = 1e-3


def quiet_share(A: sp.csc_array, T: NDArray[np.float64]) -> float:
    """Share of the rows in which translations cost no force: 1 for a free stiffness, 0 for a mass.

    Parameters
    ----------
    A : (n, n) csc array
        Stiffness or mass, symmetric.
    T : (n, 3) float64
        Translations; rows that do not translate do not count.
    """
    whole, force = absolute_product(A)(abs(T)).max(axis=1), abs(symmetric_product(A)(T)).max(axis=1)
    rows = (abs(T).sum(axis=1) > 0) & (whole > 0)
    return float((force[rows] <= _NO_FORCE * whole[rows]).mean()) if rows.any() else 0.0


def mistaken_matrices(body: FEModel, nodes: Nodes) -> str | None:
    """Message if the stiffness and the mass have each other's place, or the mass stands for both."""
    T = rigid_body_shapes(body.dofs, nodes)[:, :3]
    if quiet_share(body.K, T) > LOUD:
        return None
    named = ", ".join(
        dict.fromkeys(source.path for source in body.sources if "stiffness" in source.holds or "mass" in source.holds)
    )
    files = f" ({named})" if named else ""
    if quiet_share(body.M, T) >= QUIET:
        return (
            f"the stiffness and the mass{files} are exchanged: translations cost no force in the matrix that is given "
            f"as mass, and do in the other. Exchange the two, `components.{body.name}.stiffness` and `.mass`"
        )
    same = body.K.nnz == body.M.nnz and not abs(body.K - body.M).sum()
    if not same:
        return None
    return f"the mass{files} is given as stiffness, too. Name the stiffness under `components.{body.name}.stiffness`"


def mass_in_stiffness(case: Failure) -> str | None:
    """The stiffness holds a multiple of the mass: its forces under rigid motion are those of inertia."""
    found = case.found
    inertia = symmetric_product(case.body.M)(found.shapes)
    size = float(np.square(inertia).sum())
    times = float((found.force * inertia).sum()) / size if size > 0 else 0.0
    rows = found.excess > 1
    if not times or not found.explained(rows, (found.force - times * inertia)[rows]):
        return None
    why = (
        "an eigenvalue solver shifts it so"
        if times > 0
        else f"spin of {np.sqrt(-times):.4g} radians per unit of time softens it so"
    )
    return (
        f"the stiffness holds {times:.4g} times the mass: {why}. Write the stiffness without it; that of a spinning "
        "body is given as a parameter, or as geometric stiffness"
    )
