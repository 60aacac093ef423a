"""Numbers with units against their definitions."""

import math

import pytest

from cmsreduce.config.keys.quantities import Quantity, measure, parse_quantity
from cmsreduce.errors import UnitsError
from cmsreduce.model import Units


@pytest.mark.parametrize(
    ("text", "dimension", "si"),
    [
        ("10 Hz", "frequency", 10.0),
        ("10Hz", "frequency", 10.0),
        ("2.5 kHz", "frequency", 2500.0),
        ("600 rpm", "frequency", 10.0),
        ("600 RPM", "frequency", 10.0),
        ("6.283185307179586 rad/s", "frequency", 1.0),
        ("180 deg", "angle", math.pi),
        ("-45 °", "angle", -math.pi / 4),
        ("1e-3 rad", "angle", 1e-3),
        ("3600 arcsec", "angle", math.pi / 180),
        ("3 mm", "length", 0.003),
        (".5 in", "length", 0.0127),
        ("20 ms", "time", 0.02),
        (0, "angle", 0.0),
    ],
)
def test_worth_in_si(text, dimension, si):
    assert measure(text, dimension) == pytest.approx(si, rel=1e-15)


def test_a_bare_number_takes_the_unit_it_is_given():
    assert measure(12.5, "frequency", bare=1.0) == 12.5
    assert measure("12.5", "frequency", bare=1.0) == 12.5


def test_length_in_a_unit_system():
    mm = Units.parse("mm-t-s")
    assert parse_quantity("2 cm").length_in(mm) == pytest.approx(20.0, rel=1e-15)
    assert parse_quantity(20).length_in(mm) == 20.0


def test_text_form_reads_back():
    assert parse_quantity(str(Quantity(0.1, "deg"))) == Quantity(0.1, "deg")


@pytest.mark.parametrize(
    ("value", "dimension", "words"),
    [
        ("10 m", "frequency", "10 m is a length, a frequency is expected, e.g. 10 Hz"),
        ("3 s", "angle", "3 s is a time, an angle is expected, e.g. 45 deg"),
        (30, "angle", "30 has no unit, an angle is expected: write deg or rad"),
        ("10 furlongs", "length", "unknown unit 'furlongs', known are m, dm"),
        ("10 mhz", "frequency", "mHz or MHz"),
        ("ten Hz", "frequency", "not a number with a unit"),
        ("10 Hz Hz", "frequency", "not a number with a unit"),
        ("1e999 Hz", "frequency", "not a finite number"),
        ("1e200 mm", "length", "not a finite number up to 1e.100"),
        (float("nan"), "frequency", "not a finite number"),
        (True, "frequency", "not a number with a unit"),
        (None, "frequency", "not a number with a unit"),
    ],
)
def test_refused(value, dimension, words):
    with pytest.raises(UnitsError, match=words):
        measure(value, dimension)
