"""Numbers with a unit, as people write them: ``10 Hz``, ``45 deg``, ``3 mm``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from cmsreduce.errors import UnitsError
from cmsreduce.model.units import Units

__all__ = ["Dimension", "Quantity", "measure", "parse_quantity"]

Dimension = Literal["frequency", "angle", "length", "time"]

EXAMPLES: dict[Dimension, str] = {"frequency": "10 Hz", "angle": "45 deg", "length": "3 mm", "time": "0.01 s"}
"""One well-formed quantity of each dimension, for messages."""

_KIND: dict[Dimension, str] = {
    "frequency": "a frequency",
    "angle": "an angle",
    "length": "a length",
    "time": "a time",
}

# Worth of each unit in Hz, rad, m or s.
_UNITS: dict[str, tuple[Dimension, float]] = {
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
    "in": ("length", 0.0254),
    "ft": ("length", 0.3048),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "min": ("time", 60.0),
    "h": ("time", 3600.0),
}

_FORM = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.+-][^\s]*)?\s*")


@dataclass(frozen=True)
class Quantity:
    """A number and its unit, as written.

    Parameters
    ----------
    value : float
        The number.
    unit : str
        Unit, empty where none was written.
    """

    value: float
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.value!r} {self.unit}" if self.unit else repr(self.value)

    @property
    def dimension(self) -> Dimension | None:
        """What the unit measures; None without a unit."""
        return _UNITS[self.unit][0] if self.unit else None

    def to_si(self, dimension: Dimension) -> float:
        """Value in Hz, rad, m or s; a zero needs no unit.

        Raises
        ------
        UnitsError
            If the unit is missing, or of another dimension.
        """
        if not self.unit:
            if self.value == 0:
                return 0.0
            raise UnitsError(
                f"{self.value:g} has no unit, {_KIND[dimension]} is expected: write {_usual(dimension)} after it, "
                f"e.g. {EXAMPLES[dimension]}"
            )
        own, factor = _UNITS[self.unit]
        if own != dimension:
            raise UnitsError(
                f"{self.value:g} {self.unit} is {_KIND[own]}, {_KIND[dimension]} is expected, "
                f"e.g. {EXAMPLES[dimension]}"
            )
        return self.value * factor

    def length_in(self, units: Units) -> float:
        """Length in a unit system; a number without a unit is in that system already.

        Raises
        ------
        UnitsError
            If the unit is not one of length.
        """
        return self.to_si("length") / units.length if self.unit else self.value


def _usual(dimension: Dimension) -> str:
    """Units to offer for a number without one."""
    return {"angle": "deg or rad", "frequency": "Hz", "length": "mm", "time": "s"}[dimension]


def parse_quantity(value: object) -> Quantity:
    """Read a number with or without a unit.

    Parameters
    ----------
    value : int, float, str or Quantity
        What was written.

    Raises
    ------
    UnitsError
        If it is no number, or the unit is unknown.

    Examples
    --------
    >>> parse_quantity("45deg")
    Quantity(value=45.0, unit='deg')
    """
    if isinstance(value, Quantity):
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if not math.isfinite(value):
            raise UnitsError(f"{value} is not a finite number")
        return Quantity(float(value))
    form = _FORM.fullmatch(value) if isinstance(value, str) else None
    if form is None:
        raise UnitsError(f"'{value}' is not a number with a unit, e.g. {EXAMPLES['angle']} or {EXAMPLES['frequency']}")
    number = float(form[1])
    if not math.isfinite(number):
        raise UnitsError(f"'{value}' is not a finite number")
    return Quantity(number, _unit_named(form[2] or "", str(value)))


def _unit_named(text: str, written: str) -> str:
    """Find the unit; the case of its letters counts only where two units differ by nothing else."""
    if not text or text in _UNITS:
        return text
    alike = [unit for unit in _UNITS if unit.lower() == text.lower()]
    if len(alike) == 1:
        return alike[0]
    if alike:
        raise UnitsError(f"'{written}': write {' or '.join(alike)}, they differ by the case of their letters")
    known = ", ".join(_UNITS)
    raise UnitsError(f"'{written}': unknown unit '{text}', known are {known}")


def measure(value: object, dimension: Dimension, bare: float | None = None) -> float:
    """Value of a quantity in Hz, rad, m or s.

    Parameters
    ----------
    value : int, float, str or Quantity
        What was written.
    dimension : {"frequency", "angle", "length", "time"}
        What is wanted.
    bare : float, optional
        Worth of a number without a unit; by default only a zero may go without.

    Raises
    ------
    UnitsError
        If it is no number, has no unit where one is needed, or is of another dimension.

    Examples
    --------
    >>> measure("600 rpm", "frequency")
    10.0
    """
    quantity = parse_quantity(value)
    if bare is not None and not quantity.unit:
        return quantity.value * bare
    return quantity.to_si(dimension)
