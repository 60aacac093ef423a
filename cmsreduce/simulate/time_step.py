"""Integration in time: the step by the highest frequency and the accuracy, and motions that grow without bound."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import SimulationError
from cmsreduce.simulate.system import MultibodySystem

__all__ = ["Method", "States", "integrate", "longest_step"]

Array = NDArray[np.float64]

Method = Literal["explicit", "implicit"]
"""``explicit``: Dormand and Prince's method of order 8; ``implicit``: Radau IIA of order 5."""

# Error of a step relative to the state, of the size of the scene; the tolerance of modes is as much smaller as their
# deflections may be. Where all motions are smaller, their size takes its place.
_ABSOLUTE = 1e-3
# Relative to the scene, ten times what closes joints: a smaller motion is rest, a smaller error of a step rounding.
_LEAST = 1e-12
# Motions this much smaller than the tolerances expect are integrated again.
_SMALLER = 0.1
# Bisections for the longest step: digits of a double.
_HALVINGS = 50
# Share of the largest energy that may appear or vanish, in units of the accuracy: errors of many steps add up.
_IMBALANCE = 1e3
_LEAST_IMBALANCE = 1e-9
# Relative to the whole time: the end of an effort and a time to return are one time, apart from rounding.
_ALIKE = 1e-12


@dataclass(frozen=True, eq=False)
class States:
    """States of a system over time.

    Parameters
    ----------
    time : (t,) float64
        In seconds.
    y : (t, n) float64
        State at each time.
    steps : int
        Number of steps.
    longest, shortest : float
        Steps in seconds.
    seconds : float
        Time that the integration took.
    highest_omega : float
        Highest frequency at the start in rad/s, joints closed; 0 for rigid bodies.
    kinetic : float
        Largest kinetic energy at the end of a step: a motion from rest to rest has none at the times to return.
    """

    time: Array
    y: Array
    steps: int
    longest: float
    shortest: float
    seconds: float
    highest_omega: float
    kinetic: float


@cache
def longest_step(accuracy: float) -> float:
    """Longest explicit step in units of 1 / w at which an oscillation of frequency w errs by less than the accuracy.

    The error is that of one step, in amplitude and phase, for each radian of the oscillation.

    Examples
    --------
    >>> [round(longest_step(accuracy), 2) for accuracy in (1e-2, 1e-3, 1e-6)]
    [4.26, 3.24, 1.4]
    """
    from scipy.integrate import DOP853

    A, B = DOP853.A, DOP853.B
    one = np.ones(B.size)

    def error(x: float) -> float:
        factor = 1 + 1j * x * B @ np.linalg.solve(np.eye(B.size) - 1j * x * A, one)
        return float(abs(factor - np.exp(1j * x))) / x

    low, high = 1e-3, 10.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if error(middle) < accuracy else (low, middle)
    return low


def integrate(
    system: MultibodySystem,
    start: Array,
    times: Array,
    *,
    accuracy: float = 1e-6,
    step: float | None = None,
    method: Method = "explicit",
) -> States:
    """Integrate a system from a state.

    Parameters
    ----------
    system : MultibodySystem
        Bodies, joints, efforts.
    start : (n,) float64
        State at the first time, which keeps the constraints.
    times : (t,) float64
        Times of the states to return, ascending.
    accuracy : float
        Error of each radian of the fastest oscillation, and relative error of a step.
    step : float, optional
        Fixed step instead, in seconds, for studies of convergence; cut at the times to return. Explicit method alone.
    method : Method
        ``implicit`` steps over fast modes, and damps them; its step follows from the error estimate alone.

    Raises
    ------
    SimulationError
        If the motion grows without bound, or energy is not conserved.

    Notes
    -----
    Explicit: order 8 with error estimates of orders 5 and 3 (Hairer, Norsett and Wanner I, II.5; scipy's DOP853). The
    step is at most ``longest_step`` over the highest frequency at the start, and shorter where the estimate asks.
    Implicit: Radau IIA (Hairer and Wanner II, IV.8). Motions far smaller than the scene are integrated again, with
    tolerances of their size.
    """
    scales, size = _tolerances(system, float(times[-1] - times[0])), _ABSOLUTE
    while True:
        found = _integrated(system, start, times, accuracy, max(accuracy * size, _LEAST) * scales, step, method)
        moved = float((abs(found.y - start) / scales).max())
        if method == "explicit" or not _LEAST < moved < _SMALLER * size:
            break
        size = moved
    _refuse_imbalance(system, found, accuracy, method)
    return found


