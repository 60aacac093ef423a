"""Numbers in fields of many cards at once, exactly as one field after the other would give them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.nastran.cards.card import LARGEST

__all__ = ["Fields", "are_blank", "as_integers", "as_reals"]

Fields = NDArray[np.uint8]
"""One field of n cards as characters, (n, width), upper case, filled up with blanks."""

_BLANK, _DIGIT, _SIGN, _POINT, _LETTER, _OTHER = range(6)
_KIND = np.full(256, _OTHER, dtype=np.uint8)
for _characters, _kind in ((" ", _BLANK), ("0123456789", _DIGIT), ("+-", _SIGN), (".", _POINT), ("ED", _LETTER)):
    _KIND[[ord(_one) for _one in _characters]] = _kind

# Where a number has got to after some characters, and where each kind of character takes it from there.
_START, _SIGNED, _WHOLE, _POINTED, _BROKEN, _SCALED, _SCALE_SIGNED, _SCALE, _AFTER, _WRONG = range(10)
_NEXT = np.array(
    [  # blank,  digit,   sign,          point,     E or D
        [_START, _WHOLE, _SIGNED, _POINTED, _WRONG, _WRONG],
        [_WRONG, _WHOLE, _WRONG, _POINTED, _WRONG, _WRONG],
        [_AFTER, _WHOLE, _SCALE_SIGNED, _BROKEN, _SCALED, _WRONG],
        [_WRONG, _BROKEN, _WRONG, _WRONG, _WRONG, _WRONG],
        [_AFTER, _BROKEN, _SCALE_SIGNED, _WRONG, _SCALED, _WRONG],
        [_WRONG, _SCALE, _SCALE_SIGNED, _WRONG, _WRONG, _WRONG],
        [_WRONG, _SCALE, _WRONG, _WRONG, _WRONG, _WRONG],
        [_AFTER, _SCALE, _WRONG, _WRONG, _WRONG, _WRONG],
        [_AFTER, _WRONG, _WRONG, _WRONG, _WRONG, _WRONG],
        [_WRONG, _WRONG, _WRONG, _WRONG, _WRONG, _WRONG],
    ],
    dtype=np.uint8,
).ravel()
_COMPLETE = np.isin(np.arange(10), [_WHOLE, _BROKEN, _SCALE, _AFTER])

# Integers below 2^53 and these powers of ten are doubles, so that one product or quotient is rounded once.
_EXACT = 2.0**53
_POWERS = 10.0 ** np.arange(23)
_MOST_DIGITS = 10**15


def are_blank(fields: Fields) -> NDArray[np.bool_]:
    """True where a field is empty, (n,)."""
    return np.asarray((fields == ord(" ")).all(axis=1))


def as_integers(fields: Fields) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Values of fields as integers.

    Parameters
    ----------
    fields : (n, width) uint8
        One field of each card.

    Returns
    -------
    values : (n,) int64
    sure : (n,) bool
        False where the field is no integer of up to 15 digits, or empty.
    """
    digits, _, negative, whole, complete = _parsed(fields)
    return np.where(negative, -digits, digits), complete & whole & (digits < _MOST_DIGITS)


def as_reals(fields: Fields) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Values of fields as real numbers, each the double next to what is printed.

    Parameters
    ----------
    fields : (n, width) uint8
        One field of each card, at most 16 characters wide.

    Returns
    -------
    values : (n,) float64
    sure : (n,) bool
        False where the field is no number, empty, or of digits or size that only exact arithmetic can round.

    Notes
    -----
    W. D. Clinger, How to read floating point numbers accurately, PLDI 1990: digits that fill less than 53 bits, times
    a power of ten that is exact, need one rounding.
    """
    digits, scale, negative, _, complete = _parsed(fields)
    power = _POWERS[np.minimum(abs(scale), _POWERS.size - 1)]
    size = np.where(scale < 0, digits / power, digits * power)
    exact = (digits < _EXACT) & (abs(scale) < _POWERS.size) & (size < LARGEST)
    return np.where(negative, -size, size), complete & exact


def _parsed(
    fields: Fields,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Digits as one integer, power of ten, minus sign; no point and no exponent; a complete number."""
    n = len(fields)
    state = np.full(n, _START, dtype=np.uint8)
    digits, decimals, scale = (np.zeros(n, dtype=np.int64) for _ in range(3))
    negative, small, whole = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
    for character in np.ascontiguousarray(fields.T):
        kind = _KIND[character]
        state = _NEXT[state * np.uint8(_OTHER + 1) + kind]
        figure = kind == _DIGIT
        value = character - np.uint8(ord("0"))
        broken = state == _BROKEN
        mantissa = figure & (broken | (state == _WHOLE))
        digits[mantissa] = digits[mantissa] * 10 + value[mantissa]
        decimals += figure & broken
        whole &= (state < _POINTED) | (state == _AFTER)
        minus = character == ord("-")
        negative |= minus & (state == _SIGNED)
        if (late := state == _SCALE).any():
            # More digits than a power of ten can have end as no number.
            scale[late] = np.minimum(scale[late] * 10 + value[late], _MOST_DIGITS)
        small |= minus & (state == _SCALE_SIGNED)
    return digits, np.where(small, -scale, scale) - decimals, negative, whole, _COMPLETE[state]
