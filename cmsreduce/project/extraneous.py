"""Extraneous modes of a reassembled system, which were not chosen: number, place and effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.model import ExtraneousMode

__all__ = ["extraneous_count", "extraneous_modes", "returned"]

Array = NDArray[np.float64]

# A mode is one of the chosen ones, or a combination of repeated ones, when they hold this share of its modal mass.
# Extraneous modes are orthogonal to the chosen ones, so that shares lie near one or near zero.
_CHOSEN = 0.5


def extraneous_count(ranks: Sequence[int], constrained: int, chosen: int) -> int:
    """Count the extraneous modes: sum of the bodies' shapes, less the constraints, less the chosen modes.

    Parameters
    ----------
    ranks : sequence of int
        r_i of each body.
    constrained : int
        Rank of the reduced constraints A_R.
    chosen : int
        n_R.

    Notes
    -----
    Source: Eke and Man; theory section 6.

    Examples
    --------
    Five disks, two of the five modes kept:

    >>> extraneous_count([2, 2], 1, 2)
    1
    """
    return sum(ranks) - constrained - chosen


def returned(products: Array, gram: Array | None = None) -> Array:
    """Share of the modal mass of each reassembled mode that the chosen shapes hold.

    Parameters
    ----------
    products : (n_R, k) float64
        Mass products of the chosen shapes and the modes of the reassembled system, which have unit modal mass.
    gram : (n_R, n_R) float64, optional
        Mass products of the chosen shapes; the identity if absent, as for modes without damping.

    Returns
    -------
    (k,) float64
        Between 0 and 1.
    """
    own = products if gram is None else la.pinvh(gram) @ products
    return np.asarray((products * own).sum(axis=0))


def extraneous_modes(
    configuration: str,
    omega: Array,
    held: Array,
    energy: Mapping[str, Array],
    motion: Mapping[str, Array],
    peak: Array,
    mac: Array,
) -> tuple[ExtraneousMode, ...]:
    """Name the modes of a reassembled system that were not chosen.

    Parameters
    ----------
    configuration : str
        Name of the configuration.
    omega : (k,) float64
        Elastic frequencies of the reassembled system in rad/s.
    held : (k,) float64
        From `returned`.
    energy : mapping of body to (k,) float64
        Kinetic and strain energy of each body in each mode.
    motion : mapping of interface to (k,) float64
        Size of the motion of each interface in each mode.
    peak : (outputs, k) float64
        Largest peak of each mode in each output.
    mac : (k,) float64
        Largest share of each mode that one mode of the unreduced system holds.
    """
    total = np.maximum(sum(energy.values(), np.zeros(omega.size)), np.finfo(float).tiny)
    largest = np.maximum(peak.max(axis=1, initial=0.0), np.finfo(float).tiny)
    found = []
    for k in np.flatnonzero(held < _CHOSEN):
        shares = {body: float(parts[k] / total[k]) for body, parts in energy.items()}
        relative = {name: float(size[k] / (np.linalg.norm(size) or 1.0)) for name, size in motion.items()}
        found.append(
            ExtraneousMode(
                configuration,
                float(omega[k] / (2 * np.pi)),
                max(shares, key=lambda body: shares[body]),
                shares,
                max(relative, key=lambda name: relative[name]) if relative else "",
                np.asarray(peak[:, k] / largest),
                float(mac[k]),
            )
        )
    return tuple(found)
