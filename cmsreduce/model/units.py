"""Table of units, and the unit systems of bodies and scenes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from cmsreduce.errors import UnitsError

__all__ = ["SI", "UNITS", "UnitKind", "Units", "units_of"]

UnitKind = Literal["frequency", "angle", "length", "time", "mass", "force", "torque"]
"""Quantity that a unit measures."""

_POUND, _INCH, _FOOT = 0.45359237, 0.0254, 0.3048  # kg and m, by definition
_POUND_FORCE = 4.4482216152605  # N, by definition
# Units of time of a unit system; matrices in minutes are a mistake.
_SYSTEM_TIMES = ("s", "ms")

UNITS: Mapping[str, tuple[UnitKind, float]] = {
    "Hz": ("frequency", 1.0),
    "mHz": ("frequency", 1e-3),
    "kHz": ("frequency", 1e3),
    "MHz": ("frequency", 1e6),
    "rpm": ("frequency", 1 / 60),
    "rad/s": ("frequency", 1 / (2 * math.pi)),
    "deg/s": ("frequency", 1 / 360),
    "rev/s": ("frequency", 1.0),
    "deg": ("angle", math.pi / 180),
    "degree": ("angle", math.pi / 180),
    "degrees": ("angle", math.pi / 180),
    "°": ("angle", math.pi / 180),
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "rev": ("angle", 2 * math.pi),
    "arcmin": ("angle", math.pi / 180 / 60),
    "arcsec": ("angle", math.pi / 180 / 3600),
    "m": ("length", 1.0),
    "dm": ("length", 0.1),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "um": ("length", 1e-6),
    "km": ("length", 1e3),
    "in": ("length", _INCH),
    "ft": ("length", _FOOT),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "min": ("time", 60.0),
    "h": ("time", 3600.0),
    "kg": ("mass", 1.0),
    "g": ("mass", 1e-3),
    "t": ("mass", 1e3),
    "tonne": ("mass", 1e3),
    "lb": ("mass", _POUND),
    "slug": ("mass", _POUND_FORCE / _FOOT),
    "slinch": ("mass", _POUND_FORCE / _INCH),
    "N": ("force", 1.0),
    "mN": ("force", 1e-3),
    "kN": ("force", 1e3),
    "MN": ("force", 1e6),
    "lbf": ("force", _POUND_FORCE),
    "Nm": ("torque", 1.0),
    "mNm": ("torque", 1e-3),
    "kNm": ("torque", 1e3),
    "Nmm": ("torque", 1e-3),
}
"""Kind of every unit that can be written, and its value in Hz, rad, m, s, kg, N or N m."""


def units_of(*kinds: UnitKind) -> dict[str, float]:
    """Values in SI of the units of some kinds, in the order of the table.

    Examples
    --------
    >>> units_of("mass")["t"]
    1000.0
    """
    return {name: value for name, (kind, value) in UNITS.items() if kind in kinds}


@dataclass(frozen=True)
class Units:
    """A consistent unit system, given by the value of its units in SI.

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
        time = {name: UNITS[name][1] for name in _SYSTEM_TIMES}
        tables = (("length", units_of("length")), ("mass", units_of("mass")), ("time", time))
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

    @property
    def length_name(self) -> str:
        """Name of the unit of length."""
        return self.name.split("-")[0]

    @property
    def force_name(self) -> str:
        """Name of the unit of force, made of the other units if it has none of its own.

        Examples
        --------
        >>> [Units.parse(each).force_name for each in ("SI", "mm-t-s", "in-slinch-s", "mm-kg-s", "cm-kg-s")]
        ['N', 'N', 'lbf', 'mN', 'kg cm/s²']
        """
        known = units_of("force")
        length, mass, time = self.name.split("-")
        return next((name for name in known if math.isclose(known[name], self.force)), f"{mass} {length}/{time}²")

    @property
    def moment_name(self) -> str:
        """Name of the unit of moment: ``N m``."""
        return f"{self.force_name} {self.length_name}"


SI = Units("m-kg-s", 1.0, 1.0, 1.0)
"""Metre, kilogram, second."""
