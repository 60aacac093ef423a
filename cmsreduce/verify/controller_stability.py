"""Stability of a controller on the reference model if it was designed on a reduced one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["controller_response", "open_loop", "stability_margin"]

Complex = NDArray[np.complex128]
Array = NDArray[np.float64]

# Entries of the matrices that are solved at a time: 64 MiB.
_BLOCK_ENTRIES = 2**22


def controller_response(A: Array, B: Array, C: Array, D: Array, frequency_hz: Array) -> Complex:
    """Frequency response of a controller in state space.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, sensors), (actuators, n), (actuators, sensors) float64
        x' = A x + B y, u = C x + D y.
    frequency_hz : (f,) float64
        Grid.

    Returns
    -------
    (f, actuators, sensors) complex128

    Raises
    ------
    MatrixError
        If the sizes do not agree, or a frequency is a pole of the controller.
    """
    n = A.shape[0]
    if A.shape != (n, n) or B.shape != (n, D.shape[1]) or C.shape != (D.shape[0], n):
        raise MatrixError(
            f"controller: A {A.shape}, B {B.shape}, C {C.shape} and D {D.shape} do not fit together; they must be "
            "(n, n), (n, sensors), (actuators, n) and (actuators, sensors)"
        )
    s = 2j * np.pi * frequency_hz
    inner = np.empty((s.size, *B.shape), dtype=np.complex128)
    some = max(1, _BLOCK_ENTRIES // max(n * n, 1))
    try:
        for part in (slice(start, start + some) for start in range(0, s.size, some)):
            inner[part] = np.linalg.solve(s[part, None, None] * np.eye(n) - A, B[None])
    except np.linalg.LinAlgError:
        raise MatrixError(
            "controller: one of the frequencies is a pole of the controller, such as 0 Hz of an integrator; start the "
            "grid above it"
        ) from None
    return np.asarray(C @ inner + D, dtype=np.complex128)


def open_loop(response: Complex, K: Complex) -> Complex:
    """Open loop det(I + G K) - 1 (f,) of a response G (f, outputs, inputs) and a controller K (f, inputs, outputs)."""
    return np.asarray(np.linalg.det(np.eye(response.shape[1]) + response @ K) - 1)


def stability_margin(full: Complex, reduced: Complex, K: Complex) -> tuple[Array, Array]:
    """Compare the spillover of a loop with the distance of the reduced loop from instability.

    Parameters
    ----------
    full, reduced : (f, outputs, inputs) complex128
        Responses G and G_R of the reference and of the reduced model over the band of the controller.
    K : (f, inputs, outputs) complex128
        Controller; u = -K y.

    Returns
    -------
    spillover : (f,) float64
        sigma_max(dG K), or sigma_max(K dG): the part of the loop gain from the modes left out.
    borne : (f,) float64
        sigma_min(I + G_R K), or sigma_min(I + K G_R): distance of the reduced loop from instability.

    Raises
    ------
    MatrixError
        If the inputs and outputs of the controller do not match the outputs and inputs of the responses.

    Notes
    -----
    Sufficient, by the small gain theorem: if the reduced loop is stable, G and G_R have the same unstable poles, and
    sigma_max(dG K) < sigma_min(I + G_R K) at all frequencies, the loop with G is stable. So it is if the loop is cut at
    the actuators, sigma_max(K dG) < sigma_min(I + K G_R): at each frequency the side with the smaller quotient is
    given, of the sensors and actuators that the controller uses. The check covers the frequencies of the grid only.
    """
    if K.shape[1:] != (full.shape[2], full.shape[1]):
        raise MatrixError(
            f"controller: it has {K.shape[2]} inputs and {K.shape[1]} outputs, but there are {full.shape[1]} sensors "
            f"and {full.shape[2]} actuators"
        )
    if K.any():
        # Sensors and actuators that the controller does not use change no root.
        seen, acting = np.flatnonzero(K.any(axis=(0, 1))), np.flatnonzero(K.any(axis=(0, 2)))
        full, reduced, K = full[:, seen][:, :, acting], reduced[:, seen][:, :, acting], K[:, acting][:, :, seen]
    dG = full - reduced
    sides = [(dG @ K, reduced @ K), (K @ dG, K @ reduced)]
    spillover = np.array([np.linalg.svd(part, compute_uv=False)[:, 0] for part, _ in sides])
    borne = np.array([np.linalg.svd(np.eye(loop.shape[1]) + loop, compute_uv=False)[:, -1] for _, loop in sides])
    # Where the loop is cut at the actuators, sensors may have unlike units, as angles and rates.
    at_actuators = spillover[1] * borne[0] < spillover[0] * borne[1]
    return np.where(at_actuators, *spillover[::-1]), np.where(at_actuators, *borne[::-1])
