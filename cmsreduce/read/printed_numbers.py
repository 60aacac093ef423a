"""How finely numbers were rounded when they were printed, and whether the last one is whole.

How far a printed number may be from the number that was meant.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.read.labelled_matrix import DOUBLE

__all__ = [
    "digits_of",
    "printed_rounding",
    "rounding_of_digits",
    "rounding_of_printed",
    "stops_in_a_number",
]

_PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([EeDd][+-]?\d+|[+-]\d+)?")

# Solvers print at least this many digits in scientific notation, all numbers alike; fewer were typed by hand and exact.
_FEWEST_ALIKE = 4
# Shortest output of a general format such as %g; shorter numbers in a mixture were typed by hand and exact.
_FEWEST_MIXED = 6
# Numbers looked at, from each end of a file: a program prints all of a matrix with one format.
_SAMPLE = 1000


def digits_of(text: str) -> int:
    """Significant digits of a printed number, trailing zeros included; 0 for a zero or what is no number.

    Examples
    --------
    >>> digits_of("-1.7360D+05"), digits_of("0.0250"), digits_of("0.00")
    (5, 3, 0)
    """
    match = _PLAIN.fullmatch(text.strip())
    if match is None:
        return 0
    mantissa = match.group(0)[: match.start(2) - match.start(0)] if match.group(2) else match.group(0)
    return len(mantissa.replace(".", "").lstrip("+-0"))


def rounding_of_digits(digits: int) -> float:
    """Half a unit of the last of so many significant digits, never finer than a double.

    Relative to the decade a number lies in: 5e-11 for ten digits.
    """
    return float(max(DOUBLE, 0.5 * 10.0**-digits))


def rounding_of_printed(numbers: Sequence[str], field: int | None = None) -> float:
    """Relative rounding of numbers as printed.

    Parameters
    ----------
    numbers : sequence of str
        Numbers of one matrix.
    field : int, optional
        Width of the field that cuts them, where the format has one and writers fill it (8 characters in NASTRAN).

    Returns
    -------
    float
        Half a unit of the last printed digit, relative; that of a double where numbers were typed rather than printed.

    Notes
    -----
    Numbers that all carry an exponent and as many digits were printed by one scientific format: those digits count.
    In a narrow field the room is what cuts digits, so the shortest number that fills the field counts. In any other
    mixture (general formats drop trailing zeros, fixed ones lose digits of small numbers) the longest number counts.
    """
    sample = numbers if len(numbers) <= 2 * _SAMPLE else [*numbers[:_SAMPLE], *numbers[-_SAMPLE:]]
    texts = [text.strip() for text in sample]
    if field is not None:
        cut = [digits_of(text) for text in texts if len(text) >= field]
        return rounding_of_digits(min((d for d in cut if d), default=99))
    digits = {digits_of(text) for text in texts} - {0}
    if not digits:
        return DOUBLE
    scientific = all((match := _PLAIN.fullmatch(text)) and match.group(2) for text in texts)
    fewest = _FEWEST_ALIKE if scientific and len(digits) == 1 else _FEWEST_MIXED
    return rounding_of_digits(max(digits)) if max(digits) >= fewest else DOUBLE


def stops_in_a_number(numbers: Sequence[str]) -> bool:
    """Whether the last number is cut short, given that the file does not end its last line.

    Programs print all numbers of a matrix with one width and end the last line; a number narrower than all before it on
    a line without an end was cut. Numbers without exponents vary in width anyway and prove nothing.
    """
    texts = [text.strip().lstrip("+-") for text in numbers[-_SAMPLE:]]
    before = texts[:-1]
    if not before or not all((match := _PLAIN.fullmatch(text)) and match.group(2) for text in before):
        return False
    return len(texts[-1]) < min(len(text) for text in before)


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
