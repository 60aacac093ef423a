"""Many printed numbers at once: words of a text, and fields of characters.

Words are held against a grammar first, then scipy's parser takes them. It is fast, and it believes what it reads: it
drops what follows a number, and reads past the end of a text that ends inside one. So it gets nothing but words that
are numbers, each on a line.

Fields are read column of characters after column, all fields together, by a table of states. A number of up to 15
digits with a small exponent is a quotient or product of two exact numbers, so that it is rounded once. Fields with
other numbers, and what is no number, take the way of words.
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


# Kinds of characters in a field, and states behind some of them.
_GAP, _UPWARD, _DOWNWARD, _DIGIT, _DOT, _EXPONENT, _OTHER = range(7)
_EMPTY, _SIGN, _MINUS, _WHOLE, _STOP, _BARE_STOP, _FRACTION, _MARK, _UP, _DOWN, _POWER, _DONE, _NONE = range(13)
_COMPLETE = np.isin(np.arange(_NONE + 1), [_WHOLE, _STOP, _FRACTION, _POWER, _DONE])
_CHARACTERS = {_GAP: b" ", _UPWARD: b"+", _DOWNWARD: b"-", _DIGIT: b"0123456789", _DOT: b".", _EXPONENT: b"EeDd"}
_KINDS = bytes(next((kind for kind, of in _CHARACTERS.items() if code in of), _OTHER) for code in range(256))
_KIND_BITS = 3
_MOST_DIGITS = 15
_POWERS = 10.0 ** np.arange(23)  # powers of ten that are doubles
_FIELDS_AT_ONCE = 16_384  # they stay in the cache


class _Grammar:
    """The numbers that fields may hold, twice: as states, and as a pattern.

    Parameters
    ----------
    pattern : str
        ``REAL`` or ``INTEGER``.
    digits : int, optional
        Digits that a number has at most.
    steps : mapping of state to mapping of kind to state
        Following states; where there is none, the field is no number.
    """

    def __init__(self, pattern: str, digits: int | None, steps: dict[int, dict[int, int]]) -> None:
        self.fields, self.digits = re.compile(f"(?: *+{pattern} *+\n)*+".encode()), digits
        table = bytearray([_NONE]) * 256
        for state, following in steps.items():
            for kind, after in following.items():
                table[state << _KIND_BITS | kind] = after
        self._table = bytes(table)

    def step(self, state: NDArray[np.uint8], kind: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """States behind one more character of each field."""
        return np.frombuffer((state << _KIND_BITS | kind).tobytes().translate(self._table), dtype=np.uint8)


_BEHIND_DIGITS = {_GAP: _DONE, _UPWARD: _UP, _DOWNWARD: _DOWN, _EXPONENT: _MARK}
_REALS = _Grammar(
    REAL,
    None,
    {
        _EMPTY: {_GAP: _EMPTY, _UPWARD: _SIGN, _DOWNWARD: _MINUS, _DIGIT: _WHOLE, _DOT: _BARE_STOP},
        _SIGN: {_DIGIT: _WHOLE, _DOT: _BARE_STOP},
        _MINUS: {_DIGIT: _WHOLE, _DOT: _BARE_STOP},
        _WHOLE: {_DIGIT: _WHOLE, _DOT: _STOP, **_BEHIND_DIGITS},
        _STOP: {_DIGIT: _FRACTION, **_BEHIND_DIGITS},
        _BARE_STOP: {_DIGIT: _FRACTION},
        _FRACTION: {_DIGIT: _FRACTION, **_BEHIND_DIGITS},
        _MARK: {_DIGIT: _POWER, _UPWARD: _UP, _DOWNWARD: _DOWN},
        _UP: {_DIGIT: _POWER},
        _DOWN: {_DIGIT: _POWER},
        _POWER: {_DIGIT: _POWER, _GAP: _DONE},
        _DONE: {_GAP: _DONE},
    },
)
_INTEGERS = _Grammar(
    INTEGER,
    _MOST_DIGITS,
    {
        _EMPTY: {_GAP: _EMPTY, _UPWARD: _SIGN, _DOWNWARD: _MINUS, _DIGIT: _WHOLE},
        _SIGN: {_DIGIT: _WHOLE},
        _MINUS: {_DIGIT: _WHOLE},
        _WHOLE: {_DIGIT: _WHOLE, _GAP: _DONE},
        _DONE: {_GAP: _DONE},
    },
)


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
    return _values(fields, _REALS)


def integers_of(fields: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Values of fields of characters as integers of up to 15 digits; parameters and results as of `reals_of`."""
    values, sure = _values(fields, _INTEGERS)
    return values.astype(np.int64), sure


