"""Many printed numbers at once: a grammar that the text is held against first, then the parser of scipy.

scipy's parser is fast, and it believes what it reads: it drops what follows a number, and reads past the end of a text
that ends inside one. So it gets nothing but words that are numbers, each on a line.
"""

from __future__ import annotations

import io
import re

import numpy as np
from numpy.typing import NDArray

__all__ = ["INTEGER", "REAL", "integers_of", "numbers_of", "reals_of"]

# Possessive, so that a text of a hundred megabytes is passed over once.
INTEGER = r"[+-]?+\d{1,15}+"
"""Pattern of an integer that is exact as a double."""

_END = r"(?=[\s,]|\Z)"
REAL = rf"[+-]?+(?:\d++\.?+\d*+|\.\d++|(?i:nan|inf(?:inity)?+){_END})(?:[EeDd][+-]?+\d++|[+-]\d++|{_END})"
"""Pattern of a real number; Fortran writes D for E, and no letter before three digits of an exponent."""

_FIELDS = {pattern: re.compile(f"(?: *+{pattern} *+\n)*+".encode()) for pattern in (INTEGER, REAL)}

# Up to this many words Python's own numbers take less time than the parser takes to load.
_FEW = 20_000
# Bytes of a text that are taken together: they stay in the cache, and copies of them are small.
_AT_ONCE = 4_000_000
# Between words, and the letter of an exponent.
_PLAIN = bytes.maketrans(b" \t\r,Dd", b"\n\n\n\nEE")
_NEWLINE, _BLANK, _PLUS, _POINT, _ZERO, _NINE, _LETTER = b"\n +.09E"
# Bits that tell "+" from "-"; both have all others.
_EITHER_SIGN = ord("+") ^ ord("-")


def numbers_of(text: bytes) -> NDArray[np.float64]:
    r"""Values of all words of a text, each the double next to what is printed.

    Parameters
    ----------
    text : bytes
        Lines of words that match ``REAL`` or ``INTEGER``, separated by blanks and commas. The caller has made sure of
        that.

    Returns
    -------
    (words,) float64

    Examples
    --------
    >>> numbers_of(b"1 -2.5, +3D+1 1.5-300\n").tolist()
    [1.0, -2.5, 30.0, 1.5e-300]
    """
    found, start = [np.empty(0)], 0
    while start < len(text):
        end = text.find(b"\n", start + _AT_ONCE) + 1 or len(text)
        found.append(_words(text[start:end]))
        start = end
    return np.concatenate(found)


def _words(text: bytes) -> NDArray[np.float64]:
    """Values of the words of a part of a text."""
    words = np.frombuffer(b"\n" + text.translate(_PLAIN) + b"\n", dtype=np.uint8)
    signs = np.flatnonzero((words | _EITHER_SIGN) == (_PLUS | _EITHER_SIGN))
    before = words[signs - 1]
    # scipy knows no plus before a number.
    plus = signs[(words[signs] == _PLUS) & (before == _NEWLINE)]
    if plus.size:
        words = words.copy()
        words[plus] = _NEWLINE
    bare = signs[(before >= _POINT) & (before <= _NINE)]
    if bare.size:
        words = np.insert(words, bare, _LETTER)
    count = np.count_nonzero((words[1:] != _NEWLINE) & (words[:-1] == _NEWLINE))
    if count <= _FEW:
        return np.array([float(word) for word in words.tobytes().split()])
    from scipy.io import mmread

    head = b"%%%%MatrixMarket matrix array real general\n%d 1\n" % count
    return np.asarray(mmread(io.BytesIO(head + words.tobytes())), dtype=np.float64).ravel()


def reals_of(fields: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Values of fields of characters as real numbers.

    Parameters
    ----------
    fields : (n, width) uint8
        Characters of each field.

    Returns
    -------
    values : (n,) float64
        Each the double next to what is printed; zero where the field is no number.
    sure : (n,) bool
        False where the field is no number, or empty.
    """
    return _values(fields, REAL)


def integers_of(fields: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Values of fields of characters as integers of up to 15 digits; parameters and results as of `reals_of`."""
    values, sure = _values(fields, INTEGER)
    return values.astype(np.int64), sure


def _values(fields: NDArray[np.uint8], pattern: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    count, width = fields.shape
    lines = np.full((count, width + 1), _NEWLINE, dtype=np.uint8)
    lines[:, :-1] = fields
    sure = (fields != _BLANK).any(axis=1)
    lines[~sure, 0] = _ZERO
    at = 0
    while (found := _FIELDS[pattern].match(lines.data, at)) is not None and found.end() < lines.size:
        wrong = found.end() // (width + 1)
        sure[wrong] = False
        lines[wrong] = _BLANK
        lines[wrong, [0, -1]] = _ZERO, _NEWLINE
        at = found.end() + width + 1
    return numbers_of(lines.tobytes()), sure
