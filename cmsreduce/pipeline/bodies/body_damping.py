"""Proof that the damping of a body takes energy from every motion, and none from a floating body's rigid motions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import CmsReduceError, DampingError, MatrixError
from cmsreduce.linalg.blocks import congruence
from cmsreduce.linalg.eigen import elastic_and_massless
from cmsreduce.mechanics import least_damping, refuse_gain
from cmsreduce.model import SCALAR, FEModel, ModalComponent, Proof, rigid_body_shapes
from cmsreduce.read import damping_order_doubt
from cmsreduce.verify import negative_directions

__all__ = ["DampingHealth", "damping_health", "damping_proof", "damping_remark"]

# A damping matrix with entries on this number of dofs is factorised in a second.
_FACTORISED = 3000
# All modes of a body of this size, which name the one that gains energy, take seconds.
_ALL_MODES = 1500
# Drag on a rigid motion without geometry, relative to its absolute terms: rounding and condensation leave less.
_DRAG = 1e-9
# Drag that differs from alpha M R by less than this share comes from Rayleigh damping.
_RAYLEIGH = 1e-6
# Arithmetic leaves such a share of the terms of a force that should vanish, printed digits so many roundings.
_ARITHMETIC, _DIGITS = 1e-12, 20.0
# Coordinates may be wrong in all directions, at both ends of a damper.
_PLACES = 4.0
# Damping is condensed and located as the stiffness is, but its entries may weigh errors differently.
_LIKE_STIFFNESS = 100.0
# A motion with less than this share of the largest inertia moves no mass, and one that keeps less of it is free.
_NO_INERTIA, _HELD = 1e-12, 1e-6
_NAMED = 5
# A ratio above this is rare in a structure, and usual where per cent are written as fractions.
_REMARKABLE = 0.3


@dataclass(frozen=True)
class DampingHealth:
    """Findings on a damping matrix as it was read.

    Parameters
    ----------
    factorised : bool
        True if a factor shows that it takes energy from every motion of its dofs.
    gaining : str
        Message about a factor that shows otherwise.
    doubt : str
        Reason to doubt the order of its rows; of a body whose rigid motions it may act on.
    drag : float or None
        Largest force on a rigid motion, in the row nearest to its tolerance, relative to the terms that cancel in it;
        None where the ground or the unknown geometry allows the damping to act on it.
    allowed : float
        Force that rounding may leave in that row.
    """

    factorised: bool
    drag: float | None
    allowed: float
    gaining: str = ""
    doubt: str = ""


def damping_health(body: FEModel, rigid: NDArray[np.float64], *, reduced: bool) -> DampingHealth | None:
    """Check the damping matrix of a body.

    Parameters
    ----------
    body : FEModel
        The body.
    rigid : (n, r) float64
        Its rigid-body modes.
    reduced : bool
        True if the body is reduced: a large matrix is then proven on the modes, when they are made.

    Returns
    -------
    DampingHealth or None
        None without a damping matrix.

    Raises
    ------
    DampingError
        If the matrix damps a rigid motion of a body that floats.
    DofMapError
        If the rows of a held body's matrix are in another order.
    MatrixError
        If it gives energy to a motion of its dofs.
    """
    if body.D is None:
        return None
    drag, allowed = _drag(body, rigid)
    doubt = damping_order_doubt(body) if drag is None else ""
    active = np.flatnonzero(np.diff(body.D.indptr))
    if not active.size or (reduced and active.size > _FACTORISED):
        return DampingHealth(not active.size, drag, allowed, doubt=doubt)
    part = sp.csc_array(body.D[active][:, active])
    negative = negative_directions(part, body.rounding)
    if negative:
        if body.n <= _ALL_MODES:
            _name_mode(body, rigid)
        message = _gaining(body, active, part, negative)
        if not reduced or body.n <= _ALL_MODES:
            raise MatrixError(message)
        # The mode that gains energy is named when the modes are made.
        return DampingHealth(False, drag, allowed, message, doubt)
    return DampingHealth(negative == 0, drag, allowed, doubt=doubt)


def damping_proof(body: FEModel, health: DampingHealth | None, modes: ModalComponent) -> Proof:
    """Proof of the damping of a reduced body, or the reason why there is none.

    Parameters
    ----------
    body : FEModel
        The body.
    health : DampingHealth, optional
        Findings on its damping matrix.
    modes : ModalComponent
        Every mode of its mode set.
    """
    if body.D is None or modes.D is None or health is None:
        law = body.damping.law
        text = "none is given" if law == "none" else f"{law.replace('_', ' ')} damping takes energy from every mode"
        stated, zeta = body.damping.per_mode or (), modes.zeta[modes.elastic]
        if any(not math.isclose(*both) for both in zip(stated, zeta, strict=False)):
            text += "; modes of one frequency have the mean of their ratios"
        return Proof("damping", "proven", remark=text, subject=body.name)
    least = least_damping(body.D, modes.Phi, modes.D, body.rounding)
    found = [least.allowed] if health.drag is None else [least.allowed, health.allowed]
    digits = -math.log10(max(*found, body.rounding))
    if health.gaining:
        return Proof("damping", "refuted", digits, health.gaining, body.name)
    if health.doubt:
        return Proof("damping", "unproven", digits, f"order of its rows: {health.doubt}; compare its ratios", body.name)
    where = "its dofs" if health.factorised else f"the {modes.omega.size} shapes of the mode set"
    text = f"D takes energy from every motion of {where}"
    if modes.rigid_count and health.drag is not None:
        text += ", none from rigid ones"
    elif modes.rigid_count:
        text += "; it may act on rigid ones, as the ground or an unknown geometry allows"
    return Proof("damping", "proven", digits, text, body.name)


def damping_remark(modes: ModalComponent, band_hz: float) -> str | None:
    """Remark on a damping ratio that few structures have; None without one.

    Parameters
    ----------
    modes : ModalComponent
        Every mode of the mode set of a body.
    band_hz : float
        Upper end of the band. Beta K damps modes far above it beyond critical, which means nothing.
    """
    zeta, hz = modes.zeta[modes.elastic], modes.frequencies_hz[modes.elastic]
    judged = np.flatnonzero((hz <= band_hz) | (np.arange(hz.size) == 0))
    high = judged[zeta[judged] > _REMARKABLE]
    if not high.size:
        return None
    at = high[int(zeta[high].argmax())]
    text = f"{modes.name}: the mode at {hz[at]:.6g} Hz has {100 * zeta[at]:.3g} % of critical damping"
    if high.size > 1:
        text += f", and {high.size - 1} more in the band have above {100 * _REMARKABLE:g} %"
    if modes.damping.acts_on_modes or modes.damping.structural is not None:
        stated = zeta[at] if modes.damping.structural is None else modes.damping.structural
        text += f"; did you mean {stated / 100:.3g}, which is {stated:.3g} %?"
    return text


def _drag(body: FEModel, rigid: NDArray[np.float64]) -> tuple[float | None, float]:
    """Largest force of the damping on rigid motion and its tolerance; None where the damping may act on it."""
    assert body.D is not None
    if body.nodes is None or (body.dofs.component == SCALAR).all():
        return _scalar_drag(body, rigid)
    xyz = body.nodes.xyz
    centre = xyz.mean(axis=0)
    length = float(np.sqrt(np.mean(np.sum((xyz - centre) ** 2, axis=1)))) or 1.0
    R = rigid_body_shapes(body.dofs, body.nodes, centre) / np.repeat([1.0, length], 3)
    # Supports to the ground, in K or by constraints, may come with dampers to the ground.
    if not _floats(body, rigid, R):
        return None, 0.0
    # The stiffness shows what digits, coordinates and condensation leave of a force that should vanish.
    places = _PLACES * float(np.max(body.nodes.xyz_rounding, initial=0.0)) / length
    rounding = max(_DIGITS * body.stiffness_rounding, places)
    allowed = max(_ARITHMETIC, rounding, _LIKE_STIFFNESS * float(_resisted(body.K, R)[1].max(initial=0.0)))
    force, share = _resisted(body.D, R)
    if (share > allowed).any():
        raise DampingError(_damped_rigid(body, R, force, share > allowed))
    return float(share.max(initial=0.0)), allowed


def _floats(body: FEModel, rigid: NDArray[np.float64], R: NDArray[np.float64]) -> bool:
    """True if every rigid motion of the geometry that moves mass is one that the stiffness leaves free."""
    momentum = body.M @ R
    inertia, free = R.T @ momentum, rigid.T @ momentum
    own = inertia.diagonal()
    moves = own > _NO_INERTIA * own.max(initial=0.0)
    held = own - np.sum(free**2, axis=0)
    return bool(moves.any() and (held[moves] <= _HELD * own[moves]).all())


def _resisted(A: sp.csc_array, R: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Forces A R (n, 6), and the largest in each row relative to the terms that cancel in it (n,)."""
    force, terms = np.asarray(A @ R), np.asarray(abs(A) @ abs(R)).max(axis=1)
    # A row of rounding has no terms that could cancel.
    judged = terms > np.finfo(float).eps * terms.max(initial=0.0)
    largest = abs(force).max(axis=1)
    return force, np.divide(largest, terms, out=np.zeros_like(terms), where=judged)


