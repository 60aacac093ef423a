"""Small matrices, which may be sparse, as dense ones."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["dense"]


def dense(A: NDArray[np.float64] | sp.sparray) -> NDArray[np.float64]:
    """Make a small matrix dense: rows of points, coordinates of a reduced body, never the dofs of a full one."""
    return np.asarray(A.toarray() if sp.issparse(A) else A)  # type: ignore[union-attr]
