import numpy as np
import pytest

from cmsreduce.report import csv_tables
from tests.report.conftest import GAIN, HZ, SHIFT, oscillators


def test_tables_hold_the_numbers_of_the_run(make_run) -> None:
    tables = {table.name: table for table in csv_tables(make_run())}
    assert all(len(row) == len(table.heads) for table in tables.values() for row in table.rows)
    errors = [row[:2] + row[5:] for row in tables["errors"].rows]
    assert errors[2] == ("spin=45 cone=30", "reduced", 0.02, 0.125, SHIFT)
    assert [row[1:] for row in tables["frequencies"].rows[:2]] == [
        (pytest.approx(hz), pytest.approx(hz * (1 + SHIFT)), pytest.approx(1)) for hz in HZ
    ]
    assert tables["timings"].rows[1] == ("rotor", "reduce", 1.5)
    assert [row[9] for row in tables["modes"].rows] == [1, 1, 0]


def test_responses_are_the_closed_form(make_run) -> None:
    table = next(each for each in csv_tables(make_run()) if each.name == "response_1_spin=0")
    assert table.heads[:3] == ("hz", "full motor > gyro re", "full motor > gyro im")
    values = np.array(table.rows, dtype=float)
    np.testing.assert_allclose(values[:, 1] + 1j * values[:, 2], oscillators(values[:, 0], HZ, GAIN), rtol=1e-12)


def test_empty_tables_are_left_out(make_run) -> None:
    names = [table.name for table in csv_tables(make_run(configurations=(), speed=None))]
    assert names == ["modes", "checks", "timings"]
