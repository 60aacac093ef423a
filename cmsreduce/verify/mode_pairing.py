"""Pairs of modes of two models: one to one by shape and frequency, or each with the mode of the largest MAC."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import svd
from cmsreduce.model import DampedPairs

__all__ = [
    "FrequencyPairs",
    "ModePairing",
    "closest_pairs",
    "complex_mac",
    "lost_complex_modes",
    "pair_complex_modes",
    "pair_frequencies",
    "pair_modes",
    "scaled_rows",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Pairings whose sums differ by less than about this share of the largest distance are equal but for rounding.
_TIE = 1e-13
# Modes whose frequencies are this close, relative, may be any rotation of each other: the mesh of a symmetric body
# separates a pair by less. They are compared as a space.
_ALIKE = 1e-3
# Two modes differ by 1 - MAC and by the logarithm of their frequency ratio. At a sum of 1 they have nothing in common:
# a MAC of zero at one frequency, or one shape at frequencies 2.7 apart.
_DIFFERENT = 1.0
# A mode that moves the compared rows by less than this share of the largest motion is rounding there.
_UNSEEN = 1e-7
# Directions of a group of shapes below this share of the largest are rounding.
_DEPENDENT = 1e-8
# A mode whose damping ratio is below this is damped by round-off or hardly at all: its ratio has no error, unless the
# reduced mode has the second ratio, which the model invents.
_UNDAMPED, _INVENTED = 1e-9, 1e-4
# A mode with more than this ratio of critical damping stops oscillating by a small error, and is no mode to be lost.
_CRITICAL = 0.99
# Shapes with this share of the largest MAC look as much alike: where modes are repeated or damping mixes close ones, a
# shape may be any mixture, and the partner is the nearest root among them.
_AS_ALIKE = 0.5
# Damping ratios of modes that are one space agree to this share, so that it is all that a ratio may gain by it.
_ONE_RATIO = 1e-2
# A reduced mode outside of the band is the partner of one inside if its MAC is above this.
_ALIKE_OUTSIDE = 0.9


@dataclass(frozen=True, eq=False)
class ModePairing:
    """Pairs of an old and a new mode of one body.

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

    old: Indices
    new: Indices
    shift: Array
    mac: Array
    lost: Indices
    gained: Indices
    turn: Array


@dataclass(frozen=True, eq=False)
class FrequencyPairs:
    """Modes of the reduced system and of the reference model, one to one, of which at least one is in the band.

    Parameters
    ----------
    reduced_hz, full_hz : (k,) float64
        Natural frequencies of the pairs.
    mac : (k,) float64
        Modal assurance criterion in the mass norm, 1 for the same shape, or for a shape in the space of reference modes
        that share a frequency.
    error : (k,) float64
        |reduced - full| / full.
    lost, extra : (l,), (e,) int64
        Positions of the reference modes, and of the reduced modes, that are in the band and have no partner.
    at : (k,) int64
        Positions of the reference modes of the pairs.
    """

    reduced_hz: Array
    full_hz: Array
    mac: Array
    error: Array
    lost: Indices
    extra: Indices
    at: Indices

    @property
    def worst(self) -> float:
        """Largest error; 0 if neither model has a mode in the band, NaN if the band holds modes and no pair."""
        if not self.error.size and (self.lost.size or self.extra.size):
            return float("nan")
        return float(self.error.max(initial=0.0))


def closest_pairs(distance: Array) -> tuple[Indices, Indices]:
    """Pair two lists one to one, with the least sum of distances.

    Parameters
    ----------
    distance : (a, b) float64
        Finite, not negative.

    Returns
    -------
    i, j : (min(a, b),) int64
        Members of the first list, ascending, and their partners in the second. Of pairings with equal sums, the one
        that follows the order of both lists is chosen: ascending with ascending.
    """
    apart = np.subtract.outer(np.arange(distance.shape[0]), np.arange(distance.shape[1])) ** 2
    cost = distance + _TIE * (distance.max(initial=0.0) or 1.0) * apart
    shorter = cost if cost.shape[0] <= cost.shape[1] else cost.T
    nearest = shorter.argmin(axis=1) if shorter.size else np.empty(0, dtype=np.int64)
    if np.unique(nearest).size == nearest.size:
        # No sum is less than that of the least distances; most models pair so.
        i, j = (np.arange(nearest.size), nearest) if shorter is cost else (np.sort(nearest), np.argsort(nearest))
    else:
        # Imported here because it takes 0.2 s, and few runs need it.
        from scipy.optimize import linear_sum_assignment

        i, j = linear_sum_assignment(cost)
    return np.asarray(i, dtype=np.int64), np.asarray(j, dtype=np.int64)


