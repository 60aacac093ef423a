"""The mass of a body where its nodes are, before any of them were tied to points."""

from __future__ import annotations

from dataclasses import dataclass

import scipy.sparse as sp

from cmsreduce.model.dofs import DofTable

__all__ = ["UntiedMass"]


@dataclass(frozen=True, eq=False)
class UntiedMass:
    """Mass matrix over the dofs that a body was read with.

    A tie restates the mass in other dofs, in which a row is no longer a motion of one place along one axis. What is
    integrated over places, or gathered at nodes, is of this one.

    Parameters
    ----------
    dofs : DofTable
        g dofs.
    M : (g, g) sparse array
        Mass.
    """

    dofs: DofTable
    M: sp.csc_array
