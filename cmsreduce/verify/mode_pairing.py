"""Modes of two models of one body, paired by shape and frequency, and turned into each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

__all__ = ["ModePairing", "pair_modes", "scaled_rows"]

Array = NDArray[np.float64]

# Modes whose frequencies are this close, relative, may be any rotation of each other: a symmetric body's mesh parts a
# pair by less. They are compared as a space.
_ALIKE = 1e-3
# Two modes differ by 1 - MAC and by the logarithm of their frequency ratio. At a sum of 1 they have nothing in common:
# no likeness at one frequency, or one shape at frequencies 2.7 apart.
_DIFFERENT = 1.0
# A mode that moves the rows compared by less than this share of the one that moves them most is rounding there.
_UNSEEN = 1e-7
# Directions of a group of shapes below this share of the largest are rounding.
_DEPENDENT = 1e-8


@dataclass(frozen=True, eq=False)
class ModePairing:
    """Which mode became which.

    Parameters
    ----------
    old, new : (k,) int64
        Columns of the pairs.
    shift : (k,) float64
        w_new / w_old - 1.
    mac : (k,) float64
        Modal assurance criterion of the new shape with the old one, or with the space of the old ones where several
        share a frequency; 1 where neither moves any row.
    lost, gained : (l,), (g,) int64
        Old and new columns without a partner.
    turn : (k, k) float64
        Orthogonal: ``new_shapes[:, new] @ turn`` is as close to ``old_shapes[:, old]`` as signs, and rotations among
        modes of one frequency, can bring it.
    """

    old: NDArray[np.int64]
    new: NDArray[np.int64]
    shift: Array
    mac: Array
    lost: NDArray[np.int64]
    gained: NDArray[np.int64]
    turn: Array


def scaled_rows(old: Array, new: Array, kind: NDArray[np.int64]) -> tuple[Array, Array]:
    """Shapes with rows of different kinds made comparable, so that units do not weigh.

    Parameters
    ----------
    old, new : (p, m), (p, q) float64
        Shapes at the same rows.
    kind : (p,) int64
        Kind of each row, such as translation and rotation: each is scaled by its root mean square in the old shapes.
    """
    scale = np.ones(old.shape[0])
    for each in np.unique(kind):
        rms = float(np.sqrt(np.mean(old[kind == each] ** 2))) if old.size else 0.0
        scale[kind == each] = rms or 1.0
    return old / scale[:, None], new / scale[:, None]


def pair_modes(old_omega: Array, new_omega: Array, old: Array, new: Array) -> ModePairing:
    """Pair modes one to one, as alike as can be in shape and frequency together.

    Parameters
    ----------
    old_omega, new_omega : (m,), (q,) float64
        Positive frequencies in ascending order.
    old, new : (p, m), (p, q) float64
        Shapes at the same rows, in comparable units; without rows frequencies alone decide.

    Returns
    -------
    ModePairing

    Notes
    -----
    Sources: Allemang (MAC); D'Ambrogio, Fregolent (MAC of a space, for repeated frequencies).
    """
    # Only here: loading it takes as long as a small body's whole reduction.
    from scipy.optimize import linear_sum_assignment

    group = _groups(old_omega)
    mac = _likeness(old, new, group)
    distance = abs(np.log(new_omega)[None, :] - np.log(old_omega)[:, None])
    # Capped: a mode without a partner must not push others apart to come by one.
    cost = np.minimum(1 - mac + distance, _DIFFERENT)
    i, j = linear_sum_assignment(cost)
    same = cost[i, j] < _DIFFERENT
    i, j = i[same], j[same]
    for each in np.unique(group[i]):
        # A group is as like to one new mode as to another: of equal sums rounding would choose.
        j[group[i] == each] = np.sort(j[group[i] == each])
    return ModePairing(
        old=i,
        new=j,
        shift=new_omega[j] / old_omega[i] - 1,
        mac=mac[i, j],
        lost=np.setdiff1d(np.arange(old_omega.size), i),
        gained=np.setdiff1d(np.arange(new_omega.size), j),
        turn=_turn(old[:, i], new[:, j], group[i]),
    )


def _groups(omega: Array) -> NDArray[np.int64]:
    """Number of the group of alike frequencies that each mode is in."""
    return np.concatenate([[0], np.cumsum(np.diff(omega) > _ALIKE * omega[1:])])[: omega.size].astype(np.int64)


def _likeness(old: Array, new: Array, group: NDArray[np.int64]) -> Array:
    """MAC of every new mode (columns) with the group of every old one (rows)."""
    if not old.shape[0]:
        return np.ones((old.shape[1], new.shape[1]))
    sizes = np.linalg.norm(old, axis=0), np.linalg.norm(new, axis=0)
    floor = _UNSEEN * max(sizes[0].max(initial=0.0), sizes[1].max(initial=0.0))
    seen_old, seen_new = sizes[0] > floor, sizes[1] > floor
    unit = new / np.where(seen_new, sizes[1], 1.0)
    mac = np.zeros((old.shape[1], new.shape[1]))
    for each in np.unique(group):
        members = group == each
        u, s, _ = la.svd(old[:, members], full_matrices=False)
        u = u[:, s > _DEPENDENT * s.max(initial=0.0)]
        mac[members] = np.sum((u.T @ unit) ** 2, axis=0)
    mac[np.ix_(~seen_old, seen_new)] = mac[np.ix_(seen_old, ~seen_new)] = 0.0
    mac[np.ix_(~seen_old, ~seen_new)] = 1.0
    return np.clip(mac, 0.0, 1.0)


def _turn(old: Array, new: Array, group: NDArray[np.int64]) -> Array:
    """Signs of single modes, and the rotation of those that share a frequency."""
    turn = np.eye(old.shape[1])
    for each in np.unique(group):
        at = np.flatnonzero(group == each)
        u, _, vt = la.svd(new[:, at].T @ old[:, at])
        turn[np.ix_(at, at)] = u @ vt
    return turn
