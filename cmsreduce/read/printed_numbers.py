"""Numbers printed in text: their values, their rounding, and a test for a last number that is cut short."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.read.labelled_matrix import DOUBLE

__all__ = [
    "coordinate_rounding",
    "digits_of",
    "number_of",
    "printed_rounding",
    "real_number",
    "rounding_of_digits",
    "rounding_of_printed",
    "stops_in_a_number",
]

_NASTRAN_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[ED]?([+-]?\d+))?\Z")
_PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([EeDd][+-]?\d+|[+-]\d+)?")

# Solvers print at least this many digits in scientific notation, all numbers alike; shorter ones are typed and exact.
_FEWEST_ALIKE = 4
# Shortest output of a general format such as %g; shorter numbers in a mixture are typed and exact.
_FEWEST_MIXED = 6
# Numbers examined at each end of a file: a program prints all of a matrix with one format.
_ENDS = 1000
# Nodes whose coordinates are examined, spread over a file: one program prints all of them.
_NODES = 2000
# A number of up to this many digits (600., 0.375, 12.5) was typed or fits its field; a longer one was cut to fit.
_EXACT_DIGITS = 5


def real_number(text: str) -> float | None:
    """Value of a NASTRAN or Fortran real; None if the text is no number.

    Examples
    --------
    >>> real_number("1.5-3"), real_number("1.+7"), real_number("-.25d2"), real_number("THRU")
    (0.0015, 10000000.0, -25.0, None)
    """
    found = _NASTRAN_REAL.match(text.strip().upper())
    return None if found is None else float(f"{found[1]}E{found[2] or 0}")


def number_of(text: str) -> float:
    """Value of a number whose exponent may have the letter of Fortran; remarks may follow it.

    Raises
    ------
    ValueError
        If the text begins with no number.

    Examples
    --------
    >>> number_of("-.25d2"), number_of(" 3 kg")
    (-25.0, 3.0)
    """
    return float((text.split() or [""])[0].replace("D", "E").replace("d", "e"))


def digits_of(text: str) -> int:
    """Significant digits of a printed number, trailing zeros included; 0 for a zero and for other text.

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
    """Half a unit of the last significant digit, never finer than a double.

    Relative to the decade that the number lies in: 5e-11 for ten digits.
    """
    return float(max(DOUBLE, 0.5 * 10.0**-digits))


def rounding_of_printed(numbers: Sequence[str], field: int | None = None) -> float:
    """Relative rounding of numbers as printed.

    Parameters
    ----------
    numbers : sequence of str
        Numbers of one matrix.
    field : int, optional
        Width of the fields, where the format has fields that numbers are cut to fit (8 characters in NASTRAN).

    Returns
    -------
    float
        Half a unit of the last printed digit, relative; the rounding of a double if a person typed the numbers.

    Notes
    -----
    If all numbers have an exponent and the same number of digits, one scientific format printed them: these digits
    count.
    A narrow field cuts digits, so the shortest number that fills the field counts. In any other mixture the longest
    number counts: general formats drop trailing zeros, and fixed ones lose digits of small numbers.
    """
    sample = numbers if len(numbers) <= 2 * _ENDS else [*numbers[:_ENDS], *numbers[-_ENDS:]]
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
    """True if the last number is cut short, in a file that does not end its last line.

    Programs print all numbers of a matrix with one width and end the last line. So a number that is narrower than all
    others, on a line without an end, was cut. Numbers without exponents vary in width and prove nothing.
    """
    texts = [text.strip().lstrip("+-") for text in numbers[-_ENDS:]]
    before = texts[:-1]
    if not before or not all((match := _PLAIN.fullmatch(text)) and match.group(2) for text in before):
        return False
    return len(texts[-1]) < min(len(text) for text in before)


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


def coordinate_rounding(xyz: NDArray[np.float64]) -> float:
    """Largest rounding of printed coordinates (N, 3), judged on nodes spread over the file."""
    return float(printed_rounding(xyz[:: max(1, len(xyz) // _NODES)]).max(initial=0.0))
