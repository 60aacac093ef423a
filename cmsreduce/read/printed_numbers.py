"""Numbers printed in text: their values, their rounding, and a test for a last number that is cut short."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.labelled_matrix import DOUBLE

__all__ = [
    "INTEGER",
    "coordinate_rounding",
    "decimals",
    "digits_of",
    "number_of",
    "printed_rounding",
    "real_number",
    "rounding_of_digits",
    "rounding_of_printed",
    "stops_in_a_number",
    "whole_number",
]

INTEGER = re.compile(r"[+-]?0*\d{1,15}\Z")
"""A whole number with no more digits than an id has: ids become keys of dofs in 64-bit integers."""

# A digit belongs to one part only: else thousands of digits would be divided in every way.
_NASTRAN_REAL = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+))(?:(?:[ED]|(?=[+-]))([+-]?\d+))?\Z")
_PLAIN = re.compile(r"[+-]?(\d+(?:\.\d*)?|\.\d+)([EeDd][+-]?\d+|[+-]\d+)?")

# Solvers print at least this many digits in scientific notation, all numbers alike; shorter ones are typed and exact.
_FEWEST_ALIKE = 4
# Shortest output of a general format such as %g; shorter numbers in a mixture are typed and exact.
_FEWEST_MIXED = 6
# Numbers examined at each end of a file: a program prints all of a matrix with one format.
_ENDS = 1000
# Coordinates examined, spread over a file: one program prints all of them.
_COORDINATES = 6000
# A number of up to this many digits (600., 0.375, 12.5) was typed, and is exact; a longer one is rounded at its last
# digit. A narrow field leaves no room for more digits than it shows.
_EXACT_DIGITS, _EXACT_IN_FIELD = 5, 3
# Bytes of a file of a library in which its coordinates are sought as printed, and numbers with a decimal point.
_SEARCHED = 1 << 20
_DECIMAL = re.compile(r"[+-]?(?:\d+\.\d*|\.\d+)(?:[EeDd][+-]?\d+)?")


def real_number(text: str) -> float | None:
    """Value of a NASTRAN or Fortran real; None if the text is no number.

    Examples
    --------
    >>> real_number("1.5-3"), real_number("1.+7"), real_number("-.25d2"), real_number("THRU")
    (0.0015, 10000000.0, -25.0, None)
    """
    found = _NASTRAN_REAL.match(text.strip().upper())
    return None if found is None else float(f"{found[1]}E{found[2] or 0}")


def whole_number(text: str) -> int | None:
    """Whole number of a field; None for other text.

    Examples
    --------
    >>> whole_number("0012"), whole_number("1.0"), whole_number("9" * 5000)
    (12, None, None)
    """
    return int(text) if INTEGER.match(text) else None


def number_of(text: str) -> float:
    """Value of a number whose exponent may have the letter of Fortran; remarks may follow it.

    Raises
    ------
    ValueError
        If the text begins with no number, or with one that is not finite.

    Examples
    --------
    >>> number_of("-.25d2"), number_of(" 3 kg")
    (-25.0, 3.0)
    """
    word = (text.split() or [""])[0]
    if not math.isfinite(number := float(word.replace("D", "E").replace("d", "e"))):
        raise ValueError(f"'{word[:40]}' is not finite")
    return number


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


def printed_rounding(texts: Sequence[str], field: int | None = None) -> NDArray[np.float64]:
    """Half a unit in the last printed place of each number, zero for short numbers.

    Parameters
    ----------
    texts : sequence of str
        Numbers as printed. Trailing zeros are digits: 0.300000 is known to 5e-7, 0.3 is exact.
    field : int, optional
        Width of the fields; a number that fills its field was cut to fit.

    Returns
    -------
    (k,) float64

    Examples
    --------
    >>> printed_rounding(["600.", "0.333333", "1234567.", "3.000000E+01"]).tolist()
    [0.0, 5e-07, 0.5, 5e-06]
    >>> printed_rounding([".0012345", "0.001234", "0.00125"], field=8).tolist()
    [5e-08, 5e-07, 0.0]
    """
    out = np.zeros(len(texts))
    for k, text in enumerate(texts):
        fills = field is not None and len(text.strip()) == field
        if digits_of(text) > (_EXACT_IN_FIELD if fills else _EXACT_DIGITS):
            mantissa, exponent = _NASTRAN_REAL.match(text.strip().upper()).groups()  # type: ignore[union-attr]
            out[k] = 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return out


def coordinate_rounding(texts: Sequence[str]) -> float:
    """Largest rounding of printed coordinates.

    Numbers spread over the file are examined, because one program prints all of them. Coordinates without printed
    digits of their own are given by `decimals`.
    """
    # No multiple of three, which would leave out two of x, y and z.
    step = len(texts) // _COORDINATES
    return float(printed_rounding(texts[:: max(1, step + (step % 3 == 0))]).max(initial=0.0))


def decimals(path: Path, xyz: NDArray[np.float64]) -> list[str]:
    """Coordinates (N, 3) that a library read from a file, as the file prints them.

    Parameters
    ----------
    path : Path
        The file.
    xyz : (N, 3) float64
        Coordinates.

    Returns
    -------
    list of str
        Texts of nodes spread over the file; of a binary file, and of nodes that are not printed as three numbers in a
        row, the shortest decimals that read back as the numbers.
    """
    wanted = xyz[:: max(1, 3 * len(xyz) // _COORDINATES)].tolist()
    printed: dict[tuple[float, ...], tuple[str, ...]] = {}
    head = path.read_bytes()[:_SEARCHED] if path.is_file() else b""
    words = [] if b"\0" in head else _DECIMAL.findall(head.decode("latin-1"))
    values = [real_number(word) for word in words]
    sought = {tuple(place) for place in wanted}
    for at in range(len(words) - 2):
        if (place := tuple(values[at : at + 3])) in sought:
            printed[place] = tuple(words[at : at + 3])  # type: ignore[index]
    return [text for place in wanted for text in printed.get(tuple(place), map(repr, place))]
