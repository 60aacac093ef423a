"""Numbers with a unit, as people write them.

`Quantity` has one unit (``10 Hz``, ``45 deg``, ``3 mm``), `Compound` a product of units (``120 N*m/rad``).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal, get_args

from cmsreduce.config.found import found_in, instead_of
from cmsreduce.config.located import LARGEST_NUMBER
from cmsreduce.errors import UnitsError, closest
from cmsreduce.model import UnitKind, Units, units_of

__all__ = [
    "Compound",
    "Dimension",
    "ElementFigure",
    "Powers",
    "Quantity",
    "figure_powers",
    "measure",
    "parse_compound",
    "parse_quantity",
    "parse_ratio",
    "powers_of",
]

Dimension = Literal["frequency", "angle", "length", "time"]

EXAMPLES: dict[Dimension, str] = {"frequency": "10 Hz", "angle": "45 deg", "length": "3 mm", "time": "0.01 s"}
"""One well-formed quantity of each dimension, for messages."""

_KIND: dict[Dimension, str] = {
    "frequency": "a frequency",
    "angle": "an angle",
    "length": "a length",
    "time": "a time",
}

# Value of each unit in Hz, rad, m or s.
_UNITS: dict[str, tuple[Dimension, float]] = {
    name: (dimension, value) for dimension in get_args(Dimension) for name, value in units_of(dimension).items()
}

_FORM = re.compile(r"\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:([^\d\s.,+-]\S*)\s*)?")

ElementFigure = Literal["stiffness", "damping", "inertia"]
"""Properties of a joint along each of its motions."""

Powers = tuple[int, int, int]
"""Exponents of length, mass and time; an angle has none."""

_POWERS: dict[UnitKind, Powers] = {
    "force": (1, 1, -2),
    "length": (1, 0, 0),
    "mass": (0, 1, 0),
    "time": (0, 0, 1),
    "angle": (0, 0, 0),
}
_COMPOUND_UNITS: dict[str, tuple[Powers, float]] = {
    name: (powers, value) for kind, powers in _POWERS.items() for name, value in units_of(kind).items()
}
_DIMENSION: dict[tuple[ElementFigure, bool], tuple[Powers, str]] = {
    ("stiffness", True): ((2, 1, -2), "120 N*m/rad"),
    ("stiffness", False): ((0, 1, -2), "5 N/mm"),
    ("damping", True): ((2, 1, -1), "0.4 N*m*s/rad"),
    ("damping", False): ((0, 1, -1), "3 N*s/m"),
    ("inertia", True): ((2, 1, 0), "1e-3 kg*m^2"),
}
_NUMBER = re.compile(r"\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*((?![\d.,]).*)")
_PERCENT = re.compile(r"\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*%\s*")
_FACTOR = re.compile(r"\s*([*·/]?)\s*([A-Za-z]+)\s*(?:(?:\^|\*\*)?\s*([23])|([²³]))?\s*")


@dataclass(frozen=True)
class _Written:
    """A number and its unit or product of units, as written; an empty text where there is none."""

    value: float
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.value!r} {self.unit}" if self.unit else repr(self.value)

    @property
    def plain(self) -> str | float:
        """Value for a file: a text with the unit, or a number where there is none."""
        return str(self) if self.unit else self.value


@dataclass(frozen=True)
class Quantity(_Written):
    """A number with one unit."""

    @property
    def dimension(self) -> Dimension | None:
        """Dimension of the unit; None without a unit."""
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
    """Usual units of a dimension, for a number without a unit."""
    return {"angle": "deg or rad", "frequency": "Hz", "length": "mm", "time": "s"}[dimension]


def parse_quantity(value: object, dimension: Dimension | None = None) -> Quantity:
    """Read a number with or without a unit.

    Parameters
    ----------
    value : int, float, str or Quantity
        As written in the file.
    dimension : {"frequency", "angle", "length", "time"}, optional
        Expected dimension, for the words of an error.

    Raises
    ------
    UnitsError
        If it is not a number, or the unit is unknown.

    Examples
    --------
    >>> parse_quantity("45deg")
    Quantity(value=45.0, unit='deg')
    """
    if isinstance(value, Quantity):
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if not abs(value) <= LARGEST_NUMBER:
            raise UnitsError(f"{value} is not a finite number up to {LARGEST_NUMBER:g}")
        return Quantity(float(value))
    if not isinstance(value, str) or (form := _FORM.fullmatch(value)) is None:
        example = EXAMPLES[dimension] if dimension else f"{EXAMPLES['angle']} or {EXAMPLES['frequency']}"
        raise UnitsError(f"{found_in(value)} is not a number with a unit{instead_of(value, example, unit=True)}")
    if abs(number := float(form[1])) > LARGEST_NUMBER:
        raise UnitsError(f"'{value}' is not a finite number up to {LARGEST_NUMBER:g}")
    return Quantity(number, _unit_named(form[2] or "", value, dimension))


def parse_ratio(value: object) -> object:
    """Read a ratio of damping: a fraction below one, or per cent with their sign.

    Parameters
    ----------
    value : object
        As written in the file. Anything but a number, or a text that ends in ``%``, is returned as it is.

    Raises
    ------
    UnitsError
        If it is one or more without a sign: per cent were meant, or damping beyond the critical one.

    Examples
    --------
    >>> parse_ratio("0.5 %"), parse_ratio(0.005), parse_ratio("150 %")
    (0.005, 0.005, 1.5)
    """
    if isinstance(value, str) and (form := _PERCENT.fullmatch(value)):
        return float(form[1]) / 100
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value >= 1:
        raise UnitsError(
            f"{value:g} is {100 * value:g} %: did you mean {value / 100:g}, which is {value:g} %? If {100 * value:g} % "
            f"is meant, write '{100 * value:g} %'"
        )
    return value


def _unit_named(text: str, written: str, dimension: Dimension | None) -> str:
    """Find a unit; upper and lower case matter only where two units differ in nothing else."""
    if not text or text in _UNITS:
        return text
    alike = [unit for unit in _UNITS if unit.lower() == text.lower()]
    if len(alike) == 1:
        return alike[0]
    if alike:
        raise UnitsError(f"'{written}': write {' or '.join(alike)}, they differ by the case of their letters")
    known = [unit for unit in _UNITS if dimension in (None, _UNITS[unit][0])]
    if dimension and text in _COMPOUND_UNITS:
        raise UnitsError(f"'{written}' is not {_KIND[dimension]}, e.g. {EXAMPLES[dimension]}")
    meant = closest(text, known)
    guess = f", did you mean '{meant}'? Known" if meant else ", known"
    raise UnitsError(f"'{written}': unknown unit '{text}'{guess} are {', '.join(known)}")


def measure(value: object, dimension: Dimension, bare: float | None = None) -> float:
    """Value of a quantity in Hz, rad, m or s.

    Parameters
    ----------
    value : int, float, str or Quantity
        As written in the file.
    dimension : {"frequency", "angle", "length", "time"}
        Expected dimension.
    bare : float, optional
        Factor for a number without a unit; by default only a zero may have no unit.

    Raises
    ------
    UnitsError
        If it is not a number, has no unit where one is needed, or is of another dimension.

    Examples
    --------
    >>> measure("600 rpm", "frequency")
    10.0
    """
    quantity = parse_quantity(value, dimension)
    if bare is not None and not quantity.unit:
        return quantity.value * bare
    return quantity.to_si(dimension)


@dataclass(frozen=True)
class Compound(_Written):
    """A number with a product of units."""

    def figure_in(self, units: Units, figure: ElementFigure, rotation: bool) -> float:
        """Value in a unit system; a number without a unit is in that system and in radians already.

        Parameters
        ----------
        units : Units
            Units of the scene.
        figure : {"stiffness", "damping", "inertia"}
            Property of the joint.
        rotation : bool
            True about an axis, False along it.

        Raises
        ------
        UnitsError
            If the units are of another dimension.
        """
        if not self.unit:
            return self.value
        wanted, example = _DIMENSION[figure, rotation]
        dimension, factor = _product(self.unit)
        if dimension != wanted:
            kind = "about an axis" if rotation else "along an axis"
            raise UnitsError(f"{self} is no {figure} {kind}, e.g. {example}")
        length, mass, time = wanted
        return self.value * factor / (units.length**length * units.mass**mass * units.time**time)

    def number_in(self, units: Units) -> float:
        """Value in a unit system, whatever its dimension; a number without a unit is in that system already."""
        if not self.unit:
            return self.value
        (length, mass, time), factor = _product(self.unit)
        return self.value * factor / (units.length**length * units.mass**mass * units.time**time)


def figure_powers(figure: ElementFigure, rotation: bool) -> Powers | None:
    """Exponents of length, mass and time of a property of a joint; None for one that does not exist."""
    found = _DIMENSION.get((figure, rotation))
    return None if found is None else found[0]


def powers_of(value: Compound) -> Powers | None:
    """Exponents of length, mass and time of a number's unit; None without a unit."""
    return _product(value.unit)[0] if value.unit else None


