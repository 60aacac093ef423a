"""What a finished reduction holds of static loads, of the gains between channels, and of their zeros."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import state_space, system_modes
from cmsreduce.linalg.dense import dense
from cmsreduce.model import Configuration, System
from cmsreduce.pipeline.assembled import AssembledModel
from cmsreduce.pipeline.bodies import probing_loads
from cmsreduce.pipeline.run import Run
from cmsreduce.verify.gain_sum import GainSum, gain_sum
from cmsreduce.verify.static_completeness import static_completeness
from cmsreduce.verify.transmission_zeros import transmission_zeros, visible_modes, zero_shifts

__all__ = ["PairZeros", "StaticLack", "channel_gains", "static_lack", "zeros_apart"]

Array = NDArray[np.float64]

# All modes of a system of so many coordinates are a matter of seconds; zeros need them all.
_DENSE = 1500
# Zeros below this share of the lowest frequency are those of rigid motion alone.
_BELOW = 1e-2


@dataclass(frozen=True)
class StaticLack:
    """Strain energy that a reduced body lacks under one static load.

    Parameters
    ----------
    load : str
        ``interface 'tip'`` or ``actuator 'motor'``.
    lack : float
        |u - u_r|_K^2 / |u|_K^2, the largest of the loads of this name.
    """

    load: str
    lack: float


@dataclass(frozen=True, eq=False)
class PairZeros:
    """Zeros between two channels, in the full and in the reduced system.

    Parameters
    ----------
    output, input : int
        Channels.
    full, reduced : (z,), (y,) complex128
        In rad/s, undamped.
    shift : (m,) float64
        Of each zero of the full system in the band that damping does not hide, relative.
    """

    output: int
    input: int
    full: NDArray[np.complex128]
    reduced: NDArray[np.complex128]
    shift: Array


def static_lack(run: Run, name: str) -> list[StaticLack]:
    """How complete a reduced body is under unit loads at its interfaces and actuators, one line for each of these."""
    flexible = run.bodies[name]
    names, loads = probing_loads(flexible, run.scene, joints=True)
    acting = np.array([not load.startswith("sensor") for load in names], dtype=bool)
    acting &= abs(loads).max(axis=0, initial=0.0) > 0
    lack = static_completeness(
        run.final[name], flexible.body, flexible.rigid, loads[:, acting], flexible.ports.interface
    )
    worst: dict[str, float] = {}
    for load, value in zip(np.array(names)[acting], lack, strict=True):
        worst[str(load)] = max(worst.get(str(load), 0.0), float(value))
    return [StaticLack(load, value) for load, value in worst.items()]


def channel_gains(model: AssembledModel, configuration: Configuration) -> GainSum | None:
    """Modal gains of a system between all its channels; None if it is too large for all its modes."""
    system = model.system(configuration)
    modes = _all_modes(system)
    if modes is None:
        return None
    omega, B, C1, C2 = modes
    elastic = omega > 0
    # A shape without mass follows its load at once: the direct term of the state space.
    direct = np.asarray(state_space(system).D, dtype=np.float64) if omega.size < system.N else None
    return gain_sum(omega[elastic], B[elastic], (C1 + C2)[:, elastic], direct)


def zeros_apart(full: AssembledModel, reduced: AssembledModel, configuration: Configuration) -> list[PairZeros] | None:
    """Compare the zeros of every pair of channels; None if the full system is too large for all its modes."""
    systems = full.system(configuration), reduced.system(configuration)
    modes = [_all_modes(system) for system in systems]
    if modes[0] is None or modes[1] is None:
        return None
    low, high = (2 * np.pi * hz for hz in reduced.scene.band)
    # The lowest frequency there is, where the band starts at none: below it zeros are those of rigid motion.
    elastic = modes[0][0][modes[0][0] > 0]
    low = max(low, _BELOW * float(elastic.min(initial=high)))
    hidden = float(reduced.resonances(configuration).zeta.min(initial=np.inf))
    found = []
    for y in range(systems[0].C1.shape[0]):
        for u in range(systems[0].B.shape[1]):
            # A rate has the zeros of its displacement, and one at the origin.
            seen = [visible_modes(omega, B[:, u] * (C1 + C2)[y]) for omega, B, C1, C2 in (modes[0], modes[1])]
            zeros = [transmission_zeros(omega, residue, np.ones(omega.size)) for omega, residue in seen]
            shift = zero_shifts(zeros[0], zeros[1], (low, high), seen[0][0], hidden if np.isfinite(hidden) else 0.0)
            found.append(PairZeros(y, u, zeros[0], zeros[1], shift))
    return found


def _all_modes(system: System) -> tuple[Array, Array, Array, Array] | None:
    """Every frequency of a system, rigid ones first, and its channels in its modes."""
    if system.N > _DENSE:
        return None
    omega, Phi = system_modes(_as_dense(system), float("inf"))
    X = np.hstack([system.rigid, Phi])
    omega = np.concatenate([np.zeros(system.rigid.shape[1]), omega])
    return omega, X.T @ system.B, system.C1 @ X, system.C2 @ X


def _as_dense(system: System) -> System:
    return replace(system, K=dense(system.K), M=dense(system.M))
