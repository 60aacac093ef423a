"""Directions of one cluster in an order in which the first few lose as little of it as can be found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.balance.cluster_error import ClusterError

__all__ = ["LARGEST", "NOTHING", "interchangeable", "nested_directions", "nested_errors"]

Array = NDArray[np.float64]

LARGEST = 30
"""Modes of the largest cluster whose directions are searched; those of a larger one are the best order at hand."""
NOTHING = 1e-5
"""Relative error of a cluster below which directions are not told apart: less than any model is asked for."""

# Of a span so many directions are searched; those after are the best of the starts, which costs little.
_SOUGHT = 10
# The search for the direction of least error starts at the best of those given and of others between every two of so
# many, 22.5 degrees apart.
_BETWEEN = 3
_SLOPES = np.tan(np.radians([-67.5, -45.0, -22.5, 22.5, 45.0, 67.5]))
# Of so few directions two starts so far apart are searched from, for there may be two valleys.
_FEW = 8
_APART = np.cos(np.radians(40.0))
# It turns towards so many others at most, those of the largest rows: what its steps cost grows with their number.
_AMONG = 10
# It ends where the square of the error falls by less than this share of itself a radian, or after so many steps.
_LEVEL, _STEPS = 1e-2, 40
# Turns for central differences, in radians: truncation 1e-8, rounding 1e-12 of the square of the cluster's norm.
_TURN = 1e-4
# What is left of a unit vector without those found before, if it is a direction of its own.
_INDEPENDENT = 1e-3
# Angles that show whether two directions may be turned in their plane, and the change of the error that shows it.
_ANY = np.radians(np.arange(0.0, 180.0, 22.5))
_FLAT = 1e-6
# An error above the one it may not exceed by this share is rounding.
_ROUNDING = 1e-9


def nested_errors(error: ClusterError, Q: Array) -> Array:
    """Errors of a cluster cut down to the first 0, 1, ... m of its directions (m, m): (m + 1,)."""
    return np.array([error.relative(Q[None, :, :k])[0] for k in range(Q.shape[1] + 1)])


def nested_directions(error: ClusterError, plain: NDArray[np.int64], orders: Sequence[Array]) -> tuple[Array, Array]:
    """Order a cluster into directions, the first k of which lose little of it for every k.

    Parameters
    ----------
    error : ClusterError
        Of m modes.
    plain : (m,) int64
        The modes by importance. However many directions are kept, they lose no more than as many modes of this list.
    orders : sequence of (m, m) float64
        Orthogonal matrices to start from, most important columns first.

    Returns
    -------
    Q : (m, m) float64
        Orthogonal.
    errors : (m + 1,) float64
        From `nested_errors`.

    Notes
    -----
    The modes are refined, and the best of the starts and of the modes in the order in which one after the other loses
    least: direction by direction, each is turned by a quasi-Newton search (BFGS) among those that are left to where
    least is lost with it. What is best for one direction may be bad for two; where k directions end above the
    start, the first k span what they spanned there, and what is before and after is sought anew. Of all that lose no
    more than the modes, the one of the least geometric mean error is taken.
    """
    m = plain.size
    eye = np.eye(m)
    modes = eye[:, plain]
    limit = nested_errors(error, modes)
    others = [(order, nested_errors(error, order)) for order in (eye[:, _one_by_one(error)], *orders)]
    found = [(modes, limit), *others]
    if m <= LARGEST:
        refined = (_refined(error, start, orders) for start in (modes, min(others, key=_mean)[0]))
        found += [(Q, nested_errors(error, Q)) for Q in refined]
    return min((each for each in found if (each[1] <= _no_more_than(limit)).all()), key=_mean)


def _mean(found: tuple[Array, Array]) -> float:
    """Logarithm of the geometric mean error, but for a constant."""
    return float(np.log(np.maximum(found[1], NOTHING)).sum())


def _no_more_than(errors: Array) -> Array:
    return np.maximum(errors * (1 + _ROUNDING), NOTHING)


def interchangeable(error: ClusterError, Q: Array) -> NDArray[np.bool_]:
    """Whether each direction of (m, m) but the first can be turned in its plane with the one before it (m - 1,)."""
    found = []
    for k in range(Q.shape[1] - 1):
        plane = np.outer(Q[:, k], np.cos(_ANY)) + np.outer(Q[:, k + 1], np.sin(_ANY))
        found.append(bool(np.ptp(_beside(error, Q[:, :k], plane)) <= _FLAT))
    return np.array(found, dtype=np.bool_)


def _one_by_one(error: ClusterError) -> list[int]:
    """The modes in an order in which each, beside those before it, loses least."""
    m = error.channels.count
    eye, taken = np.eye(m), list[int]()
    while len(taken) < m:
        left = [k for k in range(m) if k not in taken]
        taken.append(left[int(error.relative(np.array([eye[:, [*taken, k]] for k in left])).argmin())])
    return taken


def _refined(error: ClusterError, start: Array, orders: Sequence[Array]) -> Array:
    """Directions that lose no more than those of the start, however many are kept."""
    limit = _no_more_than(nested_errors(error, start))
    Q, spans = start.copy(), [(0, start.shape[1])]
    while spans:
        first, last = spans.pop()
        Q[:, first:last], errors = _one_after_another(error, Q[:, :first], start[:, first:last], orders)
        excess = errors / limit[first + 1 : last]
        if (excess > 1).any():
            worst = first + 1 + int(excess.argmax())
            spans += [(worst, last), (first, worst)]
            Q[:, first:last] = start[:, first:last]
    return Q


def _one_after_another(error: ClusterError, before: Array, span: Array, orders: Sequence[Array]) -> tuple[Array, Array]:
    """Directions of a span, each chosen to lose least beside those before it, and the errors of all but the last."""
    taken, left, errors = before, span, list[float]()
    while left.shape[1] > 1:
        one, least = _best(error, taken, left, orders, search=len(errors) < _SOUGHT)
        taken, errors = np.column_stack([taken, one]), [*errors, least]
        left = left @ la.qr((left.T @ one)[:, None])[0][:, 1:]
    return np.column_stack([taken[:, before.shape[1] :], left]), np.array(errors)


def _best(
    error: ClusterError, taken: Array, left: Array, orders: Sequence[Array], *, search: bool
) -> tuple[Array, float]:
    """The direction of a span that loses least beside those that are taken, and what is lost."""
    few = left.T @ np.hstack([left[:, :0], *orders])[:, :_BETWEEN]
    pairs = [few[:, i] + slope * few[:, j] for i in range(few.shape[1]) for j in range(i) for slope in _SLOPES]
    vectors = np.column_stack([np.eye(left.shape[1]), left.T, *(left.T @ order for order in orders), *pairs])
    size = np.linalg.norm(vectors, axis=0)
    vectors = left @ (vectors[:, size > _INDEPENDENT] / size[size > _INDEPENDENT])
    lost = _beside(error, taken, vectors)
    first = int(lost.argmin())
    if not search:
        return vectors[:, first], float(lost[first])
    apart = np.where(abs(vectors[:, first] @ vectors) < _APART, lost, np.inf)
    starts = {first, int(apart.argmin())} if left.shape[1] <= _FEW else {first}
    valleys = [_valley(error, taken, left, vectors[:, k], float(lost[k])) for k in sorted(starts)]
    return min(valleys, key=lambda each: each[1])


def _valley(error: ClusterError, taken: Array, left: Array, one: Array, least: float) -> tuple[Array, float]:
    """The direction of least error near one of a span, and its error."""
    if least < NOTHING:
        return one, least
    # Only here: few runs search directions, and loading it takes as long as a small body's whole reduction.
    from scipy.optimize import minimize

    # All directions less than a right angle away.
    others = left @ la.qr((left.T @ one)[:, None])[0][:, 1:]
    if others.shape[1] > _AMONG:
        others = others @ la.eigh(others.T @ error.rows @ others)[1][:, : -_AMONG - 1 : -1]
    turns = _TURN * np.hstack([np.zeros((others.shape[1], 1)), np.eye(others.shape[1]), -np.eye(others.shape[1])])

    def turned(x: Array) -> Array:
        there = one[:, None] + others @ x
        return np.asarray(there / np.linalg.norm(there, axis=0))

    def square(x: Array) -> tuple[float, Array]:
        squares = (_beside(error, taken, turned(x[:, None] + turns)) / least) ** 2
        up, down = np.split(squares[1:], 2)
        return float(squares[0]), (up - down) / (2 * _TURN)

    found = minimize(
        square, np.zeros(others.shape[1]), jac=True, method="BFGS", options={"gtol": _LEVEL, "maxiter": _STEPS}
    )
    if not found.fun < 1:
        return one, least
    return turned(found.x[:, None])[:, 0], least * float(np.sqrt(found.fun))


def _beside(error: ClusterError, taken: Array, vectors: Array) -> Array:
    """Errors of each of some unit vectors (m, a) beside the directions taken."""
    each = vectors.T[:, :, None]
    return error.relative(np.concatenate([np.broadcast_to(taken, (len(each), *taken.shape)), each], axis=2))
