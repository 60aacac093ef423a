"""What a misspelt word was probably meant to be."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["closest", "not_among"]

# Half of the letters in place: lower and unrelated words are offered.
_LIKENESS = 0.6
# Letters from which a word may be the beginning of the one that is meant.
_STEM = 3


def closest(word: str, known: Iterable[str]) -> str | None:
    """Known word most like another, whatever the case of its letters; None if there is none.

    Examples
    --------
    >>> closest("Balanse", ["balance", "reduce"])
    'balance'
    """
    by_lower = {name.lower(): name for name in known}
    begun = [name for lower, name in by_lower.items() if len(word) >= _STEM and lower.startswith(word.lower())]
    if len(begun) == 1:
        return begun[0]
    found = get_close_matches(word.lower(), by_lower, n=1, cutoff=_LIKENESS)
    return by_lower[found[0]] if found else None


def not_among(what: str, word: str, known: Iterable[str]) -> str:
    """Say that there is no such thing, what was probably meant, and what there is.

    Examples
    --------
    >>> not_among("joint", "spn", ["spin", "cone"])
    "there is no joint 'spn', did you mean 'spin'? There are: spin, cone"
    """
    names = list(known)
    meant = closest(word, names)
    guess = f", did you mean '{meant}'?" if meant else "."
    return f"there is no {what} '{word}'{guess} There are: {', '.join(names) or 'none'}"
