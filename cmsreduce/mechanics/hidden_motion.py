"""Motion of dofs without rows: dofs that rigid elements move, and condensed dofs."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.sparse import NotPositiveDefiniteError, factorise
from cmsreduce.mechanics.bars import end_motion, member_stiffness
from cmsreduce.model import DofTable, FEModel, Members, Recovery

__all__ = ["condensed_dofs", "hidden_motion"]

Keys = NDArray[np.int64]

_SIX = np.arange(1, 7)
# Relative to the diagonal: decks print four digits or more of a section; a part that is missing is of order one.
_PRINTED = 2e-3
# Relative to the largest stiffness: a dof with less is held by round-off only, and by no element.
_NOTHING = 1e-14

_REMEDY = "give the full matrices, or the geometric stiffness itself (`matrices:`)"


def condensed_dofs(body: FEModel, followers: Recovery, wanted: DofTable) -> DofTable:
    """Condensed dofs among some dofs and their leads: no row, no constraint, and no other dof that they follow.

    Parameters
    ----------
    body : FEModel
        As its files have it.
    followers : Recovery
        Dofs that rigid elements of its deck move.
    wanted : DofTable
        Dofs with a motion that is needed.
    """
    used = sp.csr_array(followers.T[np.isin(followers.dofs.keys, wanted.keys)])
    leads = followers.leads.keys[np.unique(used.indices)]
    return _without_rows(body, np.setdiff1d(np.union1d(wanted.keys, leads), followers.dofs.keys))


def hidden_motion(body: FEModel, followers: Recovery, members: Members | None = None) -> Recovery:
    """Motion of dofs of a deck that have no row in the matrices.

    Parameters
    ----------
    body : FEModel
        n rows, as its files have it.
    followers : Recovery
        Dofs that rigid elements move.
    members : Members, optional
        All elastic members of the deck, if some dofs were condensed: in its units.

    Returns
    -------
    Recovery
        Condensed dofs, then those that follow, with the rows of the body as leads.

    Raises
    ------
    DofMapError
        If the members, condensed, are not the stiffness matrix of the body; or if they leave a condensed dof free.

    Notes
    -----
    Condensed dofs move as they do at rest without a load of their own, x_o = -K_oo^-1 K_or x_r (Guyan): the matrices
    were condensed in this way. This needs K of all members, and this K, condensed, must be the stiffness matrix of the
    body.
    """
    n = body.n
    if members is None:
        condensed = DofTable.from_keys(np.zeros(0, dtype=np.int64))
    else:
        ends, springs = np.unique(members.node), np.unique(members.between.reshape(-1, 2), axis=0)
        six = DofTable(np.repeat(ends, 6), np.tile(_SIX, ends.size))
        at_springs = DofTable(*springs[springs[:, 0] > 0].T)
        keys = np.concatenate([six.keys, at_springs.keys, followers.leads.keys])
        condensed = _without_rows(body, np.setdiff1d(keys, followers.dofs.keys))
    known = _with_followers(body.dofs.joined(condensed), followers)
    T = sp.csr_array((0, n)) if members is None else _condensation(body, known, members, len(condensed))
    onto = sp.vstack([sp.eye_array(n), T], format="csr")
    return Recovery(known.dofs[n:], body.dofs, sp.csr_array(known.T[n:] @ onto))


def _without_rows(body: FEModel, keys: Keys) -> DofTable:
    dofs = DofTable.from_keys(keys)
    lacking = body.dofs.rows(dofs.node, dofs.component) < 0
    if body.constrained is not None:
        lacking &= body.constrained.rows(dofs.node, dofs.component) < 0
    return dofs[lacking]


def _with_followers(own: DofTable, followers: Recovery) -> Recovery:
    """Rows of the body and condensed dofs, then the dofs that follow them; other leads do not move."""
    new = own.rows(followers.dofs.node, followers.dofs.component) < 0
    at = own.rows(followers.leads.node, followers.leads.component)
    there = np.flatnonzero(at >= 0)
    pick = sp.csr_array((np.ones(there.size), (there, at[there])), shape=(at.size, len(own)))
    T = sp.vstack([sp.eye_array(len(own)), followers.T[new] @ pick])
    return Recovery(own.joined(followers.dofs[new]), own, sp.csr_array(T))


def _condensation(body: FEModel, known: Recovery, members: Members, o: int) -> sp.csr_array:
    """Motion of the condensed dofs (o, n); an error if the matrices were not condensed by it."""
    n = body.n
    K = _assembled(body, known, members)
    free = n + np.flatnonzero(K.diagonal()[n:] > _NOTHING * K.diagonal().max())
    beside = np.flatnonzero(np.diff(sp.csc_array(K[free][:, :n]).indptr))
    try:
        factor = factorise(sp.csc_array(K[free][:, free]), what=f"the stiffness of condensed dofs of '{body.name}'")
        # Only the dofs beside the condensed ones move these.
        block = -factor(K[free][:, beside].toarray())
    except NotPositiveDefiniteError as error:
        label = known.dofs.labels[free[error.row]]
        raise DofMapError(
            f"body '{body.name}': dof {label} of its bars has no row in the matrices, and bars, rods and springs of "
            f"the deck leave it free, so its motion is not known; {_REMEDY}"
        ) from None
    where = np.repeat(free - n, beside.size), np.tile(beside, free.size)
    follows = sp.csr_array((block.ravel(), where), shape=(o, n))
    follows.eliminate_zeros()
    left = sp.csr_array(K[:n, :n] + K[:n, n:] @ follows)
    size = np.sqrt(np.abs(body.K.diagonal()))
    scale = sp.diags_array(1 / np.where(size > 0, size, np.inf))
    missing = sp.coo_array(scale @ (left - body.K) @ scale)
    if abs(missing.data).max(initial=0.0) > _PRINTED:
        worst = int(abs(missing.data).argmax())
        label = body.dofs.labels[missing.row[worst]]
        raise DofMapError(
            f"body '{body.name}': some dofs of its bars have no row in the matrices, as if condensed, or follow others "
            f"by a mean (RBE3); but its bars, rods and springs, condensed, are not the stiffness matrix: at {label} "
            f"they differ by {abs(missing.data[worst]):.2g} of its diagonal. So their motion is not known; "
            f"{_REMEDY}"
        )
    return follows


def _assembled(body: FEModel, known: Recovery, members: Members) -> sp.csr_array:
    assert body.nodes is not None
    b = members.EA.size
    motion = end_motion(body.nodes, members.node.ravel(), known, members.offset.reshape(-1, 3))
    blocks = sp.bsr_array(
        (member_stiffness(members, body.nodes), np.arange(b), np.arange(b + 1)), shape=(12 * b, 12 * b)
    )
    # A spring stretches by the difference of its two dofs; the ground does not move.
    stretch = sp.csr_array((members.spring.size, known.T.shape[1]))
    for end, sign in ((0, 1.0), (1, -1.0)):
        at = known.dofs.rows(members.between[:, end, 0], members.between[:, end, 1])
        there = np.flatnonzero(at >= 0)
        pick = sp.csr_array((np.full(there.size, sign), (there, at[there])), shape=(at.size, len(known.dofs)))
        stretch = stretch + pick @ known.T
    K = motion.T @ (sp.csr_array(blocks) @ motion) + stretch.T @ sp.diags_array(members.spring) @ stretch
    return sp.csr_array((K + K.T) * 0.5)