def _scalar_drag(body: FEModel, rigid: NDArray[np.float64]) -> tuple[float | None, float]:
    """The same for a body without geometry: some free motion of it must be one that the damping does not act on."""
    assert body.D is not None
    if body.grounded or not rigid.shape[1]:
        return None, 0.0
    energies = congruence(body.D, rigid)
    parts = np.asarray(abs(body.D).sum(axis=0)).ravel() @ rigid**2
    scale = 1 / np.sqrt(np.where(parts > 0, parts, 1.0))
    least = float(la.eigvalsh(energies * np.outer(scale, scale))[0])
    if least <= _DRAG:
        return abs(least), _DRAG
    weight = abs(np.asarray(body.D @ rigid)).max(axis=1)
    named = ", ".join(body.dofs.labels[row] for row in np.argsort(-weight)[:_NAMED] if weight[row] > 0)
    raise DampingError(
        f"body '{body.name}': its damping matrix damps every motion that its stiffness leaves free, at {named}: a "
        f"damper to the ground on a body that floats. {_REMEDY}; a body that the ground holds has `grounded: true`"
    )


_REMEDY = (
    "Take dampers to the ground out of the matrix, and join the body to a rigid body on `scene.ground` by a joint with "
    "`damping:` where it needs one"
)


def _damped_rigid(body: FEModel, R: NDArray[np.float64], force: NDArray[np.float64], rows: NDArray[np.bool_]) -> str:
    """Message about a damping matrix that damps rigid motion of a body which floats, above all at some rows."""
    momentum = np.asarray(body.M @ R)
    alpha = float(np.vdot(momentum, force) / max(np.vdot(momentum, momentum), 1e-300))
    where = f"body '{body.name}': its damping matrix damps rigid motion, although its stiffness leaves it free"
    if alpha > 0 and abs(force - alpha * momentum).max() <= _RAYLEIGH * abs(force).max():
        return (
            f"{where}: it holds {alpha:.6g} times the mass matrix (1/s). Give the law instead, `damping: {{rayleigh: "
            "{alpha: ..., beta: ...}}`, which damps no rigid motion, or take that part out of the matrix"
        )
    size = np.where(rows, abs(force).max(axis=1), 0.0)
    named = ", ".join(f"{body.dofs.labels[row]} ({size[row]:.3g})" for row in np.argsort(-size)[:_NAMED] if size[row])
    more = int(np.count_nonzero(rows)) - _NAMED
    # Between two nodes, a damper that is not on their line resists no translation, but rotation.
    turns_only = (abs(force[rows, :3]) <= _DRAG * size[rows, None]).all()
    cause = "a damper between two nodes that is not on their line" if turns_only else "a damper to the ground"
    return (
        f"{where}, by forces at {named}{f' and {more} more' if more > 0 else ''} under unit velocities: {cause}. "
        f"{_REMEDY}"
    )


