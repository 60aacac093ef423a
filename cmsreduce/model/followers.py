"""Dofs that follow others because rigid elements or constraints join them."""

from __future__ import annotations

from dataclasses import dataclass

import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model.dofs import DofTable

__all__ = ["Followers"]


@dataclass(frozen=True, eq=False)
class Followers:
    """Dependent dofs and their motion, x = T x_leads.

    Parameters
    ----------
    dofs : DofTable
        d dependent dofs.
    leads : DofTable
        i dofs that they follow, none of which is dependent itself.
    T : (d, i) sparse array
        Motion of each under unit motion of each it follows.

    Raises
    ------
    DofMapError
        If the sizes disagree.
    """

    dofs: DofTable
    leads: DofTable
    T: sp.csr_array

    def __post_init__(self) -> None:
        if self.T.shape != (len(self.dofs), len(self.leads)):
            raise DofMapError(f"{len(self.dofs)} dofs follow {len(self.leads)}, but {self.T.shape} numbers say how")
