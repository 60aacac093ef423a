import numpy as np
import pytest

from cmsreduce.model import Configuration, RigidBody, SystemModes, Units
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


def test_modes_of_the_system_and_rigid_bodies_are_tables(make_run) -> None:
    """Products of inertia follow the moments; a mass of 2 t at 100 mm is 2000 kg at 0.1 m."""
    tensor = np.array([[3.0, 0.1, 0.2], [0.1, 2.5, 0.3], [0.2, 0.3, 2.0]])
    hub = RigidBody("hub", 2.0, np.array([100.0, 0, 0]), tensor, units=Units.parse("mm-t-s"))
    systems = (SystemModes(Configuration("as built"), 6, np.array([1.5, 2.5]), zeta=np.array([0.01, 0.02])),)
    tables = csv_tables(make_run(rigid_bodies=(hub,), systems=systems))
    assert tables["system"][1:] == [("as built", 1.5, 0.01), ("as built", 2.5, 0.02)]
    heads, (name, *values) = tables["rigid_bodies"]
    assert (name, heads[1], heads[2], heads[-1]) == ("hub", "mass_kg", "cg_x_m", "inertia_yz_kg_m2")
    assert values == pytest.approx([2000, 0.1, 0, 0, 3e-3, 2.5e-3, 2e-3, 1e-4, 2e-4, 3e-4])


def test_empty_tables_are_left_out(make_run) -> None:
    names = list(csv_tables(make_run(configurations=(), speed=None)))
    assert names == ["modes", "checks", "timings"]
