"""All exceptions of the package, and words for unknown names. A message gives fault, place, size and remedy."""

import os
import re
import stat
from collections.abc import Iterable
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

__all__ = [
    "CmsReduceError",
    "ConfigError",
    "ConstraintError",
    "DampingError",
    "DofMapError",
    "FloatingFrameError",
    "MatrixError",
    "ReadError",
    "SceneError",
    "SimulationError",
    "SingularInterfaceError",
    "StageError",
    "UnitsError",
    "WriteError",
    "closest",
    "is_device",
    "not_among",
    "optional_library",
    "refuse_device",
    "refuse_unreadable",
]

# At a lower similarity, unrelated words are suggested.
_SIMILARITY = 0.6
# A word of at least this many letters may be the beginning of a known word.
_STEM = 3
# Longer than the path of any file that is likely, and how much of such a word is shown.
_LONG, _SHOWN = re.compile(r"\S{1025,}"), 40


class CmsReduceError(Exception):
    """Base of every error that the user can correct; the command line prints it and exits with 2."""

    def __str__(self) -> str:
        """The message; of a word of a damaged file that would hide all others, the beginning alone."""
        return _LONG.sub(lambda word: f"{word[0][:_SHOWN]}...", super().__str__())


class ConfigError(CmsReduceError):
    """A pipeline file that does not follow the grammar."""


class ReadError(CmsReduceError):
    """A file that is missing, truncated, of an unknown format, or without the data needed."""


class MatrixError(CmsReduceError):
    """A matrix that is not finite, not symmetric, indefinite, or of the wrong size."""


class DofMapError(CmsReduceError):
    """Rows of a matrix that do not belong to their dofs."""


class UnitsError(CmsReduceError):
    """Units that are unknown, of the wrong dimension, or inconsistent."""


class SceneError(CmsReduceError):
    """A joint, actuator, sensor or angle that does not fit the bodies."""


class ConstraintError(CmsReduceError):
    """Joints that constrain the same motion twice."""


class SingularInterfaceError(CmsReduceError):
    """An interface that leaves a rigid motion of the body free where the mode set needs it held."""


class FloatingFrameError(CmsReduceError):
    """A floating frame that the motions of a body do not determine."""


class SimulationError(CmsReduceError):
    """A motion that cannot be integrated in time, or grows without bound."""


class DampingError(CmsReduceError):
    """Damping that is missing or not positive where the method needs it."""


class StageError(CmsReduceError):
    """A stage that was started before the stages that it needs."""


class WriteError(CmsReduceError):
    """A result that cannot be written to its place."""


def closest(word: str, known: Iterable[str]) -> str | None:
    """Known word most similar to another, in upper or lower case; None if none is similar.

    Examples
    --------
    >>> closest("Balanse", ["balance", "reduce"])
    'balance'
    """
    by_lower = {name.lower(): name for name in known}
    begun = [name for lower, name in by_lower.items() if len(word) >= _STEM and lower.startswith(word.lower())]
    if len(begun) == 1:
        return begun[0]
    found = get_close_matches(word.lower(), by_lower, n=1, cutoff=_SIMILARITY)
    return by_lower[found[0]] if found else None


def not_among(what: str, word: str, known: Iterable[str]) -> str:
    """Message that a name is unknown, with the most similar name and all known ones.

    Examples
    --------
    >>> not_among("joint", "spn", ["spin", "cone"])
    "there is no joint 'spn', did you mean 'spin'? There are: spin, cone"
    """
    names = list(known)
    meant = closest(word, names)
    guess = f", did you mean '{meant}'?" if meant else "."
    return f"there is no {what} '{word}'{guess} There are: {', '.join(names) or 'none'}"


def optional_library(module: str, package: str, use: str) -> Any:
    """Import a library that the core of the program does without.

    Parameters
    ----------
    module : str
        Name of the module.
    package : str
        Name that pip installs it by.
    use : str
        What needs it, in the plural: ``plots in Python``.

    Raises
    ------
    CmsReduceError
        If it is not installed; the message says how to install it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        if (error.name or "").partition(".")[0] != module.partition(".")[0]:
            raise
        raise CmsReduceError(
            f"{use} need the library {package}, which is not installed: pip install {package}"
        ) from error


def is_device(path: Path) -> bool:
    """True for a device or a pipe; by one look, since another process may make or remove a file between two."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def refuse_device(path: Path) -> None:
    """Refuse a device or a pipe in the place of a file to read: its end may never come.

    Raises
    ------
    ReadError
        If the path is one.
    """
    if is_device(path):
        raise ReadError(f"{path}: is a device or a pipe, not a file; write its content to a file")


def refuse_unreadable(path: Path) -> None:
    """Refuse a file that this user may not read; to libraries and by its marks it looks damaged or foreign.

    Raises
    ------
    ReadError
        If it is one.
    """
    if path.exists() and not os.access(path, os.R_OK):
        raise ReadError(f"{path}: you have no permission to read this file; ask its owner for it (chmod +r)")
