"""Motion of dofs that have no row of their own because they follow other dofs."""

from __future__ import annotations

from dataclasses import dataclass

import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model.dofs import DofTable

__all__ = ["Recovery"]


@dataclass(frozen=True, eq=False)
class Recovery:
    """Dofs and their motion, x = T x_rows.

    Parameters
    ----------
    dofs : DofTable
        k dofs.
    T : (k, n) sparse array
        Motion of each under unit motion of each row of the body.

    Raises
    ------
    DofMapError
        If there is not one row of T for each dof.
    """

    dofs: DofTable
    T: sp.csr_array

    def __post_init__(self) -> None:
        T = sp.csr_array(self.T)
        if T.shape[0] != len(self.dofs):
            raise DofMapError(f"{len(self.dofs)} dofs follow others, but {T.shape[0]} rows say how")
        object.__setattr__(self, "T", T)
