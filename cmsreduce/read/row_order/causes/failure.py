"""A body whose proof failed: what the search for causes starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.read.row_order.rigid_residual import RigidResidual, rigid_residual

__all__ = ["Failure"]

# A spring to ground loads only its own node; a mislabelled node also loads all its neighbours.
_FEW_NODES, _FEW_SHARE = 3, 0.1
# Relative to the largest force on a row: a smaller one is round-off.
_NO_FORCE = 1e-6


@dataclass(frozen=True, eq=False)
class Failure:
    """A body whose proof failed, its forces against rigid motion, and the nodes that they load."""

    body: FEModel
    nodes: Nodes
    found: RigidResidual
    condensed: bool
    loaded: NDArray[np.int64]

    def explains(self, dofs: DofTable | None = None, nodes: Nodes | None = None) -> bool:
        """True if the forces vanish with other row labels or another geometry."""
        body, fixed = self.body, None if self.body.grounded else self.body.constrained
        other = rigid_residual(body.K, dofs or body.dofs, nodes or self.nodes, fixed, body.rounding, self.condensed)
        if self.body.grounded or self.found.motions.shape[1] == 0:
            rows = other.excess > 1
            return 2 * np.unique(body.dofs.node[rows]).size < self.loaded.size
        return other.motions.shape[1] >= self.found.motions.shape[1] and other.vanishes

    @property
    def local(self) -> bool:
        """True if forces act on a few nodes only."""
        total = self.body.dofs.node_ids.size
        return bool(self.loaded.size <= max(_FEW_NODES, _FEW_SHARE * total) and self.loaded.size < total)

    @property
    def only_turning(self) -> bool:
        """True if translations of the body cost no force."""
        if not np.array_equal(self.found.motions, np.eye(6)):
            return False
        bad = self.found.excess > 1
        limit = np.abs(self.found.force[bad]).max(axis=1) * _NO_FORCE
        return bool((np.abs(self.found.force[bad, :3]) <= limit[:, None]).all())
