"""Listeners of a run: what it tells while it works."""

from __future__ import annotations

from typing import Protocol

__all__ = ["Progress", "Silent"]


class Progress(Protocol):
    """Listener of a run, such as the progress bar of the command line."""

    def stage(self, stage: str, what: str) -> None:
        """Begin a piece of work, such as ``reduce rotor``."""

    def reused(self, stage: str, what: str) -> None:
        """Report that a finished stage was found and is not run again."""

    def advance(self, done: int, total: int) -> None:
        """Report the progress of the current piece of work."""

    def note(self, text: str) -> None:
        """Report something the reader must know."""


class Silent:
    """A listener that prints nothing."""

    def stage(self, stage: str, what: str) -> None:
        """Ignore."""

    def reused(self, stage: str, what: str) -> None:
        """Ignore."""

    def advance(self, done: int, total: int) -> None:
        """Ignore."""

    def note(self, text: str) -> None:
        """Ignore."""
