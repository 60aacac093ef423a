"""A figure, the limit it must meet, and whether it does.

A check with what it is of, as continuous integration reports it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = [
    "Check",
    "Finding",
]


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


@dataclass(frozen=True)
class Finding:
    """One line of a check of a run or of a component.

    Parameters
    ----------
    subject : str
        Component it is of; empty for the run as a whole.
    check : Check
        Figure and limit; a limit of infinity says that the figure is only shown.
    note : str
        Where the figure was found, or what changed, in words.
    """

    subject: str
    check: Check
    note: str = ""

    @property
    def name(self) -> str:
        """Component and figure: ``rotor: orthogonality in M``."""
        return f"{self.subject}: {self.check.name}" if self.subject else self.check.name

    @property
    def judged(self) -> bool:
        """Whether there is a limit to meet."""
        return not math.isinf(self.check.limit)

    @property
    def passed(self) -> bool:
        """Whether the limit is met; what has none is not judged, and passes."""
        return self.check.passed or not self.judged

    @property
    def verdict(self) -> str:
        """``pass``, ``FAIL`` or, without a limit, ``info``."""
        if not self.judged:
            return "info"
        return "pass" if self.passed else "FAIL"
