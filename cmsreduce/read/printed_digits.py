"""How far a printed number may be from the number that was meant."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["printed_rounding"]

_EXACT_DIGITS = 5
"""A number of up to so many digits (600., 0.375, 12.5) was typed or fits the field; a longer one was cut to fit."""


def printed_rounding(values: ArrayLike) -> NDArray[np.float64]:
    """Half a unit in the last printed place of each number, zero for short numbers.

    The digits are those of the shortest decimal that reads back as the number, trailing zeros dropped.

    Parameters
    ----------
    values : array_like
        Numbers as read from text.

    Returns
    -------
    float64 array of the same shape

    Examples
    --------
    >>> printed_rounding([600.0, 0.333333, 1234567.0]).tolist()
    [0.0, 5e-07, 0.5]
    """
    values = np.asarray(values, dtype=np.float64)
    out = np.zeros(values.size)
    for k, value in enumerate(values.ravel().tolist()):
        digits = Decimal(repr(value)).normalize().as_tuple()
        if isinstance(digits.exponent, int) and len(digits.digits) > _EXACT_DIGITS:
            out[k] = 0.5 * 10.0**digits.exponent
    return out.reshape(values.shape)
