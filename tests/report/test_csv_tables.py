import numpy as np
import pytest

from cmsreduce.report import csv_tables
from tests.report.conftest import GAIN, HZ, SHIFT, oscillators


def test_tables_hold_the_numbers_of_the_run(make_run) -> None:
    tables = csv_tables(make_run())
    assert all(len(row) == len(heads) for heads, *rows in tables.values() for row in rows)
    errors = [row[:2] + row[5:] for row in tables["errors"][1:]]
    assert errors[2] == ("spin=45 cone=30", "reduced", 0.02, 0.125, SHIFT)
    assert [row[1:] for row in tables["frequencies"][1:3]] == [
        (pytest.approx(hz), pytest.approx(hz * (1 + SHIFT)), pytest.approx(1)) for hz in HZ
    ]
    assert tables["timings"][2] == ("rotor", "reduce", 1.5)
    assert [row[9] for row in tables["modes"][1:]] == [1, 1, 0]


def test_responses_are_the_closed_form(make_run) -> None:
    heads, *rows = csv_tables(make_run())["response_1_spin=0"]
    assert heads[:3] == ("hz", "full motor > gyro re", "full motor > gyro im")
    values = np.array(rows, dtype=float)
    np.testing.assert_allclose(values[:, 1] + 1j * values[:, 2], oscillators(values[:, 0], HZ, GAIN), rtol=1e-12)


def test_empty_tables_are_left_out(make_run) -> None:
    names = list(csv_tables(make_run(configurations=(), speed=None)))
    assert names == ["modes", "checks", "timings"]