def _values(fields: NDArray[np.uint8], grammar: _Grammar) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    values, sure, empty = np.zeros(len(fields)), np.zeros(len(fields), dtype=bool), np.zeros(len(fields), dtype=bool)
    for start in range(0, len(fields), _FIELDS_AT_ONCE):
        some = slice(start, start + _FIELDS_AT_ONCE)
        values[some], sure[some], empty[some] = _short_numbers(fields[some], grammar)
        # One program prints all numbers alike: where it prints more digits, the rest is not tried.
        if 2 * np.count_nonzero(sure[some] | empty[some]) < sure[some].size:
            break
    others = np.flatnonzero(~(sure | empty))
    if others.size:
        values[others], sure[others] = _words_of_fields(fields[others], grammar)
    return values, sure


def _short_numbers(
    fields: NDArray[np.uint8], grammar: _Grammar
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Values of the fields that hold a number of few digits, which these are, and which fields are empty."""
    count, width = fields.shape
    characters = np.ascontiguousarray(fields.T)
    kinds = np.frombuffer(characters.tobytes().translate(_KINDS), dtype=np.uint8).reshape(width, count)
    state = np.full(count, _EMPTY, dtype=np.uint8)
    digits, decimals, power = np.zeros(count), np.zeros(count), np.zeros(count)
    negative, down = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for column, kind in zip(characters, kinds, strict=True):
        state = grammar.step(state, kind)
        met = np.flatnonzero(np.bincount(state, minlength=_NONE + 1)).tolist()
        for one in met:
            # All fields of a program are often in one state.
            at = slice(None) if len(met) == 1 else state == one
            if one in (_WHOLE, _FRACTION):
                digits[at] = 10 * digits[at] + (column[at] - _ZERO)
                decimals[at] += one == _FRACTION
            elif one == _POWER:
                power[at] = 10 * power[at] + (column[at] - _ZERO)
            elif one == _MINUS:
                negative[at] = True
            elif one == _DOWN:
                down[at] = True
    shift = np.where(down, -power, power) - decimals
    sure = _COMPLETE[state] & (digits < 10.0**_MOST_DIGITS) & (abs(shift) < _POWERS.size)
    if grammar.digits is not None:
        sure &= np.count_nonzero(kinds == _DIGIT, axis=0) <= grammar.digits
    digits, shift = np.where(sure, digits, 0.0), np.where(sure, shift, 0.0).astype(np.int64)
    values = np.where(shift < 0, digits / _POWERS[abs(shift)], digits * _POWERS[abs(shift)])
    return np.where(negative & sure, -values, values), sure, state == _EMPTY


def _words_of_fields(fields: NDArray[np.uint8], grammar: _Grammar) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Values of fields whose texts the parser takes as words; parameters and results as of `reals_of`."""
    count, width = fields.shape
    lines = np.full((count, width + 1), _NEWLINE, dtype=np.uint8)
    lines[:, :-1] = fields
    sure = (fields != _BLANK).any(axis=1)
    lines[~sure, 0] = _ZERO
    at = 0
    while (found := grammar.fields.match(lines.data, at)) is not None and found.end() < lines.size:
        # Before Python 3.11.5 the match may end inside the line that does not fit.
        wrong = found.end() // (width + 1)
        sure[wrong] = False
        lines[wrong] = _BLANK
        lines[wrong, [0, -1]] = _ZERO, _NEWLINE
        at = (wrong + 1) * (width + 1)
    return numbers_of(lines.tobytes()), sure
