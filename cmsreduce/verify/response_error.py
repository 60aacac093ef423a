"""Errors of a reduced model's frequency response (design: summary.json)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Channel

__all__ = ["channel_scales", "db_error", "frac", "frf_error"]

# A channel whose elastic response is below this share of its rigid one is round-off left by the subtraction.
_ROUND_OFF = 1e-10
# A channel 120 dB below the strongest of its unit is nothing that an eye sees beside it.
SILENT = 1e-6
# Share of the points of a Bode plot that lie within the decibel error.
_PERCENTILE = 99.0

Response = NDArray[np.complex128]


def channel_scales(
    inputs: Sequence[Channel], outputs: Sequence[Channel], elastic: Response, total: Response
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Scales that make channels of unlike units comparable.

    Channels of one unit keep their proportions; each unit is scaled to the same root mean square response, so that
    neither radians against metres nor rates against displacements decide the error.

    Parameters
    ----------
    inputs, outputs : sequence of Channel
        What each column and row is.
    elastic, total : (f, outputs, inputs) complex128
        Response of the full model without and with its rigid-body part.

    Returns
    -------
    row : (outputs,) float64
        Factors of the outputs; zero where the elastic response is round-off.
    column : (inputs,) float64
        Factors of the inputs.
    """
    power = np.mean(abs(elastic) ** 2, axis=0)
    power[power <= (_ROUND_OFF**2) * np.mean(abs(total) ** 2, axis=0)] = 0.0
    rows, columns = _units(outputs), _units(inputs)
    row, column = np.ones(len(outputs)), np.ones(len(inputs))
    for _ in range(4):
        row = _equalised(power * column[None, :] ** 2, rows, axis=1)
        column = _equalised(power * row[:, None] ** 2, columns, axis=0)
    return row, column


def frf_error(
    omega: NDArray[np.float64], H: Response, H_r: Response, row: NDArray[np.float64], column: NDArray[np.float64]
) -> float:
    """Relative error of the elastic response over the band.

    Parameters
    ----------
    omega : (f,) float64
        Circular frequencies.
    H, H_r : (f, outputs, inputs) complex128
        Elastic responses of the full and the reduced model.
    row, column : float64
        From `channel_scales`.

    Returns
    -------
    float
        sqrt(int ||H - H_r||_F^2 dw / int ||H||_F^2 dw); infinite if only the full model is silent.
    """
    weight = row[:, None] * column[None, :]
    miss = np.trapezoid(np.sum(abs((H - H_r) * weight) ** 2, axis=(1, 2)), omega)
    size = np.trapezoid(np.sum(abs(H * weight) ** 2, axis=(1, 2)), omega)
    if size == 0:
        return 0.0 if miss == 0 else float("inf")
    return float(np.sqrt(miss / size))


def db_error(H: Response, H_r: Response, row: NDArray[np.float64], column: NDArray[np.float64]) -> float:
    """Decibels by which the reduced response leaves the full one, worst channel.

    Parameters
    ----------
    H, H_r : (f, outputs, inputs) complex128
        Responses with their rigid-body part, on `decibel_grid`.
    row, column : float64
        From `channel_scales`; channels silent beside the strongest of their unit are passed over.

    Returns
    -------
    float
        99th percentile over the grid of |20 log10(|H_r| / |H|)|.
    """
    size = np.sqrt(np.mean(abs(H) ** 2, axis=0)) * row[:, None] * column[None, :]
    heard = size > SILENT * size.max(initial=0.0)
    worst = 0.0
    tiny = np.finfo(float).tiny
    for i, j in zip(*np.nonzero(heard), strict=True):
        ratio = np.maximum(abs(H_r[:, i, j]), tiny) / np.maximum(abs(H[:, i, j]), tiny)
        worst = max(worst, float(np.percentile(abs(20 * np.log10(ratio)), _PERCENTILE)))
    return worst


def frac(H: Response, H_r: Response) -> NDArray[np.float64]:
    """Frequency response assurance criterion of each channel: 1 for equal shapes, 0 for unlike ones.

    Returns
    -------
    (outputs, inputs) float64
        |sum H* H_r|^2 / (sum |H|^2 sum |H_r|^2); NaN for a silent channel. Source: Heylen and Lammens (1996).
    """
    cross = abs(np.sum(H.conj() * H_r, axis=0)) ** 2
    size = np.sum(abs(H) ** 2, axis=0) * np.sum(abs(H_r) ** 2, axis=0)
    return np.where(size > 0, cross / np.where(size > 0, size, 1.0), np.nan)


def _units(channels: Sequence[Channel]) -> NDArray[np.int64]:
    # A combination of dofs has a unit of its own.
    keys = [(c.quantity, c.rate, c.name if c.quantity == "combination" else "") for c in channels]
    return np.array([sorted(set(keys)).index(key) for key in keys], dtype=np.int64)


def _equalised(power: NDArray[np.float64], unit: NDArray[np.int64], axis: int) -> NDArray[np.float64]:
    by_channel = power.sum(axis=axis)
    scale = np.zeros(unit.size)
    for u in np.unique(unit):
        mean = by_channel[unit == u].mean()
        if mean > 0:
            scale[unit == u] = 1 / np.sqrt(mean)
    return scale
