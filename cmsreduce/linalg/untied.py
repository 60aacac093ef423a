"""A tied body as it was before it was tied: its mass where its nodes are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from cmsreduce.model import Damping, FEModel

__all__ = ["untied_body"]


def untied_body(body: FEModel) -> tuple[FEModel, sp.csr_array]:
    """The mass of a body over the dofs it was read with.

    Parameters
    ----------
    body : FEModel
        n dofs.

    Returns
    -------
    whole : FEModel
        Of g dofs, with the mass of every node in rows of its own, without stiffness; the body itself if nothing of it
        is tied.
    T : (g, n) sparse array
        Their motion under unit motion of each row of the body: ``body.M`` is T^T ``whole.M`` T.
    """
    if body.untied is None:
        return body, sp.eye_array(body.n, format="csr")
    dofs, every = body.untied.dofs, body.recovery
    rows = every.dofs.rows(dofs.node, dofs.component)
    # What nothing moves is held and has no row.
    moving = sp.diags_array((rows >= 0).astype(np.float64))
    whole = replace(
        body,
        K=sp.csc_array((len(dofs), len(dofs))),
        M=body.untied.M,
        D=None,
        dofs=dofs,
        damping=Damping(),
        interfaces={},
        sets={},
        tied=None,
        untied=None,
    )
    return whole, sp.csr_array(moving @ every.T[np.maximum(rows, 0)])