def _integrated(
    system: MultibodySystem,
    start: Array,
    times: Array,
    accuracy: float,
    atol: Array,
    step: float | None,
    method: Method,
) -> States:
    """Integrate once, with a tolerance (n,) of every part of the state."""
    # To load integrators takes longer than most commands that do not need them.
    from scipy.integrate import DOP853, Radau

    squares, _ = system.linear(start)
    highest = float(np.sqrt(max(squares.max(initial=0.0), 0.0)))
    span = float(times[-1] - times[0])
    limit = longest_step(accuracy) / highest if highest > 0 and method == "explicit" else span
    options: dict[str, Any] = {"rtol": accuracy, "atol": atol, "max_step": min(limit, span)}
    if step is not None:
        # An estimate that never refuses leaves the step at its limit.
        options = {"rtol": 1e300, "atol": 1e300, "max_step": step, "first_step": min(step, span)}
    returned, kinetic = set(times[1:].tolist()), system.energies(start)[0]
    began, steps, sizes, kept = time.perf_counter(), 0, [np.inf, 0.0], [start]
    # Overflow is found below, and refused by name.
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scheme = DOP853 if method == "explicit" else partial(Radau, jac=system.jacobian)
        solver = scheme(system.rate, float(times[0]), start, float(times[-1]), **options)
        for target in _stops(system, times):
            # Steps end at the times to return, where the constraints hold; interpolation would not keep them.
            solver.t_bound, solver.status = target, "running"
            while solver.status == "running":
                before = solver.t
                try:
                    message = solver.step()
                    if message or not np.isfinite(solver.y).all():
                        raise SimulationError(message or "values are not finite")
                    solver.y = system.projected(solver.y)
                    solver.f = solver.fun(solver.t, solver.y)
                    system.refuse_large(solver.y)
                except (SimulationError, np.linalg.LinAlgError) as error:
                    raise SimulationError(_diverged(error, solver.t)) from None
                kinetic = max(kinetic, system.energies(solver.y)[0])
                steps, size = steps + 1, solver.t - before
                sizes = [min(sizes[0], size), max(sizes[1], size)]
            if target in returned:
                kept.append(solver.y)
    elapsed = time.perf_counter() - began
    return States(times, np.array(kept), steps, sizes[1], sizes[0], elapsed, highest, kinetic)


def _stops(system: MultibodySystem, times: Array) -> list[float]:
    """Times at which steps end: those to return, and those at which efforts begin and end.

    A step from rest over a whole pulse would find nothing that moves, in its error estimate either.
    """
    ends = np.array([end for law in system.efforts.values() for end in getattr(law, "ends", ())])
    inside = ends[(ends > times[0]) & (ends < times[-1])]
    apart = abs(inside[:, None] - times).min(axis=1, initial=np.inf) > _ALIKE * (times[-1] - times[0])
    return [float(stop) for stop in np.union1d(times[1:], inside[apart])]


def _tolerances(system: MultibodySystem, span: float) -> Array:
    """Size of every part of the state: that of the scene, and of motions that cross it in the whole time."""
    scales = np.ones(system.values.stop + 1)
    length = system.length
    for number, body in enumerate(system.bodies):
        scales[7 * number : 7 * number + 3] = length
        # A modal coordinate of unit mass moves the whole body by 1 / sqrt(m).
        deflection = length * np.sqrt(body.mass / np.where(np.diag(body.M) > 0, np.diag(body.M), 1.0))
        scales[system.modal[number]] = deflection
        own = system.speeds[number]
        first = system.first_speed + own.start
        scales[first : first + 3], scales[first + 3 : first + 6] = length / span, 1 / span
        omega = np.sqrt(np.maximum(np.diag(body.K), 0) / np.where(np.diag(body.M) > 0, np.diag(body.M), 1.0))
        scales[first + 6 : first + 6 + body.k] = deflection * np.maximum(omega, 1 / span)
    scales[system.values] = length
    # The work follows from the rest; it is checked, and does not set the step.
    scales[-1] = 1e300
    return scales


def _diverged(error: Exception, t: float) -> str:
    return (
        f"the motion grows without bound: at {t:.6g} s, {str(error).rstrip('.')}. Modes of a body that spins near its "
        "lowest frequency diverge without `geometric_stiffness`; or the efforts are too large for the bodies"
    )


def _refuse_imbalance(system: MultibodySystem, states: States, accuracy: float, method: Method) -> None:
    """Refuse energy from nowhere, and with the explicit method also energy that is lost."""
    gained, largest = system.imbalance(states.y), states.kinetic
    if method == "implicit":
        # It takes energy from fast modes.
        gained = np.maximum(gained, 0.0)
    limit = max(_IMBALANCE * accuracy, _LEAST_IMBALANCE) * largest
    worst = int(abs(gained).argmax())
    if abs(gained[worst]) > limit:
        raise SimulationError(
            f"energy is not conserved: at {states.time[worst]:.6g} s, {gained[worst]:.3g} of {largest:.3g} came from "
            "nowhere; ask for a smaller `accuracy`"
        )
