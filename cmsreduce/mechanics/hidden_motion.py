"""Motion of dofs without rows: those that rigid elements move, and those that were condensed."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.sparse import NotPositiveDefiniteError, factorise
from cmsreduce.mechanics.bars import end_motion, member_stiffness
from cmsreduce.model import DofTable, FEModel, Followers, Members, Recovery

__all__ = ["condensed_dofs", "hidden_motion"]

Array = NDArray[np.float64]
Keys = NDArray[np.int64]

# A dof is held as node * 8 + component.
_STEP = 8
# Relative to the diagonal: decks print four digits or more of a section; a part that is missing is of order one.
_PRINTED = 2e-3
# Of the largest stiffness of its kind: a dof that only round-off holds is held by no element.
_NOTHING = 1e-14

_REMEDY = "give the full matrices, or the geometric stiffness itself (`matrices:`)"


def condensed_dofs(body: FEModel, followers: Followers, wanted: DofTable) -> DofTable:
    """Those of some dofs, and of what they follow, that have no row, are not constrained and follow nothing.

    Parameters
    ----------
    body : FEModel
        As its files have it.
    followers : Followers
        Dofs that rigid elements of its deck move.
    wanted : DofTable
        Dofs whose motion is asked for.
    """
    keys = _keys(wanted)
    follows = _keys(followers.dofs)
    used = sp.csr_array(followers.T[np.isin(follows, keys)])
    leads = _keys(followers.leads)[np.unique(used.indices)]
    return _table(_without_rows(body, np.setdiff1d(np.union1d(keys, leads), follows)))


def hidden_motion(body: FEModel, followers: Followers, members: Members | None = None) -> Recovery:
    """Motion of dofs of a deck that have no row in the matrices.

    Parameters
    ----------
    body : FEModel
        n rows, as its files have it.
    followers : Followers
        Dofs that rigid elements move.
    members : Members, optional
        All elastic members of the deck, if some dofs were condensed: in its units.

    Returns
    -------
    Recovery
        Dofs that follow, then condensed ones, of the rows.

    Raises
    ------
    DofMapError
        If the members, condensed, are not the stiffness matrix of the body; or if they leave a condensed dof free.

    Notes
    -----
    Condensed dofs move as they do at rest without a load of their own, x_o = -K_oo^-1 K_or x_r (Guyan), which is how
    the matrices were condensed. K of the members is needed for it, and what is left of K when they are condensed has to
    be the body's own.
    """
    hidden = np.zeros(0, dtype=np.int64)
    if members is not None:
        six = np.repeat(members.node.ravel(), 6) * _STEP + np.tile(np.arange(1, 7), members.node.size)
        at_springs = members.between.reshape(-1, 2)
        keys = np.concatenate([six, (at_springs[:, 0] * _STEP + at_springs[:, 1])[at_springs[:, 0] > 0]])
        keys = np.union1d(np.unique(keys), _keys(followers.leads))
        hidden = _without_rows(body, np.setdiff1d(keys, _keys(followers.dofs)))
    n, o = body.n, hidden.size
    own = DofTable(np.concatenate([body.dofs.node, hidden // _STEP]), np.concatenate([body.dofs.component, hidden % 8]))
    known = _with_followers(own, followers)
    T = sp.csr_array((0, n)) if members is None else _condensation(body, known, members, n, o)
    onto = sp.vstack([sp.eye_array(n), T], format="csr")
    return Recovery(_after(known.dofs, n), sp.csr_array(known.T[n:] @ onto))


def _with_followers(own: DofTable, followers: Followers) -> Recovery:
    """Dofs of the body and the condensed ones, then those that follow them; leads in neither stand still."""
    apart = own.rows(followers.dofs.node, followers.dofs.component) < 0
    at = own.rows(followers.leads.node, followers.leads.component)
    there = np.flatnonzero(at >= 0)
    pick = sp.csr_array((np.ones(there.size), (there, at[there])), shape=(len(followers.leads), len(own)))
    dofs = DofTable(
        np.concatenate([own.node, followers.dofs.node[apart]]),
        np.concatenate([own.component, followers.dofs.component[apart]]),
    )
    return Recovery(dofs, sp.csr_array(sp.vstack([sp.eye_array(len(own)), followers.T[apart] @ pick])))


def _condensation(body: FEModel, known: Recovery, members: Members, n: int, o: int) -> sp.csr_array:
    """Motion of the condensed dofs (o, n), proven to be what the matrices were condensed by."""
    K = _assembled(body, known, members)
    T = np.zeros((o, n))
    free = n + np.flatnonzero(K.diagonal()[n:] > _NOTHING * K.diagonal().max())
    beside = np.flatnonzero(np.diff(sp.csc_array(K[free][:, :n]).indptr))
    try:
        factor = factorise(sp.csc_array(K[free][:, free]), what=f"the stiffness of condensed dofs of '{body.name}'")
        T[np.ix_(free - n, beside)] = -factor(K[free][:, beside].toarray())
    except NotPositiveDefiniteError as error:
        label = known.dofs.labels[free[error.row]]
        raise DofMapError(
            f"body '{body.name}': dof {label} of its bars has no row in the matrices, and bars, rods and springs of "
            f"the deck leave it free, so its motion is not known; {_REMEDY}"
        ) from None
    follows = sp.csr_array(T)
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
            f"they differ by {abs(missing.data[worst]):.2g} of its diagonal. So the motion of those dofs is not known; "
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
    # A spring stretches by the difference of its two dofs; one that is not there stands still.
    stretch = sp.csr_array((members.spring.size, known.T.shape[1]))
    for end, sign in ((0, 1.0), (1, -1.0)):
        at = known.dofs.rows(members.between[:, end, 0], members.between[:, end, 1])
        there = np.flatnonzero(at >= 0)
        pick = sp.csr_array((np.full(there.size, sign), (there, at[there])), shape=(at.size, len(known.dofs)))
        stretch = stretch + pick @ known.T
    K = motion.T @ (sp.csr_array(blocks) @ motion) + stretch.T @ sp.diags_array(members.spring) @ stretch
    return sp.csr_array((K + K.T) * 0.5)


def _without_rows(body: FEModel, keys: Keys) -> Keys:
    lacking = body.dofs.rows(keys // _STEP, keys % _STEP) < 0
    if body.constrained is not None:
        lacking &= body.constrained.rows(keys // _STEP, keys % _STEP) < 0
    return keys[lacking]


def _keys(dofs: DofTable) -> Keys:
    return dofs.node * _STEP + dofs.component


def _table(keys: Keys) -> DofTable:
    return DofTable(keys // _STEP, (keys % _STEP).astype(np.int8))


def _after(dofs: DofTable, n: int) -> DofTable:
    return DofTable(dofs.node[n:], dofs.component[n:])
