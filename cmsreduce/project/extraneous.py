"""Modes that projection and reassembly bring along uncalled: how many, which, where they live, what they do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ExtraneousMode", "ModeShare", "extraneous_count", "extraneous_modes", "returned"]

# A mode is one of the chosen ones, or a combination of repeated ones, when they hold this share of its modal mass;
# those that came along are orthogonal to them, so that shares lie near one or near zero.
_CHOSEN = 0.5


@dataclass(frozen=True)
class ModeShare:
    """Where a mode lives.

    Parameters
    ----------
    body : str
        Body with the largest part of its energy.
    energy : mapping of body to float
        Share of each body in the mode's kinetic and strain energy, which sum to one.
    interface : str
        Interface that moves most in it, each motion measured against that of all modes there; empty without interfaces.
    """

    body: str
    energy: Mapping[str, float]
    interface: str


@dataclass(frozen=True, eq=False)
class ExtraneousMode:
    """A mode of the reassembled system that nobody chose.

    Parameters
    ----------
    configuration : str
        Where it was found.
    hz : float
        Its frequency.
    share : ModeShare
        Where it lives.
    weight : (outputs,) float64
        Largest peak, over the inputs, that it adds to each output, relative to the largest of any mode there.
    """

    configuration: str
    hz: float
    share: ModeShare
    weight: NDArray[np.float64]


def extraneous_count(ranks: Sequence[int], constrained: int, chosen: int) -> int:
    """Count the modes that come along: sum of the bodies' shapes, less the constraints, less what was chosen.

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


def returned(chosen: NDArray[np.float64], shapes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the modal mass of each reassembled mode that the chosen modes hold.

    Parameters
    ----------
    chosen : (N, n_R) float64
        Chosen modes in coordinates orthonormal in the system's mass.
    shapes : (N, k) float64
        Modes of the reassembled system in the same coordinates.

    Returns
    -------
    (k,) float64
        Between 0 and 1.
    """
    return np.asarray(((chosen.T @ shapes) ** 2).sum(axis=0))


def extraneous_modes(
    configuration: str,
    omega: NDArray[np.float64],
    held: NDArray[np.float64],
    energy: Mapping[str, NDArray[np.float64]],
    motion: Mapping[str, NDArray[np.float64]],
    peak: NDArray[np.float64],
) -> tuple[ExtraneousMode, ...]:
    """Name the modes of a reassembled system that were not chosen.

    Parameters
    ----------
    configuration : str
        Where they were found.
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
    """
    total = np.maximum(sum(energy.values(), np.zeros(omega.size)), np.finfo(float).tiny)
    largest = np.maximum(peak.max(axis=1, initial=0.0), np.finfo(float).tiny)
    found = []
    for k in np.flatnonzero(held < _CHOSEN):
        shares = {body: float(parts[k] / total[k]) for body, parts in energy.items()}
        relative = {name: float(size[k] / (np.linalg.norm(size) or 1.0)) for name, size in motion.items()}
        share = ModeShare(
            max(shares, key=lambda body: shares[body]),
            shares,
            max(relative, key=lambda name: relative[name]) if relative else "",
        )
        found.append(
            ExtraneousMode(configuration, float(omega[k] / (2 * np.pi)), share, np.asarray(peak[:, k] / largest))
        )
    return tuple(found)
