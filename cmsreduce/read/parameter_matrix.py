"""Matrix that a parameter adds to one of a body, in the rows of the body, checked with its stiffness."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.model import SCALAR, FEModel, Letter, rigid_body_shapes
from cmsreduce.read.differential_stiffness import (
    BALANCED,
    force_of_translation,
    is_held,
    matrix_on_rows,
    refuse_other_couplings,
)
from cmsreduce.read.interfaces import MatrixSource

__all__ = ["read_parameter_matrix"]

# Roundings of the file that a sum over many entries may have.
_ROUNDINGS = 1e4
# Matrices that are one to nine digits; forces of loads that printed coordinates and elements give to three digits.
_SAME, _LOADS = 1e-9, 1e-3
# A change of this share of the body's matrix, and this much like it, may be the matrix itself.
_HALF, _ALIKE = 0.5, 0.5
_TRANSLATIONS = 3
_WORDS: dict[Letter, str] = {"K": "stiffness", "M": "mass", "D": "damping", "G": "gyroscopic matrix"}


def read_parameter_matrix(
    source: MatrixSource,
    body: FEModel,
    letter: Letter,
    label: str,
    *,
    grounded: bool = False,
    factors: Sequence[float] = (),
    whole: bool = False,
) -> tuple[sp.csc_array, str]:
    """Read a matrix that is added to the stiffness, mass or damping of a body, by a parameter or as gyroscopic matrix.

    Parameters
    ----------
    source : MatrixSource
        File of the matrix.
    body : FEModel
        n dofs, as read, before dofs are tied or held.
    letter : {"K", "M", "D", "G"}
        Matrix to which it is added; G is skew.
    label : str
        Name of the parameter or of the matrix, for messages.
    grounded : bool
        True if it may act against the ground: springs, dampers, forces of a rotating frame.
    factors : sequence of float
        Factors by which it is added in the configurations.
    whole : bool
        The file holds the matrix of the body with the addition, from which that of the body is taken off.

    Returns
    -------
    matrix : (n, n) sparse array
        Symmetric, or skew if gyroscopic, in the rows of the body.
    remark : str
        Reason why the order of its rows is not proven, or to doubt what it holds; empty if there is none.

    Raises
    ------
    MatrixError
        If its size is not that of the body, or it is not finite, or not symmetric or skew; if it is another matrix of
        the body, or a mass that no motion moves or that leaves the body less than none.
    DofMapError
        If a translation of the whole body costs force; if a rotation does, or it is a mass, and it couples nodes that
        the stiffness does not couple; or if a mass is not the same in all directions: its rows are in another order.
    """
    what = f"body '{body.name}': {_WORDS[letter]} of {label}"
    A, rounding, named = matrix_on_rows(source, body, what, skew=letter == "G")
    own = {"K": body.K, "M": body.M, "D": body.D}.get(letter) if whole else None
    if own is not None:
        largest, A = abs(A).max(), sp.csc_array(A - own)
        A.eliminate_zeros()
        rounding *= float(largest / max(abs(A).max(), np.finfo(float).tiny))
    if not A.nnz:
        raise MatrixError(f"{named} is zero: {'it' if letter == 'G' else 'the parameter'} would change nothing")
    _refuse_another(A, body, letter, named)
    if letter == "M":
        refuse_other_couplings(A, body, named)
        _refuse_negative_mass(A, body, factors, named)
    doubt = _whole_matrix(A, body, letter, factors, named)
    if body.nodes is None or (body.dofs.component == SCALAR).all():
        return A, doubt or f"{named}: without coordinates the order of its rows is not proven"
    limit = max(BALANCED, _ROUNDINGS * rounding)
    if letter == "M":
        remark = _remark_on_mass(A, rigid_body_shapes(body.dofs, body.nodes)[:, :3], named, limit)
        return A, doubt or remark
    if grounded or is_held(body):
        return A, doubt or f"{named}: it may act against the ground, so that the order of its rows is not proven"
    force, where = force_of_translation(A, body)
    if force > limit:
        raise DofMapError(
            f"{named}: a translation of the whole body costs {force:.1e} of its largest row at "
            f"{where}, but what is inside a body resists no translation. Likely cause: its rows are in "
            f"another order than those of the stiffness, or in other units; {_exception(letter)}"
        )
    scale = float(np.asarray(abs(A).sum(axis=1)).max(initial=0.0))
    rigid = body.rigid_shapes
    turned = abs(A @ rigid[:, 3:]).max(initial=0.0) / (scale * max(float(abs(rigid[:, 3:]).max(initial=0.0)), 1e-300))
    if turned > limit:
        # A stress may resist rotation, and acts between nodes that the stiffness couples; a spring or damper between
        # other nodes resists none.
        refuse_other_couplings(A, body, named)
        if letter == "K" and not doubt and not _turns_as_loads_do(A, body, limit):
            doubt = (
                f"{named}: a rotation of the body costs other forces than loads that keep their direction give under "
                "stress, so that the order of its axes is not proven: compare the frequencies with the parameter"
            )
    if not doubt and not (body.dofs.component[np.diff(A.indptr) > 0] <= _TRANSLATIONS).any():
        doubt = f"{named}: it acts on rotations alone, so that the order of its rows is not proven"
    return A, doubt


def _turns_as_loads_do(A: sp.csc_array, body: FEModel, limit: float) -> bool:
    """True if rotation of the body costs a force F x rotation at each node and no moment, as dead loads F give.

    The stress is in balance with the loads at the nodes; a turned body meets it with loads that do not turn. Rows or
    axes in another order give other forces.
    """
    assert body.nodes is not None
    rigid = body.rigid_shapes
    force = np.asarray(A @ rigid[:, 3:])
    moving = np.flatnonzero((body.dofs.component > 0) & (body.dofs.component <= _TRANSLATIONS))
    ids, of = np.unique(body.dofs.node[moving], return_inverse=True)
    at_nodes = np.zeros((ids.size, 3, 3))
    np.add.at(at_nodes, of, rigid[moving, :3, None] * force[moving, None, :])
    even = abs(at_nodes + at_nodes.transpose(0, 2, 1)).max(initial=0.0)
    turning = np.flatnonzero(body.dofs.component > _TRANSLATIONS)
    # Moments are judged by their own parts: in another unit of length they are small beside the forces.
    parts = (abs(A[turning]) @ abs(rigid[:, 3:])).max(initial=0.0)
    small, moment = max(_LOADS, limit), abs(force[turning]).max(initial=0.0)
    return bool(even <= small * abs(at_nodes).max(initial=0.0) and moment <= small * parts)


def _refuse_another(A: sp.csc_array, body: FEModel, letter: Letter, named: str) -> None:
    """Refuse a matrix of the body itself under the name of another one."""
    own: dict[Letter, sp.csc_array] = {"K": body.K, "M": body.M}
    for other, B in own.items():
        if letter not in ("G", other) and abs(A - B).max() <= _SAME * abs(B.data).max(initial=0.0):
            raise MatrixError(f"{named} is the {_WORDS[other]} of the body; name the file that holds its own")


def _refuse_negative_mass(A: sp.csc_array, body: FEModel, factors: Sequence[float], named: str) -> None:
    """Refuse what no motion moves, and what takes more mass than there is."""
    R = rigid_body_shapes(body.dofs, body.nodes) if body.nodes is not None else np.zeros((body.n, 0))
    momentum, parts = abs(A @ R[:, :3]).max(initial=0.0), (abs(A) @ abs(R[:, :3])).max(initial=0.0)
    if parts > 0 and momentum <= _SAME * parts:
        raise MatrixError(
            f"{named}: translations of the body give it no momentum, as they cost no force in a stiffness; name a mass "
            "here, or the matrix under `stiffness:`"
        )
    for factor in factors:
        M = sp.csc_array(body.M + factor * A)
        least, most = float(M.diagonal().min(initial=0.0)), abs(body.M.diagonal()).max(initial=0.0)
        rigid = np.linalg.eigvalsh(R[:, :3].T @ (M @ R[:, :3])) if R.shape[1] else np.zeros(1)
        if least < -_SAME * most or rigid[0] < -_SAME * abs(rigid).max():
            raise MatrixError(
                f"{named}: {factor:.6g} times it leaves the body a negative mass (the least entry of the diagonal is "
                f"{least:.4g}); check its sign, the values of the parameter and their `unit:`"
            )


def _whole_matrix(A: sp.csc_array, body: FEModel, letter: Letter, factors: Sequence[float], named: str) -> str:
    """Remark on a matrix that holds that of the body, where the difference is due."""
    own = {"K": body.K, "M": body.M}.get(letter)
    if own is None or not own.nnz:
        return ""
    share = float(A.multiply(own).sum()) / float(own.multiply(own).sum())
    rest = sp.csc_array(A - share * own)
    alike = float(rest.multiply(rest).sum()) <= _ALIKE**2 * float(A.multiply(A).sum())
    if not alike or share * max([abs(factor) for factor in factors], default=1.0) < _HALF:
        return ""
    return (
        f"{named}: it is the {_WORDS[letter]} of the body times {share:.4g}, or holds it: {letter} = {letter}0 + p "
        f"{letter}_p takes the difference of the {_WORDS[letter]} with the parameter and without: "
        "`whole: true` takes it"
    )


def _exception(letter: Letter) -> str:
    """Matrices that do act in a translation, and what to do with them."""
    if letter == "G":
        return (
            "the Coriolis matrix of a rotating frame does so, but bodies here move in a fixed one: give the matrix of "
            "that frame"
        )
    return "if it holds the body to the ground, say `grounded: true` under the parameter"


def _remark_on_mass(A: sp.csc_array, translation: np.ndarray, named: str, limit: float) -> str:
    """Refuse a mass that differs by direction; a remark on rows that are alike."""
    mass = np.asarray(translation.T @ (A @ translation))
    there = np.flatnonzero(abs(translation).any(axis=0))
    own = mass[np.ix_(there, there)]
    size = float(abs(own).max(initial=0.0))
    if size and abs(own - np.eye(there.size) * own.trace() / there.size).max() > limit * size:
        raise DofMapError(
            f"{named}: its total mass is {', '.join(f'{m:.6g}' for m in own.diagonal())} along the axes, and a mass is "
            "the same in every direction. Likely cause: its rows are in another order than those of the stiffness, or "
            "a part of them is missing"
        )
    off = A - sp.diags_array(A.diagonal())
    return "" if abs(off).sum() else f"{named}: the mass is lumped: no pair of nodes shows the order of its rows"
