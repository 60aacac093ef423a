"""Errors of a reduced model's frequency response."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Channel

__all__ = [
    "PERCENTILE",
    "channel_errors",
    "channel_scales",
    "db_error",
    "db_errors",
    "frac",
    "frf_error",
    "responding_channels",
    "loud_channels",
    "peak_errors",
    "peak_shifts",
]

Response = NDArray[np.complex128]
Array = NDArray[np.float64]

# A channel whose elastic response is below this share of its rigid one is round-off of the subtraction.
_ROUND_OFF = 1e-10
# A channel 120 dB below the strongest of its unit cannot be seen beside it.
SILENT = 1e-6
# Rounds of scaling rows and columns in turn. More rounds would raise a negligible coupling until outputs and inputs
# agree in every unit.
_ROUNDS = 4
PERCENTILE = 99.0
"""Per cent of the points of a Bode plot that lie within the decibel error."""
# Decibels of a response that is infinite or not a number; two finite ones differ by less than 13 000.
_ENDLESS = 1e5
# A peak 60 dB below the highest of its channel cannot be seen beside it.
_SEEN = 1e-3
# A peak lies off its resonance by zeta^2, more where the slope of other modes tilts it; further off, it belongs to a
# mode without a partner.
_NEAR = 0.02


def channel_scales(
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    elastic: Response,
    total: Response,
    omega: Array | None = None,
) -> tuple[Array, Array]:
    """Scales that make channels of unlike units comparable.

    Channels of one unit keep their proportions; each unit is scaled to the same root mean square response, so that
    neither radians against metres nor rates against displacements decide the error. Another unit (degrees for radians)
    changes the factors, but no error measured with them.

    Parameters
    ----------
    inputs, outputs : sequence of Channel
        Channels of the columns and rows.
    elastic, total : (f, outputs, inputs) complex128
        Response of the reference model without and with its rigid-body part.
    omega : (f,) float64, optional
        Circular frequencies. The scales come from integrals over them, as the errors do, so that a finer grid does not
        move them. Without them every point has the same weight.

    Returns
    -------
    row : (outputs,) float64
        Factors of the outputs; zero where the elastic response is round-off.
    column : (inputs,) float64
        Factors of the inputs.
    """
    power = _power(elastic, omega)
    power[power <= (_ROUND_OFF**2) * _power(total, omega)] = 0.0
    if not outputs or not inputs:
        return np.ones(len(outputs)), np.ones(len(inputs))
    rows, columns = _units(outputs), _units(inputs)
    by_unit = np.zeros((rows.max() + 1, columns.max() + 1))
    np.add.at(by_unit, np.ix_(rows, columns), power)
    row, column = _equalised(by_unit, np.bincount(rows), np.bincount(columns))
    return row[rows], column[columns]


def frf_error(omega: Array, H: Response, H_r: Response, row: Array, column: Array) -> float:
    """Relative error of the elastic response over the band.

    Parameters
    ----------
    omega : (f,) float64
        Circular frequencies.
    H, H_r : (f, outputs, inputs) complex128
        Elastic responses of the reference and of the reduced model.
    row, column : float64
        From `channel_scales`.

    Returns
    -------
    float
        sqrt(int ||H - H_r||_F^2 dw / int ||H||_F^2 dw); infinite if only the reference model is silent.
    """
    weight = row[:, None] * column[None, :]
    miss = np.trapezoid(np.sum(abs((H - H_r) * weight) ** 2, axis=(1, 2)), omega)
    size = np.trapezoid(np.sum(abs(H * weight) ** 2, axis=(1, 2)), omega)
    if size == 0:
        return 0.0 if miss == 0 else float("inf")
    return float(np.sqrt(miss / size))


def db_errors(H: Response, H_r: Response, row: Array, column: Array, judged: NDArray[np.bool_] | bool = False) -> Array:
    """Difference in decibels of the reduced response from the reference, channel by channel.

    Parameters
    ----------
    H, H_r : (f, outputs, inputs) complex128
        Responses with their rigid-body part, on `decibel_grid`.
    row, column : float64
        From `channel_scales`.
    judged : (outputs, inputs) bool, optional
        Channels that are not silent in the elastic response. At the lower end of the band, rigid motion in others is so
        large that a stretch or a bending angle would be silent beside it.

    Returns
    -------
    (outputs, inputs) float64
        99th percentile over the grid of |20 log10(|H_r| / |H|)|; NaN for channels silent beside the strongest of their
        unit, and for these alone: a response that is not a number has an error beyond all others.
    """
    loud = loud_channels(H, row, column) | judged
    tiny = np.finfo(float).tiny
    full, reduced = (np.maximum(abs(X[:, loud]), tiny) for X in (H, H_r))
    found = np.full(loud.shape, np.nan)
    if loud.any():
        # A maximum over channels leaves silent ones out, and would not see an error that is not a number.
        apart = np.nan_to_num(abs(20 * np.log10(reduced / full)), nan=_ENDLESS, posinf=_ENDLESS)
        found[loud] = np.percentile(apart, PERCENTILE, axis=0)
    return found


def db_error(H: Response, H_r: Response, row: Array, column: Array, judged: NDArray[np.bool_] | bool = False) -> float:
    """Largest of `db_errors`: that of the worst channel; 0 without a channel."""
    return float(np.nanmax(db_errors(H, H_r, row, column, judged), initial=0.0))


def loud_channels(H: Response, row: Array, column: Array, omega: Array | None = None) -> NDArray[np.bool_]:
    """Mask (outputs, inputs) of channels that are not silent beside the strongest of all, units made comparable.

    Parameters
    ----------
    H : (f, outputs, inputs) complex128
        Response of the reference model.
    row, column : float64
        From `channel_scales`.
    omega : (f,) float64, optional
        Circular frequencies, for an integral over them; without them every point has the same weight.
    """
    size = np.sqrt(_power(H, omega)) * row[:, None] * column[None, :]
    return np.asarray(size > SILENT * size.max(initial=0.0))


def responding_channels(elastic: Response, reach: Array, share: float = _ROUND_OFF) -> NDArray[np.bool_]:
    """Mask (outputs, inputs) of channels whose elastic response is more than rounding.

    Parameters
    ----------
    elastic : (f, outputs, inputs) complex128
        Response without its rigid-body part, at a few frequencies of the band.
    reach : (f, outputs, inputs) float64
        Geometric mean of the motions at the actuator and at the sensor under efforts of their own.
    share : float
        Largest share of the reach that is rounding.
    """
    return np.asarray((abs(elastic) > share * reach).any(axis=0))


def channel_errors(omega: Array, H: Response, H_r: Response) -> Array:
    """Relative error of the response of each channel over the band.

    Returns
    -------
    (outputs, inputs) float64
        sqrt(int |H - H_r|^2 dw / int |H|^2 dw); NaN for a channel that is silent in both models, infinite for one that
        is silent in the reference model alone, or whose response is not a number.
    """
    miss, size = (np.sqrt(np.trapezoid(abs(X) ** 2, omega, axis=0)) for X in (H - H_r, H))
    error = np.nan_to_num(
        np.divide(miss, size, out=np.full(miss.shape, np.inf), where=size > 0), nan=np.inf, posinf=np.inf
    )
    return np.where((miss == 0) & (size == 0), np.nan, error)


def peak_errors(H: Response, H_r: Response) -> Array:
    """Relative error of the height of the highest peak of each channel.

    Returns
    -------
    (outputs, inputs) float64
        | max|H_r| - max|H| | / max|H| over the band; NaN for a silent channel. The shift of a peak does not count here;
        in `channel_errors` it counts much.
    """
    high, high_r = (abs(X).max(axis=0, initial=0.0) for X in (H, H_r))
    return np.asarray(np.where(high > 0, abs(high_r - high) / np.where(high > 0, high, 1.0), np.nan))


def frac(H: Response, H_r: Response) -> Array:
    """Frequency response assurance criterion of each channel: 1 for equal shapes, 0 for unlike ones.

    Returns
    -------
    (outputs, inputs) float64
        |sum H* H_r|^2 / (sum |H|^2 sum |H_r|^2); NaN for a silent channel. Source: Heylen and Lammens (1996).
    """
    cross = abs(np.sum(H.conj() * H_r, axis=0)) ** 2
    size = np.sum(abs(H) ** 2, axis=0) * np.sum(abs(H_r) ** 2, axis=0)
    return np.where(size > 0, cross / np.where(size > 0, size, 1.0), np.nan)


def _power(H: Response, omega: Array | None) -> Array:
    """Mean square (outputs, inputs): over the points, or over the frequencies by an integral."""
    if omega is None or omega.size < 2:
        return np.asarray(np.mean(abs(H) ** 2, axis=0))
    return np.asarray(np.trapezoid(abs(H) ** 2, omega, axis=0) / (omega[-1] - omega[0]))


def _units(channels: Sequence[Channel]) -> NDArray[np.int64]:
    # A combination of dofs has a unit of its own.
    keys = [(c.quantity, c.rate, c.name if c.quantity == "combination" else "") for c in channels]
    return np.array([sorted(set(keys)).index(key) for key in keys], dtype=np.int64)


def _equalised(power: Array, outputs: NDArray[np.int64], inputs: NDArray[np.int64]) -> tuple[Array, Array]:
    """Factors that bring units of inputs, and nearly those of outputs, to one mean power a channel; zero if silent."""
    g, h = np.nonzero(power)
    # The start is the least squares of the logarithms, which a change of units does not alter; after a start from ones,
    # the result of the few rounds below would depend on the units.
    parts = np.zeros((g.size, sum(power.shape)))
    parts[np.arange(g.size), g] = parts[np.arange(g.size), power.shape[0] + h] = 1.0
    logarithms, *_ = np.linalg.lstsq(parts, -0.5 * np.log(power[g, h]), rcond=None)
    row, column = np.ones(power.shape[0]), np.exp(logarithms[power.shape[0] :])
    for _ in range(_ROUNDS):
        row = _inverse_root(power @ column**2 / outputs)
        column = _inverse_root(row**2 @ power / inputs)
    return row, column


def _inverse_root(mean: Array) -> Array:
    return np.where(mean > 0, 1 / np.sqrt(np.where(mean > 0, mean, 1.0)), 0.0)


def peak_shifts(omega: Array, H: Response, full: Array, reduced: Array) -> Array:
    """Largest normalised relative frequency difference (NRFD) of the modes that make a peak in each channel.

    Parameters
    ----------
    omega : (f,) float64
        Grid, refined at the resonances; any unit.
    H : (f, outputs, inputs) complex128
        Elastic response of the reference model.
    full, reduced : (k,) float64
        Natural frequencies paired by their shapes, in the unit of the grid.

    Returns
    -------
    (outputs, inputs) float64
        |reduced - full| / full, the largest of the modes with a peak in the channel; NaN where there is none. A mode of
        the reference model without a partner does not count here; response error and FRAC contain it.

    Examples
    --------
    >>> w = np.linspace(0.5, 1.5, 1001)
    >>> H = 1 / (1 - w**2 + 0.01j * w)
    >>> peak_shifts(w, H[:, None, None], np.array([1.0, 1.4]), np.array([1.002, 1.5])).round(6).tolist()
    [[0.002]]
    """
    size = abs(H)
    found = np.full(H.shape[1:], np.nan)
    if omega.size < 3 or not full.size:
        return found
    shift = abs(reduced - full) / np.where(full > 0, full, 1.0)
    top = (size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:]) & (size[1:-1] >= _SEEN * size.max(axis=0))
    for y, u in np.ndindex(*found.shape):
        at = omega[1:-1][top[:, y, u]]
        if not at.size:
            continue
        apart = abs(at[:, None] - full[None, :]) / at[:, None]
        mode = apart.argmin(axis=1)
        near = apart[np.arange(at.size), mode] <= _NEAR
        if near.any():
            found[y, u] = shift[mode[near]].max()
    return found