def scaled_rows(old: Array, new: Array, kind: Indices) -> tuple[Array, Array]:
    """Make rows of different kinds comparable, so that units do not matter.

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
    """Pair modes one to one by shape and frequency together.

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
    group = _groups(old_omega)
    mac = _mac(old, new, group)
    i, j = _partners(mac, old_omega, new_omega)
    # Signs of single modes, and the rotation of those that share a frequency.
    turn = np.eye(i.size)
    for each in np.unique(group[i]):
        at = np.flatnonzero(group[i] == each)
        u, _, vt = svd(new[:, j[at]].T @ old[:, i[at]])
        turn[np.ix_(at, at)] = u @ vt
    return ModePairing(
        old=i,
        new=j,
        shift=new_omega[j] / old_omega[i] - 1,
        mac=mac[i, j],
        lost=np.setdiff1d(np.arange(old_omega.size), i),
        gained=np.setdiff1d(np.arange(new_omega.size), j),
        turn=turn,
    )


def _groups(omega: Array) -> Indices:
    """Number of the group of each mode; modes of nearly one frequency (ascending) share a group."""
    return np.concatenate([[0], np.cumsum(np.diff(omega) > _ALIKE * omega[1:])])[: omega.size].astype(np.int64)


def _partners(mac: Array, old_omega: Array, new_omega: Array) -> tuple[Indices, Indices]:
    """Partners one to one, by MAC and distance of the frequencies; modes that have nothing in common stay alone."""
    distance = abs(np.log(new_omega)[None, :] - np.log(old_omega)[:, None])
    # Capped: a mode without a partner must not separate others to get one.
    cost = np.minimum(1 - mac + distance, _DIFFERENT)
    i, j = closest_pairs(cost)
    same = cost[i, j] < _DIFFERENT
    return i[same], j[same]


def _mac(old: Array, new: Array, group: Indices) -> Array:
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
        u, s, _ = svd(old[:, members], full_matrices=False)
        u = u[:, s > _DEPENDENT * s.max(initial=0.0)]
        mac[members] = np.sum((u.T @ unit) ** 2, axis=0)
    mac[np.ix_(~seen_old, seen_new)] = mac[np.ix_(seen_old, ~seen_new)] = 0.0
    mac[np.ix_(~seen_old, ~seen_new)] = 1.0
    return np.clip(mac, 0.0, 1.0)


def pair_frequencies(full: Array, reduced: Array, cross: Array, band_hz: float, low_hz: float = 0.0) -> FrequencyPairs:
    """Pair natural frequencies one to one by cross-orthogonality and distance; see `pair_modes`.

    Parameters
    ----------
    full, reduced : (f,), (k,) float64
        Natural frequencies in rad/s, up to some way above the band: the partner of a mode in the band may lie there.
    cross : (f, k) float64
        phi_full^T M phi_reduced, both orthonormal in M.
    band_hz : float
        Upper end of the band.
    low_hz : float
        Its lower end. Pairs of which neither mode is in the band are left out, and its modes alone are lost or extra.

    Returns
    -------
    FrequencyPairs
        In the order of the reduced frequencies given.
    """
    low, top = 2 * np.pi * low_hz, 2 * np.pi * band_hz
    order, order_r = np.argsort(full, kind="stable"), np.argsort(reduced, kind="stable")
    w, w_r, part = full[order], reduced[order_r], cross[np.ix_(order, order_r)] ** 2
    group, mac = _groups(w), np.zeros(part.shape)
    for each in np.unique(group):
        mac[group == each] = part[group == each].sum(axis=0)
    i, j = _partners(np.clip(mac, 0.0, 1.0), w, w_r)
    here, here_r = ((each >= low) & (each <= top) for each in (w, w_r))
    lost, extra = np.setdiff1d(np.flatnonzero(here), i), np.setdiff1d(np.flatnonzero(here_r), j)
    inside = np.flatnonzero(here[i] | here_r[j])
    as_given = inside[np.argsort(order_r[j[inside]])]
    i, j = i[as_given], j[as_given]
    hz, error = w[i] / (2 * np.pi), abs(w_r[j] - w[i]) / w[i]
    return FrequencyPairs(w_r[j] / (2 * np.pi), hz, mac[i, j], error, order[lost], order_r[extra], order[i])


