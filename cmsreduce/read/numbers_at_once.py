"""Many printed numbers at once: a grammar that the text is held against first, then the parser of scipy.

scipy's parser is fast, and it believes what it reads: it drops what follows a number, and reads past the end of a text
that ends inside one. So it gets nothing but words that are numbers, each on a line.
"""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

__all__ = ["INTEGER", "REAL", "numbers_of"]

# Possessive, so that a text of a hundred megabytes is passed over once.
INTEGER = r"[+-]?+\d{1,15}+"
"""Pattern of an integer that is exact as a double."""

_END = r"(?=[\s,]|\Z)"
REAL = rf"[+-]?+(?:\d++\.?+\d*+|\.\d++|(?i:nan|inf(?:inity)?+){_END})(?:[EeDd][+-]?+\d++|[+-]\d++|{_END})"
"""Pattern of a real number; Fortran writes D for E, and no letter before three digits of an exponent."""

# Bytes of a text that are taken together: they stay in the cache, and copies of them are small.
_AT_ONCE = 4_000_000
# Between words, and the letter of an exponent.
_PLAIN = bytes.maketrans(b" \t\r,Dd", b"\n\n\n\nEE")
_NEWLINE, _PLUS, _POINT, _NINE, _LETTER = b"\n+.9E"
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
    from scipy.io import mmread

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
    if not count:
        return np.empty(0)
    head = b"%%%%MatrixMarket matrix array real general\n%d 1\n" % count
    return np.asarray(mmread(io.BytesIO(head + words.tobytes())), dtype=np.float64).ravel()
