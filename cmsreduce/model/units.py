"""Unit systems of bodies and scenes, and the factors between them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from cmsreduce.errors import UnitsError

__all__ = ["SI", "Units"]

_POUND_FORCE = 4.4482216152605  # N, by definition
_INCH, _FOOT = 0.0254, 0.3048
_LENGTH = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": _INCH, "ft": _FOOT}
_MASS = {
    "kg": 1.0,
    "g": 1e-3,
    "t": 1e3,
    "tonne": 1e3,
    "lb": 0.45359237,
    "slug": _POUND_FORCE / _FOOT,
    "slinch": _POUND_FORCE / _INCH,
}
_TIME = {"s": 1.0, "ms": 1e-3}


@dataclass(frozen=True)
class Units:
    """A consistent unit system, by what its units are worth in SI.

    Parameters
    ----------
    name : str
        ``length-mass-time``, such as ``m-kg-s``, ``mm-t-s`` or ``in-slinch-s``.
    length : float
        Metres in one unit of length.
    mass : float
        Kilograms in one unit of mass.
    time : float
        Seconds in one unit of time.
    """

    name: str
    length: float
    mass: float
    time: float

    @classmethod
    def parse(cls, text: str) -> Units:
        """Read a unit system's name.

        Examples
        --------
        >>> Units.parse("mm-t-s").length
        0.001

        Raises
        ------
        UnitsError
            If the text is not ``length-mass-time`` of known units.
        """
        if text.strip().lower() == "si":
            return SI
        parts = re.split(r"[-,\s]+", text.strip())
        tables = (("length", _LENGTH), ("mass", _MASS), ("time", _TIME))
        if len(parts) != 3:
            raise UnitsError(
                f"units '{text}' are not length-mass-time: write SI, m-kg-s, mm-t-s, in-slinch-s or the like"
            )
        values = []
        for part, (what, table) in zip(parts, tables, strict=True):
            if part not in table:
                raise UnitsError(f"units '{text}': unknown {what} '{part}', known are {', '.join(table)}")
            values.append(table[part])
        return cls("-".join(parts), *values)

    @property
    def force(self) -> float:
        """Newtons in one unit of force."""
        return self.mass * self.length / self.time**2

    @property
    def energy(self) -> float:
        """Joules in one unit of energy, also newton-metres in one unit of moment."""
        return self.force * self.length


SI = Units("m-kg-s", 1.0, 1.0, 1.0)
"""Metre, kilogram, second."""