def complex_mac(roots: NDArray[np.complex128], cross: NDArray[np.complex128], own: NDArray[np.complex128]) -> Array:
    """MAC (f, k) of reduced modes with reference modes, or with the space of those that share a root.

    Parameters
    ----------
    roots : (f,) complex128
        Of the reference modes in rad/s, Im s > 0. Modes share one whose frequencies and damping ratios are alike: their
        shapes may be any combinations of each other, and need not be orthogonal.
    cross : (f, k) complex128
        x_full^H M x_reduced, both of unit length in M.
    own : (f, f) complex128
        x_full^H M x_full.
    """
    mac = np.asarray(abs(cross) ** 2, dtype=np.float64)
    size = np.asarray(abs(roots), dtype=np.float64)
    zeta, order = -roots.real / size, np.argsort(size, kind="stable")
    group = _groups(size[order])
    # By damping ratio among those of one frequency.
    order = order[np.lexsort((zeta[order], group))]
    new = (np.diff(group) > 0) | (np.diff(zeta[order]) > _ONE_RATIO * abs(zeta[order][1:]) + _UNDAMPED)
    for members in np.split(order, np.flatnonzero(new) + 1):
        if members.size > 1:
            part, V = la.eigh(own[np.ix_(members, members)])
            apart = part > _DEPENDENT * part[-1]
            mac[members] = np.sum(abs((V[:, apart] / np.sqrt(part[apart])).conj().T @ cross[members]) ** 2, axis=0)
    return mac


def pair_complex_modes(
    full: NDArray[np.complex128], reduced: NDArray[np.complex128], mac: Array, band_hz: float, low_hz: float = 0.0
) -> DampedPairs:
    """Pair each oscillating mode of the reduced system in the band with a reference mode of like shape.

    Parameters
    ----------
    full, reduced : (f,), (k,) complex128
        Roots s in rad/s, Im s > 0.
    mac : (f, k) float64
        Of `complex_mac`.
    band_hz, low_hz : float
        Ends of the band. Reduced modes with |s| outside of it are left out, unless a reference mode inside is alike.
    """
    inside, here = (_in_band(s, band_hz, low_hz) for s in (reduced, full))
    if full.size:
        most = mac * here[:, None]
        inside = inside | (most.max(axis=0, initial=0.0) >= _ALIKE_OUTSIDE)
    if not full.size or not inside.any():
        none = np.empty(0)
        alone = int(inside.sum() + here.sum())
        return DampedPairs(none.astype(np.complex128), none.astype(np.complex128), none, none, alone)
    there, mac = reduced[inside], mac[:, inside]
    alike = mac >= _AS_ALIKE * mac.max(axis=0)
    best = np.where(alike, abs(full[:, None] - there), np.inf).argmin(axis=0)
    partner = full[best]
    zeta, zeta_r = -partner.real / abs(partner), -there.real / abs(there)
    damped = abs(zeta) > _UNDAMPED
    none = np.where(abs(zeta_r) > _INVENTED, np.inf, np.nan)
    error = np.where(damped, abs(zeta_r - zeta) / np.where(damped, abs(zeta), 1.0), none)
    return DampedPairs(partner, there, mac[best, np.arange(best.size)], error)


def lost_complex_modes(
    full: NDArray[np.complex128], reduced: NDArray[np.complex128], mac: Array, band_hz: float, low_hz: float = 0.0
) -> Indices:
    """Positions of the reference modes in the band without a partner; arguments as for `pair_complex_modes`.

    Modes are paired one to one here, by MAC and the distance of the roots.
    """
    apart = abs(np.log(reduced)[None, :] - np.log(full)[:, None])
    cost = np.minimum(1 - np.clip(mac, 0.0, 1.0) + apart, _DIFFERENT)
    i, j = closest_pairs(cost)
    paired = i[cost[i, j] < _DIFFERENT]
    oscillates = -full.real <= _CRITICAL * abs(full)
    lost = np.flatnonzero(_in_band(full, band_hz, low_hz) & oscillates)
    return np.asarray(np.setdiff1d(lost, paired), dtype=np.int64)


def _in_band(s: NDArray[np.complex128], band_hz: float, low_hz: float) -> NDArray[np.bool_]:
    return np.asarray((abs(s) >= 2 * np.pi * low_hz) & (abs(s) <= 2 * np.pi * band_hz))
