"""Rounding of printed numbers."""

import pytest

from cmsreduce.read.printed_numbers import digits_of, rounding_of_printed, stops_in_a_number

DOUBLE = 2.0**-53


@pytest.mark.parametrize(
    ("text", "digits"),
    [
        ("1.736458917D+05", 10),
        ("-1.736458917D+05", 10),
        ("0.17364D+06", 5),
        ("  8.4695512820513e+10 ", 14),
        ("1.25-3", 3),
        ("155.600", 6),
        ("0.000", 0),
        ("7", 1),
        (".5", 1),
        ("nan", 0),
        ("", 0),
    ],
)
def test_digits(text: str, digits: int) -> None:
    assert digits_of(text) == digits


@pytest.mark.parametrize(
    ("numbers", "rounding"),
    [
        (["1.736458917D+05", "-2.000000000D+00", "0.000000000D+00"], 5e-11),
        (["1.7365E+05", "-2.0000E+00"], 5e-6),
        (["1.2345678901234567e+00"], DOUBLE),
        # A general format of six digits, and numbers typed by hand.
        (["173646", "1.33333", "2", "0.5"], 5e-7),
        (["2", "-1", "0.5", "1e5", "3.25e3"], DOUBLE),
        (["2.0e+00", "1.0e+00"], DOUBLE),
        # A fixed format is as fine as its largest number.
        (["20000000.000000", "-0.333333"], 5e-15),
        ([], DOUBLE),
        (["nan", "0.0"], DOUBLE),
    ],
)
def test_rounding(numbers: list[str], rounding: float) -> None:
    assert rounding_of_printed(numbers) == pytest.approx(rounding)


@pytest.mark.parametrize(
    ("numbers", "rounding"),
    [
        (["1.2345+3", "123456.7", "-2.3-1"], 5e-6),
        (["-1.234+5", "2.0"], 5e-5),
        (["2.0", "-1.5", "300."], DOUBLE),
    ],
)
def test_rounding_in_fields_of_eight(numbers: list[str], rounding: float) -> None:
    assert rounding_of_printed(numbers, 8) == pytest.approx(rounding)


@pytest.mark.parametrize(
    ("numbers", "cut"),
    [
        (["1.2345e+00", "-6.7890e-01", "1.23"], True),
        (["1.2345e+00", "-6.7890e-01", "1.2345e-0"], True),
        (["1.2345e+00", "-6.7890e-01", "1.2345e-01"], False),
        (["1.5", "20.25", "3"], False),
        (["1.2345e+00"], False),
    ],
)
def test_cut_inside_the_last_number(numbers: list[str], cut: bool) -> None:
    assert stops_in_a_number(numbers) is cut
