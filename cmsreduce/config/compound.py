"""Quantities of joints with compound units: ``120 N*m/rad``, ``0.4 N*m*s/rad``, ``1e-3 kg*m^2``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from cmsreduce.errors import UnitsError
from cmsreduce.model.units import Units

__all__ = ["Compound", "ElementFigure", "parse_compound"]

ElementFigure = Literal["stiffness", "damping", "inertia"]
"""What a joint's element has one of for each motion."""

Dimension = tuple[int, int, int]
"""Exponents of length, mass and time; an angle has none."""

_FORCE: Dimension = (1, 1, -2)
_POUND_FORCE = 4.4482216152605  # N, by definition
_POUND = 0.45359237  # kg, by definition
# Worth of each unit in m, kg, s and rad.
_UNITS: dict[str, tuple[Dimension, float]] = {
    "N": (_FORCE, 1.0),
    "mN": (_FORCE, 1e-3),
    "kN": (_FORCE, 1e3),
    "MN": (_FORCE, 1e6),
    "lbf": (_FORCE, _POUND_FORCE),
    "m": ((1, 0, 0), 1.0),
    "cm": ((1, 0, 0), 1e-2),
    "mm": ((1, 0, 0), 1e-3),
    "in": ((1, 0, 0), 0.0254),
    "ft": ((1, 0, 0), 0.3048),
    "kg": ((0, 1, 0), 1.0),
    "g": ((0, 1, 0), 1e-3),
    "t": ((0, 1, 0), 1e3),
    "lb": ((0, 1, 0), _POUND),
    "slug": ((0, 1, 0), _POUND_FORCE / 0.3048),
    "slinch": ((0, 1, 0), _POUND_FORCE / 0.0254),
    "s": ((0, 0, 1), 1.0),
    "ms": ((0, 0, 1), 1e-3),
    "rad": ((0, 0, 0), 1.0),
    "mrad": ((0, 0, 0), 1e-3),
    "deg": ((0, 0, 0), math.pi / 180),
}
_DIMENSION: dict[tuple[ElementFigure, bool], tuple[Dimension, str]] = {
    ("stiffness", True): ((2, 1, -2), "120 N*m/rad"),
    ("stiffness", False): ((0, 1, -2), "5 N/mm"),
    ("damping", True): ((2, 1, -1), "0.4 N*m*s/rad"),
    ("damping", False): ((0, 1, -1), "3 N*s/m"),
    ("inertia", True): ((2, 1, 0), "1e-3 kg*m^2"),
}
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")
_FACTOR = re.compile(r"\s*([*·/]?)\s*([A-Za-z]+)\s*(?:(?:\^|\*\*)?\s*([23])|([²³]))?\s*")


@dataclass(frozen=True)
class Compound:
    """A number and the product of units after it, as written.

    Parameters
    ----------
    value : float
        The number.
    unit : str
        Units, empty where none were written.
    """

    value: float
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.value!r} {self.unit}".rstrip()

    def figure_in(self, units: Units, figure: ElementFigure, rotation: bool) -> float:
        """Worth in a unit system; a number without a unit is in that system already, and radians.

        Parameters
        ----------
        units : Units
            Of the scene.
        figure : {"stiffness", "damping", "inertia"}
            What is measured.
        rotation : bool
            Whether it acts about an axis, or along it.

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


def parse_compound(value: object) -> Compound:
    """Read a number with or without units.

    Parameters
    ----------
    value : int, float, str or Compound
        What was written; factors are joined by ``*``, ``·``, ``/`` or a blank, and a ``/`` divides by the next alone.

    Raises
    ------
    UnitsError
        If it is no number, or a unit is unknown.

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
    if form is None or not math.isfinite(float(form[1])):
        raise UnitsError(f"'{value}' is not a number with units, e.g. 120 N*m/rad")
    unit = form[2].strip()
    if unit:
        _product(unit)
    return Compound(float(form[1]), unit)


def _product(text: str) -> tuple[Dimension, float]:
    """Dimension of a product of units, and its worth in SI."""
    exponents, factor, at = [0, 0, 0], 1.0, 0
    while at < len(text):
        form = _FACTOR.match(text, at)
        if form is None or (at == 0 and form[1]):
            raise UnitsError(f"'{text}' is no product of units, e.g. N*m/rad")
        sign, name, at = form[1], form[2], form.end()
        if name not in _UNITS:
            raise UnitsError(f"unknown unit '{name}' in '{text}', known are {', '.join(_UNITS)}")
        power = int(form[3] or {"²": 2, "³": 3}.get(form[4] or "", 1)) * (-1 if sign == "/" else 1)
        own, worth = _UNITS[name]
        exponents = [have + power * more for have, more in zip(exponents, own, strict=True)]
        factor *= worth**power
    return (exponents[0], exponents[1], exponents[2]), factor