def _name_mode(body: FEModel, rigid: NDArray[np.float64]) -> None:
    """Refuse the damping matrix of a body of moderate size by the mode that gains energy."""
    assert body.D is not None
    # At most `_ALL_MODES` dofs: two dense matrices of 18 MB.
    try:
        lam, X, N = elastic_and_massless(body.K.toarray(), body.M.toarray(), rigid, body.rounding)
    except CmsReduceError:
        # The reduction names what is wrong with K and M.
        return
    Phi = np.hstack([rigid, X, N])
    omega = np.concatenate([np.zeros(rigid.shape[1]), np.sqrt(lam), np.full(N.shape[1], np.inf)])
    refuse_gain(body, Phi, congruence(body.D, Phi), omega)


def _gaining(body: FEModel, active: NDArray[np.int64], part: sp.csc_array, count: int) -> str:
    """Message about a damping matrix that gives energy to motions which no mode shows."""
    named = ""
    if active.size <= _FACTORISED:
        # Dense, at most 72 MB.
        own = part.diagonal()
        scale = 1 / np.sqrt(np.where(own > 0, own, own.max(initial=0.0) or 1.0))
        _, Y = la.eigh(scale[:, None] * part.toarray() * scale, subset_by_index=[0, 0])
        size = abs(Y[:, 0])
        labels = body.dofs.labels
        named = ", above all of " + ", ".join(
            labels[active[row]] for row in np.argsort(-size)[:_NAMED] if size[row] > 0
        )
    return (
        f"body '{body.name}': damping matrix D is not positive semidefinite: it gives energy to {count} motions"
        f"{named}. Check its sign and its source: a passive structure takes energy from every motion"
    )