def parse_compound(value: object) -> Compound:
    """Read a number with or without units.

    Parameters
    ----------
    value : int, float, str or Compound
        As written; ``*``, ``·``, ``/`` or a blank joins factors. A ``/`` divides by the next factor only.

    Raises
    ------
    UnitsError
        If it is not a number, or a unit is unknown.

    Examples
    --------
    >>> parse_compound("120 N*m/rad")
    Compound(value=120.0, unit='N*m/rad')
    """
    if isinstance(value, Compound):
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return Compound(float(value))
    form = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    if form is None or abs(float(form[1])) > LARGEST_NUMBER:
        step = instead_of(value, "120 N*m/rad", unit=True)
        raise UnitsError(f"{found_in(value)} is not a number with units{step}")
    unit = form[2].strip()
    if unit:
        _product(unit)
    return Compound(float(form[1]), unit)


def _product(text: str) -> tuple[Powers, float]:
    """Powers of a product of units, and its value in SI."""
    exponents, factor, at = [0, 0, 0], 1.0, 0
    while at < len(text):
        form = _FACTOR.match(text, at)
        if form is None or (at == 0 and form[1]):
            raise UnitsError(f"'{text}' is no product of units, e.g. N*m/rad")
        sign, name, at = form[1], form[2], form.end()
        if name not in _COMPOUND_UNITS:
            raise UnitsError(f"unknown unit '{name}' in '{text}', known are {', '.join(_COMPOUND_UNITS)}")
        power = int(form[3] or {"²": 2, "³": 3}.get(form[4] or "", 1)) * (-1 if sign == "/" else 1)
        own, worth = _COMPOUND_UNITS[name]
        exponents = [have + power * more for have, more in zip(exponents, own, strict=True)]
        factor *= worth**power
    return (exponents[0], exponents[1], exponents[2]), factor
