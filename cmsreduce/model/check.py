"""A figure, the limit it must meet, and whether it does."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Check"]


@dataclass(frozen=True)
class Check:
    """One check.

    Parameters
    ----------
    name : str
        What was checked.
    value : float
        Measured.
    limit : float
        Largest value that passes.
    """

    name: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether the value meets the limit; a value that is no number does not."""
        return bool(self.value <= self.limit)
